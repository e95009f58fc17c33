"""Motion by solving configurations: no time, no integration, every crank angle to rounding."""

import copy
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import REVOLUTION, other_revolutions
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.path import AssemblyPath, PosePath, traced_path
from mechsim.simulation.poses.trace import MAX_STEP, MIN_STEP, branch_path, trace
from mechsim.simulation.settings import Settings
from mechsim.simulation.state import hinge_entries, quaternion_entries

# fourth-order steps per revolution, with errors of poses below 1e-4: measured 2e-6 to 2e-5 over the catalogue
STEPS = 48
STEP_TIME = REVOLUTION / STEPS
# error of a pose above which it may leave the assembly; well above the measured errors and below any distance
# between assemblies
MAX_ERROR = 1e-3
# ratio of a determinant to those two steps on either side, below which it may have a double zero between:
# with one it grows as the square of the distance, and the ratio is a ninth at most
MIN_DETERMINANT_RATIO = 0.25
# maximum number of steps, for memory
MAX_STEPS = 1_000_000


@quiet()
def explicit_trace(loops: ModelLoops, start: Array, end: float, jacobian: Array) -> Array | None:
    """Return nearly closed states, (n, nq), on the path from a closed one to a crank angle.

    None where it is not certain that they stay in the assembly: loops do not close, or the sign of the
    determinant changes or is unknown.

    Args:
        loops: of the model, which is not changed.
        start: closed state, (nq,).
        end: crank angle in [rad].
        jacobian: of the loops at the start, (1, m, nv).
    """
    angle = float(start[loops.crank_address])
    count = int(np.ceil(abs(end - angle) / STEP_TIME))
    sign = float(loop_jacobian.determinant_sign(loops, jacobian)[0])
    if sign == 0.0 or count > MAX_STEPS:
        return None
    speed = (end - angle) / (count * STEP_TIME)
    states = _stepped(loops, start, speed * loop_jacobian.tangent(loops, jacobian)[0], count)
    angles = np.linspace(angle, end, count + 1)[1:]
    # MuJoCo resets a bad state to the initial one
    if not np.abs(states[:, loops.crank_address] - angles).max() < MAX_ERROR:
        return None
    states[:, loops.crank_address] = angles
    residual, jacobian = loops.linearise(states)
    same_sign = (loop_jacobian.determinant_sign(loops, jacobian) == sign).all()
    if not (loops.closure_error(residual).max() < MAX_ERROR and same_sign):
        return None
    return None if _may_branch(np.abs(loop_jacobian.determinant(loops, jacobian))) else states


def _may_branch(determinants: Array) -> bool:
    """Return whether assemblies may coincide between states: the determinant may have a double zero."""
    neighbours = np.minimum(determinants[:-4], determinants[4:])
    return bool((determinants[2:-2] < MIN_DETERMINANT_RATIO * neighbours).any())


def _stepped(loops: ModelLoops, start: Array, rates: Array, count: int) -> Array:
    """Return the unchecked states after each step of `STEP_TIME` at the crank's rate, (count, nq)."""
    if loops not in _runners:
        _runners[loops] = _runner(loops)
    sims = _runners[loops]
    sims.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
    sims.bind("qpos")[:], sims.bind("qvel")[:] = start, rates
    return sims.rollout(count, record=("qpos",))["qpos"][0]


# one simulation per model: creating one takes as long as stepping it for a revolution
_runners: WeakKeyDictionary[ModelLoops, batch.Batch] = WeakKeyDictionary()


def _runner(loops: ModelLoops) -> batch.Batch:
    """Return a simulation of the model with stiff loops and virtual drive inertia."""
    hard = replace(loops, model=copy.copy(loops.posed.kinematic_model))
    hard.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    Settings(steps_per_turn=STEPS).apply(hard, STEP_TIME)
    return batch.Batch(hard.model, 1, 1)


# distance between states before and after a revolution, in [rad] or characteristic lengths, that is rounding
RETURN_TOLERANCE = 1e-9
# change of the residuals, in [rad], below which the pose is the same
MAX_RESIDUAL_CHANGE = 1e-9


