"""Motion by solving poses: no time, no integration, every crank angle to rounding."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.simulation import closing, loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.branch import branch_path
from mechsim.simulation.poses.explicit_predictor import MAX_ERROR, explicit_trace
from mechsim.simulation.poses.path import AssemblyPath, PosePath, traced_path
from mechsim.simulation.poses.revolutions import on_other_revolutions, revolution_gain
from mechsim.simulation.poses.trace import MAX_STEP, MIN_STEP, trace

# two crank angles -> the path between them; None where it is not certain
Build = Callable[[float, float], PosePath | None]


def follow(loops: ModelLoops, start: Array, angles: ArrayLike) -> Array:
    """Return the states at crank angles in the assembly of a closed start state, (n, nq).

    Explicit steps over the range, or continuation where their error is too large, keep the assembly.
    Interpolation between these states gives all others to within a Newton step or two, which are solved
    together. Where a revolution of the crank leads back to the start, one revolution is traced for any
    number. The angles of an oscillating crank may be offset by whole revolutions if the linkage is the same
    there.

    Args:
        loops: of the model.
        start: closed state, (nq,).
        angles: crank angles in any order, (n,) in [rad].

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    return follow_path(loops, start, angles)[0]


def follow_path(loops: ModelLoops, start: Array, angles: ArrayLike) -> tuple[Array, PosePath]:
    """Return what `follow` does, and the path on which the states lie."""
    angles = np.asarray(angles, dtype=np.float64)
    try:
        return _follow_path(loops, start, angles)
    except AssemblyError:
        for shifted in on_other_revolutions(loops, start, angles):
            with suppress(AssemblyError):
                return _follow_path(loops, shifted, angles)
        raise


def _follow_path(loops: ModelLoops, start: Array, angles: Array) -> tuple[Array, PosePath]:
    if loops.change_point == "branch":
        build: Build = partial(branch_path, loops, start)
    else:
        explicit = _explicit_path(loops, start, angles)
        if explicit is not None:
            states, certain = explicit.states_at(angles)
            if certain.all():
                return states, explicit
        build = partial(_traced_path, loops, start)
    path = _over_range(loops, start, angles, build)
    assert path is not None
    return _states_on(path, angles), path


def _over_range(loops: ModelLoops, start: Array, angles: Array, build: Build) -> PosePath | None:
    """Return the path over the range of crank angles, of one revolution if that leads back to the start."""
    angle = float(start[loops.crank_address])
    low, high = min(angle, float(angles.min())), max(angle, float(angles.max()))
    if high - low > 1.5 * REVOLUTION and loops.drivers is None:
        revolution = build(angle, angle + REVOLUTION)
        if revolution is not None:
            last = revolution.pieces[-1].knots[-1:]
            if last[0, loops.crank_address] != angle + REVOLUTION:  # a change point lies just beyond
                last = _states_on(revolution, np.array([angle + REVOLUTION]))
            gain = revolution_gain(loops, np.concatenate([start[None], last]))
            if gain is not None:
                return replace(revolution, gain=gain)
    return build(low, high)


def _states_on(path: PosePath, angles: Array) -> Array:
    """Return closed states at crank angles, (n, nq), on a path; uncertain ones are traced."""
    states, certain = path.states_at(angles)
    for i in np.flatnonzero(~certain):
        states[i] = _traced_to(path, angles[i : i + 1])
    return states


def _traced_to(path: PosePath, angle: Array) -> Array:
    """Return the closed state at a crank angle, (1,), traced from the nearest knot, (nq,)."""
    loops, nearest = path.pieces[0].loops, path.nearest_knot(angle)
    state = [nearest, *trace(loops, nearest, float(angle[0])).states][-1].copy()
    state[loops.crank_address] = angle[0]
    return closing.close(loops, state[None])[0]


def _explicit_path(loops: ModelLoops, start: Array, angles: Array) -> PosePath | None:
    """Return the path over the range of crank angles by explicit steps; None where it is not certain."""
    angle = start[loops.crank_address]
    if loops.drivers is not None or np.ptp(np.append(angles, angle)) < MAX_STEP:
        return None
    jacobian = loops.linearise(start[None])[1]
    sign = float(loop_jacobian.determinant_sign(loops, jacobian)[0])

    def build(low: float, high: float) -> PosePath | None:
        sides = [
            explicit_trace(loops, start, end, jacobian) if abs(end - angle) > MIN_STEP else start[None][:0]
            for end in (low, high)
        ]
        if sides[0] is None or sides[1] is None:
            return None
        knots = np.concatenate([sides[0][::-1], start[None], sides[1]])
        return PosePath((AssemblyPath(loops, knots, sign, certain_correction=0.0, max_correction=MAX_ERROR),))

    return _over_range(loops, start, angles, build)


def _traced_path(loops: ModelLoops, start: Array, low: float, high: float) -> PosePath:
    """Return the path between two crank angles by continuation from a closed state (nq,) between them."""
    before, after = (trace(loops, start, end) for end in (low, high))
    knots = np.stack([*before.states[::-1], start, *after.states])
    change_points = (*before.change_points, *after.change_points)
    return PosePath((traced_path(loops, knots, change_points),), change_points)
