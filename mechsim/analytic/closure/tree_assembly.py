"""Assembly in coordinates of the tree: the loops closed where what is prescribed stands at the start."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from mechsim.analytic.closure.drawn_poses import drawn_towards_guess
from mechsim.analytic.closure.random_starts import random_poses, taken
from mechsim.analytic.closure.tree_loops import TreeLoops, tree_loops
from mechsim.analytic.closure.tree_motion import Coordinates, Placed, placed
from mechsim.analytic.closure.unclosed import CLOSED, drawn_together, why_unclosed
from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import KINDS, opposed
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.rough_poses import rough_poses, starts

# how far a link may stray from its guess, in sizes and [rad], before another way to close the loops is tried
NEAR = 0.5
# random starts where a guess that leaves links out leads nowhere
STARTS = 48
# coordinates that are named
NAMED = 6


def assembled(mechanism: Mechanism) -> tuple[TreeLoops, Coordinates]:
    """Return the loops of a mechanism and the coordinates in which they close nearest to its guess.

    Raises:
        AssemblyError: where they do not close; names the gap that is left, and where they would.
    """
    rough, told = rough_poses(mechanism), starts(mechanism)
    found: list[tuple[float, TreeLoops, Coordinates]] = []
    refused: AssemblyError | None = None
    for poses in _beginnings(mechanism, rough):
        try:
            loops, begun = tree_loops(mechanism, poses, told)
            at = closed(loops, begun)
            here = placed(loops.tree, at)
            _require_axes_alike(loops, here)
            found.append((_strayed(mechanism, loops, here), loops, at))
        except AssemblyError as error:
            refused = refused or error
        if found and found[-1][0] < NEAR:
            break
    if not found:
        assert refused is not None
        return _anywhere(mechanism, rough, refused)
    return min(found, key=lambda one: one[0])[1:]


def _beginnings(mechanism: Mechanism, rough: Mapping[str, Pose]) -> Iterator[Mapping[str, Pose]]:
    """Yield poses of all links from which loops may close: joints as they come, drawn, slides first."""
    yield rough
    drawn = drawn_towards_guess(mechanism, rough)
    if drawn is not None:
        yield drawn
    if len(mechanism.guess) < len(mechanism.links):
        yield rough_poses(mechanism, stiff_first=True)


def _anywhere(
    mechanism: Mechanism, rough: Mapping[str, Pose], refused: AssemblyError
) -> tuple[TreeLoops, Coordinates]:
    """Return loops closed from random starts: nearest to a guess that leaves links out, then to nought.

    Raises:
        AssemblyError: where the guess names every link, saying where else they close; that which is given
            where they close nowhere, or not near the guess.
    """
    loops, own = tree_loops(mechanism, rough, starts(mechanism))
    batches = [many for _, many in random_poses(loops, own, STARTS, seed=1)]
    if len(mechanism.guess) == len(mechanism.links):
        raise _not_from_there(loops, own, batches) or refused
    best: tuple[float, float] = (NEAR, np.inf)
    chosen: Coordinates | None = None
    for at in (taken(many, np.array([i])) for many in batches for i in range(len(many))):
        rank = (
            _strayed(mechanism, loops, placed(loops.tree, at)),
            float(np.abs(at.values / loops.units[:, None]).max(initial=0.0)),
        )
        if rank[0] < NEAR and rank < best:
            best, chosen = rank, at
    if chosen is None:
        raise refused
    return loops, closed(loops, chosen)


def _not_from_there(
    loops: TreeLoops, own: Coordinates, batches: Iterable[Coordinates]
) -> AssemblyError | None:
    """Return the refusal of a guess from which loops do not close that close elsewhere; None for others."""
    mechanism, places = loops.tree.mechanism, loops.tree.places
    found = [(many.values - own.values) / loops.units[:, None] for many in batches]
    away = np.concatenate([np.zeros((loops.tree.count, 0)), *found], 1)
    if not away.shape[1]:
        return None
    nearest = own.values + (loops.units * away[:, np.abs(away).max(0).argmin()])[:, None]
    prescribed = (*mechanism.drivers, *mechanism.locked)
    named = [name for name in places if name not in prescribed][:NAMED]

    def stand(names: Iterable[str]) -> str:
        return ", ".join(f"{name} = {nearest[places[name], 0]:.4g}" for name in names)

    return AssemblyError(
        f"{mechanism.name}: {'at ' + stand(prescribed[:NAMED]) + ' ' if prescribed else ''}the loops do not "
        f"close from where the other joints start, but with {stand(named)} they do; start near there, by a "
        "keyframe, the places of the bodies, or the guess"
    )


def _strayed(mechanism: Mechanism, loops: TreeLoops, here: Placed) -> float:
    """Return how far links of the guess are from it, in units of the size and in [rad], the worst."""
    worst = 0.0
    for name, pose in mechanism.guess.items():
        i = loops.tree.links[name]
        gone = float(np.linalg.norm(here.position[i, :, 0] - pose.position)) / loops.tree.size
        turned = float(np.trace(pose.rotation.T @ here.rotation[i, :, :, 0]))
        worst = max(worst, gone, float(np.arccos(np.clip(0.5 * (turned - 1.0), -1.0, 1.0))))
    return worst


def held_values(mechanism: Mechanism) -> Array:
    """Return the values of held coordinates, (holds,) in [m] or [rad]."""
    return np.array([*mechanism.locked.values()], dtype=np.float64)


def with_holds(driven: Array, held: Array) -> Array:
    """Return all that is prescribed, (drivers + holds, n), from the drivers (drivers, n) and (holds,)."""
    if not len(held):
        return driven
    return np.vstack([driven, np.broadcast_to(held[:, None], (len(held), driven.shape[1]))])


def closed(loops: TreeLoops, at: Coordinates) -> Coordinates:
    """Return the coordinates in which the loops close nearest to some, what is prescribed standing still.

    Raises:
        AssemblyError: where they do not close; names the gap that is left, and where they would.
    """
    found, gap = drawn_together(loops, at)
    if gap < CLOSED:
        return found
    raise AssemblyError(why_unclosed(loops, at, found, gap))


def _require_axes_alike(loops: TreeLoops, here: Placed) -> None:
    """Refuse cuts put together with axes or marks opposed: the rows say parallel, not in which sense."""
    for cut in loops.cuts:
        _, frame_a, _, frame_b = cut.frames(here)
        for i in KINDS[cut.joint.kind].alike:
            if float((frame_a[:, i] * frame_b[:, i]).sum()) < 0.0:
                raise AssemblyError(f"{loops.tree.mechanism.name}: {opposed(cut.joint.name, i)}")
