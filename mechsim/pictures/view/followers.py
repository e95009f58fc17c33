"""How solids and ends of springs follow changed dimensions: each corner moves with a point of its link."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.pictures.view.pose_grid import LivePage

# step of a dimension for its rates, relative to the range of its slider
STEP = 1e-4
# displacement over the range of a slider that is not seen, and that of another solid in a step, in rod radii
UNSEEN, OTHER = 1e-3, 0.1
# link, corners (n, 3) and sizes of what is drawn
Corners = tuple[str, ArrayLike, ArrayLike]


def followers(
    live: LivePage, draw: Callable[[Mechanism], Iterable[Corners]], radius: float
) -> list[dict[str, Any] | None]:
    """Return how each drawn thing follows the dimensions of a page; None for what they do not change.

    `at` is the number of the point that each corner follows: of the sides a and b of all joints, then of the
    tracked points, then of none. `rates` are what remains of the changes of all corners and sizes: dimension,
    first and second order in the range of its slider, by differences. Where a design has other solids or
    another order of them, corners follow the nearest point.

    Args:
        live: the page.
        draw: draws a design.
        radius: of rods in [m].
    """

    def design(changed: Mapping[str, float]) -> tuple[list[Corners], Array]:
        mechanism = live.describe(changed)
        joints = [mechanism.joint(own["name"]) for own in live.data["joints"]]
        corners: list[Corners] = [(end.link, end.point, ()) for own in joints for end in (own.a, own.b)]
        corners += [(*mechanism.points[own["name"]], ()) for own in live.data["points"]]
        corners += [("", np.zeros(3), ()), *draw(mechanism)]
        return corners, np.concatenate([np.ravel(numbers) for _, *own in corners for numbers in own])

    none, rates = 2 * len(live.data["joints"]) + len(live.data["points"]), list[Array]()
    (drawn, start), i = design({}), 3 * (none + 1)
    for own in live.data["dimensions"]:
        step = STEP * (own["nodes"][1] - own["nodes"][0])
        low, high = (design({own["name"]: own["value"] + by})[1] for by in (-step, step))
        if not len(low) == len(start) == len(high):
            low, high = (np.append(each[:i], np.full(len(start) - i, np.nan)) for each in (low, high))
        rates.append(np.stack([(high - low) / (2 * STEP), (high + low - 2 * start) / (2 * STEP**2)]))
    orders = np.stack(rates)
    points, moved = start[:i].reshape(-1, 3), orders[..., :i].reshape(-1, 2, none + 1, 3)
    out = list[dict[str, Any] | None]()
    for link, corners, sizes in drawn[none + 1 :]:
        choice = np.array([none, *(k for k in range(none) if drawn[k][0] == link)])
        end = i + np.size(corners)
        other = ~(np.abs(orders[..., i:end]).max(2) @ [STEP, STEP**2] < OTHER * radius)
        off = np.abs(orders[..., i:end].reshape(*moved.shape[:2], -1, 1, 3) - moved[:, :, None, choice])
        off[other] = 0.0
        # what explains a corner: rest, or else the nearest point
        gaps = np.linalg.norm(start[i:end].reshape(-1, 1, 3) - points[choice], axis=-1)
        gaps[:, 0] = np.inf if other.any() else 0.0
        followed = choice[np.lexsort((gaps, np.maximum(off.sum((0, 1, 4)), UNSEEN * radius)))[:, 0]]
        rest = orders[..., i : (i := end + np.size(sizes))].copy()
        rest[..., : 3 * len(followed)] -= moved[:, :, followed].reshape(*moved.shape[:2], -1)
        rest[other] = 0.0
        visible = np.flatnonzero(np.abs(rest).max((1, 2), initial=0.0) > UNSEEN * radius).tolist()
        shown = [[k, *([float(f"{value:.6g}") for value in order] for order in rest[k])] for k in visible]
        out.append({"at": followed.tolist(), "rates": shown} if shown or followed.min() < none else None)
    return out
