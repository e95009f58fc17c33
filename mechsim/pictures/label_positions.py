"""Positions of names next to points, where nothing else is written."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim.numerics.arrays import Array

# largest distance of points that share one label, in pixels
SHARED_DISTANCE = 3.0
# smallest distance between labels, in pixels
LABEL_GAP = 2.0
# sides of a point for its label, and multiples of the usual distance
SIDES = ((1, -1), (-1, -1), (1, 1), (-1, 1), (1, 0), (-1, 0), (0, -1), (0, 1))
FARTHER = (1.0, 1.8, 2.8)
# costs of a label's position: over another label, over a point, over a line, closer to another
# point than to its own, outside the picture, and different from the frame before; a label moves rather than
# be at another point
LABEL, POINT, LINE, NEARER, OUT, MOVED = 10.0, 1.0, 2.0, 5.0, 100.0, 2.5
Placement = tuple[tuple[int, int], float]


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle of a picture in pixels, y downwards."""

    x_low: float
    y_low: float
    x_high: float
    y_high: float

    def meets(self, other: "Rectangle") -> bool:
        """Return whether it overlaps another, with a margin."""
        return not (
            self.x_high + LABEL_GAP < other.x_low
            or other.x_high + LABEL_GAP < self.x_low
            or self.y_high + LABEL_GAP < other.y_low
            or other.y_high + LABEL_GAP < self.y_low
        )

    def distance(self, point: Array) -> float:
        """Return the distance from a point, (2,); 0 inside."""
        x, y = point
        across = max(self.x_low - x, 0.0, x - self.x_high)
        return float(np.hypot(across, max(self.y_low - y, 0.0, y - self.y_high)))

    def inside(self, resolution: tuple[int, int]) -> bool:
        """Return whether it lies inside a picture of a size."""
        width, height = resolution
        return min(self.x_low, self.y_low) >= 0.0 and self.x_high <= width and self.y_high <= height


def shared(points: Mapping[str, Array]) -> list[tuple[str, Array]]:
    """Return names, joined for coincident points, and their positions in pixels, (2,)."""
    groups: list[tuple[list[str], Array]] = []
    for name, position in points.items():
        for names, other in groups:
            if float(np.hypot(*(position - other))) < SHARED_DISTANCE:
                names.append(name)
                break
        else:
            groups.append(([name], position))
    return [(", ".join(names), position) for names, position in groups]


def placed(
    points: Sequence[Array],
    widths: Sequence[float],
    height: float,
    off: float,
    resolution: tuple[int, int],
    occupied: Sequence[Rectangle] = (),
    before: Sequence[Placement | None] = (),
    lines: ArrayLike = (),
) -> list[tuple[Rectangle, Placement]]:
    """Return where labels stand, each off the middle of all points, where nothing else is written.

    Args:
        points: the named points, (2,) in pixels each.
        widths: of the labels in pixels.
        height: of a line in pixels.
        off: distance between a label and its point, in pixels.
        resolution: of the picture.
        occupied: rectangles that are occupied already.
        before: side and distance of each label in the frame before; it keeps them unless it would touch
            another label or the edge, or would be closer to another point.
        lines: points of lines that labels had better not cover, (n, 2) in pixels.

    Returns:
        Where each stands, and on which side how far off.
    """
    middle = np.mean(np.array(points), axis=0) if len(points) else np.zeros(2)
    dots = [Rectangle(px - 2.0, py - 2.0, px + 2.0, py + 2.0) for px, py in points]
    busy, placements = list(occupied), list[tuple[Rectangle, Placement]]()
    x, y = np.asarray(lines, dtype=np.float64).reshape(-1, 2).T
    for i, (point, width) in enumerate(zip(points, widths, strict=True)):
        leftwards = len(points) > 1 and point[0] < middle[0]
        sides = sorted(SIDES, key=lambda side: side[0] != (-1 if leftwards else 1))
        candidates = [(side, factor) for factor in FARTHER for side in sides]
        spots = [_spot(point, width, height, off * factor, side) for side, factor in candidates]
        others = [k for k in range(len(points)) if k != i]
        last = before[i] if before else None
        costs = [
            (0.0 if spot.inside(resolution) else OUT)
            + LABEL * sum(spot.meets(other) for other in busy)
            + POINT * sum(spot.meets(dots[k]) for k in others)
            + NEARER * any(spot.distance(points[k]) < spot.distance(point) for k in others)
            + MOVED * (last not in (None, candidate))
            + LINE * bool(((spot.x_low < x) & (x < spot.x_high) & (spot.y_low < y) & (y < spot.y_high)).any())
            for spot, candidate in zip(spots, candidates, strict=True)
        ]
        best = int(np.argmin(costs))
        busy.append(spots[best])
        placements.append((spots[best], candidates[best]))
    return placements


def _spot(point: Array, width: float, height: float, off: float, side: tuple[int, int]) -> Rectangle:
    x, y = side
    x_low = point[0] + (off if x > 0 else -off - width if x < 0 else -0.5 * width)
    y_low = point[1] + (off if y > 0 else -off - height if y < 0 else -0.5 * height)
    return Rectangle(x_low, y_low, x_low + width, y_low + height)
