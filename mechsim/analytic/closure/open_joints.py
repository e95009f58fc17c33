"""Which joints the drivers leave open: the loop equations do not invent their motion."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from mechsim.analytic.closure.generic_pose import held
from mechsim.analytic.closure.loop_solver import LoopSolver
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates, Placed, placed
from mechsim.errors import STEPPED, MobilityError
from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND

# displacement along a freedom, in radians or parts of the size; a residual that is closed; and the part of
# the displacement by which a joint or a point is seen to move
NUDGE, CLOSED, SEEN = 1e-3, 1e-10, 1e-2
# a coordinate that takes part in a freedom by less takes none; and names that a refusal lists
PART, LISTED = 1e-6, 12


def require_determined(solver: LoopSolver) -> None:
    """Refuse a mechanism whose drivers do not settle it; idle freedoms, such as a rod's spin, are none.

    Args:
        solver: of its loops, about a pose that is no special one.

    Raises:
        MobilityError: with the joints and points left open, no more of them than there are freedoms.
    """
    loops, names = solver.loops, open_names(solver)
    floating = {joint.name for joint in loops.tree.mechanism.joints if KINDS[joint.kind].floats}
    if names:
        listed = " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else names[0]
        base = ", hold the base (--fix-base)" if floating & {*names} else ""
        raise MobilityError(
            f"{loops.tree.mechanism.name}: undetermined: with what is driven held, {listed} "
            f"{'are' if len(names) > 1 else 'is'} left open; drive, hold or couple "
            f"{'them' if len(names) > 1 else 'it'}{base}, lock what is left open (--lock-others), "
            f"or {STEPPED}",
            "undetermined",
        )


def open_names(solver: LoopSolver) -> list[str]:
    """Return what can move though all that is prescribed is held, no more of it than there are freedoms."""
    names: list[str] = []
    for name, _ in _open(solver) if solver.open else ():
        if len(names) == LISTED:
            return [*names, "others"]
        names += [name] if name not in names else []
    return names


def to_lock(solver: LoopSolver) -> tuple[str, ...]:
    """Return coordinates, balls and floating joints with which locked nothing is undetermined.

    Those outside loops come first; in a loop as many as it has undetermined degrees of freedom.
    """
    names = (name for _, name in _open(solver, loops_last=True)) if solver.open else ()
    return tuple(dict.fromkeys(names))


def _open(solver: LoopSolver, *, loops_last: bool = False) -> Iterator[tuple[str, str]]:
    """Yield what can move, one name for each freedom: with all before it held, it still can.

    Each comes with what locks it: its coordinate, or the ball or floating joint.
    """
    loops, gauge = solver.loops, solver.gauge
    tree = loops.tree
    columns = {name: int(np.searchsorted(loops.unknown, place)) for name, place in tree.places.items()}
    free = [name for name, place in tree.places.items() if place in loops.unknown]
    joints = {name: joint for joint in tree.mechanism.joints for name in joint.coordinates}
    if loops_last:
        # a coordinate that no loop ties to others is a null-space direction of its own
        free.sort(key=lambda name: float(np.linalg.norm(gauge[:, columns[name]])) < 1.0 - PART)
    for name in free:
        moves = _nudged(solver, gauge, columns[name])
        if moves and name in moves:
            said = joints[name].name if KINDS[joints[name].kind].floats else name
            yield said, said
            gauge = held(gauge, columns[name])
    # what no coordinate counts: the turns of balls
    for ball in tree.balls:
        for turn in range(ball.turning, ball.turning + 3):
            column = int(np.searchsorted(loops.unknown, turn))
            moves = _nudged(solver, gauge, column)
            if moves:
                yield ball.joint.name if ball.kind.floats else moves[0], ball.joint.name
                gauge = held(gauge, column)


def _nudged(solver: LoopSolver, gauge: Array, column: int) -> list[str]:
    """Return what is seen to move in the freedoms in which a coordinate takes part; empty for an idle one."""
    loops, part = solver.loops, gauge[:, column]
    size = float(np.linalg.norm(part))
    if size < PART:
        return []
    step = np.zeros((loops.tree.count, 1))
    step[loops.unknown, 0] = NUDGE * (part / size) @ gauge
    nudged = loops.moved(solver.pinned, step)
    try:
        there, found, _ = replace(solver, pinned=nudged).close(nudged)
    except np.linalg.LinAlgError:
        return []
    # at a singular pose the loops draw it back
    if np.abs(found.residual).max(initial=0.0) >= CLOSED:
        return []
    return _seen(loops, solver.pinned, there)


def _seen(loops: TreeLoops, before: Coordinates, after: Coordinates) -> list[str]:
    """Return the coordinates and tracked points that differ between two poses."""
    tree = loops.tree
    gone = np.abs(after.values - before.values)[:, 0] / loops.units
    names = [name for name, place in tree.places.items() if gone[place] > SEEN * NUDGE]
    here, there = (_points(loops, placed(tree, at)) for at in (before, after))
    far = SEEN * NUDGE * tree.mechanism.size
    return names + [f"point {name}" for name, at in here.items() if np.abs(there[name] - at).max() > far]


def _points(loops: TreeLoops, at: Placed) -> Mapping[str, Array]:
    tree = loops.tree
    return {
        name: at.position[tree.links[link], :, 0] + at.rotation[tree.links[link], :, :, 0] @ np.array(local)
        for name, (link, local) in tree.mechanism.points.items()
        if link != GROUND
    }
