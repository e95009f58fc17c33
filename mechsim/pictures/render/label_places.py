"""Where names stand beside their points: inside the picture, off one another and off what else is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.numerics.arrays import Array

# points nearer than this share one label, in pixels; a label keeps so far off another
TOGETHER, APART = 3.0, 2.0
# sides on which a label may stand, and how many times as far off as usual it may go
SIDES = ((1, -1), (-1, -1), (1, 1), (-1, 1), (1, 0), (-1, 0), (0, -1), (0, 1))
FARTHER = (1.0, 1.8, 2.8)
# what a place costs: over another label, over a point, out of the picture, elsewhere than in the frame before
LABEL, POINT, OUT, MOVED = 10.0, 1.0, 100.0, 2.5
Place = tuple[tuple[int, int], float]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A part of a picture in pixels, y downwards."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: "Rectangle") -> bool:
        """Return whether it overlaps another, or nearly."""
        return not (
            self.right + APART < other.left
            or other.right + APART < self.left
            or self.bottom + APART < other.top
            or other.bottom + APART < self.top
        )

    def inside(self, size: tuple[int, int]) -> bool:
        """Return whether it lies in a picture of a size."""
        return self.left >= 0.0 and self.top >= 0.0 and self.right <= size[0] and self.bottom <= size[1]


def shared(points: Mapping[str, Array]) -> list[tuple[str, Array]]:
    """Return names, those of points that coincide in one, and where in pixels, (2,)."""
    groups: list[tuple[list[str], Array]] = []
    for name, at in points.items():
        for names, there in groups:
            if float(np.hypot(*(at - there))) < TOGETHER:
                if name not in names:
                    names.append(name)
                break
        else:
            groups.append(([name], at))
    return [(", ".join(names), at) for names, at in groups]


def placed(
    points: Sequence[Array],
    widths: Sequence[float],
    height: float,
    off: float,
    size: tuple[int, int],
    taken: Sequence[Rectangle] = (),
    before: Sequence[Place | None] = (),
) -> list[tuple[Rectangle, Place]]:
    """Return where labels stand, each off the middle of all points where nothing else is in its place.

    Args:
        points: that they name, (2,) in pixels each.
        widths: of the labels in pixels.
        height: of a line in pixels.
        off: how far a label keeps off its point, in pixels.
        size: of the picture.
        taken: what is written there already.
        before: side and distance where each stood in the frame before, which it leaves only where another
            label or the edge is in its way.

    Returns:
        Where each stands, and on which side how far off.
    """
    middle = np.mean(np.array(points), axis=0) if len(points) else np.zeros(2)
    dots = [Rectangle(x - 2.0, y - 2.0, x + 2.0, y + 2.0) for x, y in points]
    busy, found = list(taken), list[tuple[Rectangle, Place]]()
    for i, (at, width) in enumerate(zip(points, widths, strict=True)):
        leftwards = len(points) > 1 and at[0] < middle[0]
        sides = sorted(SIDES, key=lambda side: side[0] != (-1 if leftwards else 1))
        places = [(side, far) for far in FARTHER for side in sides]
        spots = [_spot(at, width, height, off * far, side) for side, far in places]
        others, last = [dot for k, dot in enumerate(dots) if k != i], before[i] if before else None
        costs = [
            _cost(spot, size, busy, others) + (MOVED if last not in (None, place) else 0.0)
            for spot, place in zip(spots, places, strict=True)
        ]
        best = int(np.argmin(costs))
        busy.append(spots[best])
        found.append((spots[best], places[best]))
    return found


def _spot(at: Array, width: float, height: float, off: float, side: tuple[int, int]) -> Rectangle:
    x, y = side
    left = at[0] + (off if x > 0 else -off - width if x < 0 else -0.5 * width)
    top = at[1] + (off if y > 0 else -off - height if y < 0 else -0.5 * height)
    return Rectangle(left, top, left + width, top + height)


def _cost(
    spot: Rectangle, size: tuple[int, int], busy: Sequence[Rectangle], dots: Sequence[Rectangle]
) -> float:
    return (
        (0.0 if spot.inside(size) else OUT)
        + LABEL * sum(spot.meets(other) for other in busy)
        + POINT * sum(spot.meets(dot) for dot in dots)
    )