def revolution_gain(loops: ModelLoops, states: Array) -> Array | None:
    """Return the change of a state by a revolution of the crank, (nq,); None where it does not lead back."""
    ends = loop_jacobian.close(loops, states[[0, -1]])
    gain = np.where(quaternion_entries(loops.model), 0.0, ends[1] - ends[0])
    whole_turns = np.where(hinge_entries(loops.model), REVOLUTION * np.round(gain / REVOLUTION), 0.0)
    # a link with ball joints may have spun, but the points on its axis must return
    positions = point_positions(loops, ends)
    returns = (
        np.abs(positions[1] - positions[0]).max(initial=0.0) < RETURN_TOLERANCE * loops.characteristic_length
    )
    return whole_turns if returns and np.abs(gain - whole_turns).max() < RETURN_TOLERANCE else None


def point_positions(loops: ModelLoops, states: Array) -> Array:
    """Return the positions of all sites and loop-closing points at n states, (n, k, 3) in [m]."""
    position, rotation = loops.posed.body_poses(states)
    ends = [end for pair in loops.pairs for end in pair.ends]
    points = [(position[:, body] + rotation[:, body] @ local)[:, None] for body, local in ends]
    return np.concatenate([*points, loops.posed.site_positions(states)], 1)


def on_other_revolutions(loops: ModelLoops, state: Array, angles: Array) -> Iterator[Array]:
    """Yield a closed state (nq,) at crank angles within a revolution of the given ones, (n,).

    There is none where a gear makes the pose differ after a revolution of the crank, or under motion laws.
    """
    for revolutions in other_revolutions(float(state[loops.crank_address]), angles):
        shifted = _shifted(loops, state, revolutions)
        if shifted is not None:
            yield shifted


def _shifted(loops: ModelLoops, state: Array, revolutions: int) -> Array | None:
    """Return the state with revolutions added to the crank angle; None where that is another pose."""
    if loops.drivers is not None:
        return None
    shifted = state.copy()
    shifted[loops.crank_address] += revolutions * REVOLUTION
    for coupling in loops.couplings:
        driven = coupling.left.addresses
        if len(driven) > 1 or not hinge_entries(loops.model)[driven].all():
            continue
        gain = coupling.target(shifted[None]) - coupling.target(state[None])
        shifted[driven] += REVOLUTION * np.round(gain / coupling.left.weights / REVOLUTION)
    residual_change = loops.closure_error(loops.residual(shifted[None]) - loops.residual(state[None]))
    return shifted if residual_change.max() < MAX_RESIDUAL_CHANGE else None


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
    return loop_jacobian.close(loops, state[None])[0]


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


# fraction of the path by which the straight line extends beyond both of its ends
BEYOND = 0.5


def move_drivers(loops: ModelLoops, state: Array, target: Array, target_text: str) -> Array:
    """Return the closed state with the drivers at their targets, (nq,), and the path parameter at zero.

    All drivers move at once along a straight path.

    Args:
        loops: with drivers that follow a path parameter.
        state: closed, (nq,).
        target: values of the drivers, (k,) in [m] or [rad].
        target_text: where that is, in words.

    Raises:
        AssemblyError: where the loops do not close on the path.
    """
    drivers = loops.drivers
    assert drivers is not None
    start = state.copy()
    start[loops.crank_address] = 0.0
    current = start[drivers.addresses]
    distance = float(
        np.abs((target - current) / np.where(drivers.slides, loops.characteristic_length, 1.0)).max(
            initial=0.0
        )
    )
    if distance > 0.0:

        def straight(angle: Array) -> tuple[Array, Array, Array]:
            fraction = np.clip(angle / distance, -BEYOND, 1.0 + BEYOND)
            none = np.zeros((len(current), len(angle)))
            displacement = (target - current)[:, None]
            return current[:, None] + displacement * fraction, displacement / distance + none, none

        def along(angle: float) -> str:
            values = straight(np.array([angle]))[0][:, 0]
            text = ", ".join(
                f"{name} = {value:.6g}" for name, value in zip(drivers.names, values, strict=True)
            )
            return f"{text} on the way to {target_text}"

        start = follow(replace(loops, drivers=drivers.with_law(straight, along)), start, [distance])[0]
    start[loops.crank_address], start[drivers.addresses] = 0.0, target
    return start
