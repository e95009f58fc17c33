"""Motion from configurations that are solved at each crank angle to rounding, without time integration.

At a change point two assemblies of a model coincide; the motion through it is interpolated.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.mechanism.limits import require_travel
from mechsim.mechanism.motion import Motion, replace_instants, weighted_sums
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array, other_revolutions
from mechsim.numerics.continuation import ContinuationPath, PathNames
from mechsim.numerics.loop_solver import loop_solver
from mechsim.numerics.rank import least_norm
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.equations import ModelEquations, ModelStates
from mechsim.simulation.recording import States, evaluate
from mechsim.simulation.state import hinge_entries, quaternion_entries

# singular values below this fraction of the largest belong to unconstrained directions in the neighbourhood
CONSTRAINED_FRACTION = 0.05
# degree of the polynomial that is fitted to values at the nodes
DEGREE = 18


@dataclass(frozen=True)
class ChangePoint:
    """A change point, and the path of an assembly through it.

    Attributes:
        angle: of the crank, in [rad].
        states: closed, at nodes on both sides, (k, nq).
        nodes: crank angles of the states, (k,).
    """

    angle: float
    states: Array
    nodes: Array

    def weights(self, angles: Array) -> Array:
        """Return the weights of values at the nodes in a polynomial fit at angles close to it, (n, k).

        The nearest nodes count least: rounding errors of rates grow as the inverse cube of the distance.
        """
        reach = float(np.abs(self.nodes - self.angle).max())
        at_nodes, at_angles = ((values - self.angle) / reach for values in (self.nodes, angles))
        trust = np.abs(at_nodes) ** 3
        fit = np.linalg.pinv(trust[:, None] * chebvander(at_nodes, DEGREE), rcond=1e-12) * trust
        return chebvander(at_angles, DEGREE) @ fit


def closed_near(loops: ModelLoops, states: Array) -> Array:
    """Return states close to a change point, closed by Newton steps in the constrained directions."""
    for _ in range(2):
        residual, jacobian = loops.linearise(states)
        step = np.zeros((len(states), loops.model.nv))
        constrained = loop_jacobian.constrained_jacobian(loops, jacobian)
        step[:, loops.free] = -least_norm(constrained, residual, CONSTRAINED_FRACTION, floor=0.0)
        states = loops.displaced(states, step)
    return states


Rows = NDArray[np.intp]
# change points, the rows close to each, and their crank angles reduced to its range, (k,) in [rad]
NearRows = Sequence[tuple[ChangePoint, Rows, Array]]


def moved_away(states: Array, near_rows: NearRows) -> Array:
    """Return states in which those close to change points are moved away, so that they have rates."""
    away = states.copy()
    for change_point, rows, _ in near_rows:
        away[rows] = change_point.states[-1]
    return away


def interpolated_motion(
    motion: Motion, closed: ClosedModel, qpos: Array, near_rows: NearRows, rates: tuple[Array, Array]
) -> Motion:
    """Return a motion whose rows close to change points are interpolated from the motion around these.

    Args:
        motion: at states from `moved_away`.
        closed: the model.
        qpos: states of all rows, (n, nq).
        near_rows: rows close to change points.
        rates: the crank's speed and acceleration at all rows, (n,) each.
    """
    if not near_rows:
        return motion
    assert motion.closure is not None
    assert motion.conditioning is not None
    closure, conditioning, time = motion.closure.copy(), motion.conditioning.copy(), motion.time
    loops, track, cranks = closed.loops, closed.track, np.stack(rates, 1)
    for change_point, rows, reduced in near_rows:
        count = len(change_point.states)
        tangent = loop_jacobian.tangent(loops, loops.linearised(change_point.states)[1])
        for speed, acceleration in np.unique(cranks[rows], axis=0):
            same = (cranks[rows] == [speed, acceleration]).all(1)
            accelerations = np.full(count, acceleration)
            around = States(np.zeros(count), change_point.states, speed * tangent, accelerations)
            nodes = evaluate(loops, track, around, "pose")
            interpolated = weighted_sums(nodes, change_point.weights(reduced[same]))
            motion = replace_instants(motion, rows[same], interpolated)
        # a regular pose is added, because singular values that are zero at all states do not count
        residual, jacobian = loops.linearised(np.concatenate([qpos[rows], change_point.states[-1:]]))
        closure[rows] = np.abs(residual[:-1, loops.point_rows]).max(1, initial=0.0)
        conditioning[rows] = loop_jacobian.conditioning(loops, jacobian)[:-1]
    values = {
        track.name(loops.model.joint(i).name)[0]: qpos[:, address]
        for i, address in enumerate(loops.model.jnt_qposadr)
    }
    return replace(
        motion,
        angle=qpos[:, loops.crank_address],
        speed=rates[0],
        acceleration=rates[1],
        time=time,
        joints={name: replace(joint, value=values[name]) for name, joint in motion.joints.items()},
        closure=closure,
        conditioning=conditioning,
    )


def revolution_gain(loops: ModelLoops, states: Array) -> Array | None:
    """Return the change of a state by a revolution of the crank, (nq,); None if the pose does not return."""
    ends = loop_jacobian.close(loops, states[[0, -1]])
    gain = np.where(quaternion_entries(loops.model), 0.0, ends[1] - ends[0])
    whole_turns = np.where(hinge_entries(loops.model), REVOLUTION * np.round(gain / REVOLUTION), 0.0)
    # a link with ball joints may have spun, but the points on its axis must return
    positions = point_positions(loops, ends)
    returns = np.abs(positions[1] - positions[0]).max(initial=0.0) < ROUNDING * loops.characteristic_length
    return whole_turns if returns and np.abs(gain - whole_turns).max() < ROUNDING else None


def point_positions(loops: ModelLoops, states: Array) -> Array:
    """Return the positions of all sites and loop-closing points at n states, (n, k, 3) in [m]."""
    position, rotation = loops.posed.body_poses(states)
    ends = [end for pair in loops.pairs for end in pair.ends]
    points = [(position[:, body] + rotation[:, body] @ local)[:, None] for body, local in ends]
    return np.concatenate([*points, loops.posed.site_positions(states)], 1)


def _shifted(loops: ModelLoops, state: Array, revolutions: int) -> Array | None:
    """Return the state with revolutions added to the crank angle; None if that is another pose."""
    if not loops.drivers.crank:
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
    return shifted if residual_change.max() < ROUNDING else None


# correction of an interpolated pose, in [rad] or [m], above which it may be in another assembly
MAX_CORRECTION = 1e-3
# motion of a driver in a pulse that polynomials omit, in [rad] or characteristic lengths, above which the
# driver is moved there in steps; the largest step; and the largest motion of other joints relative to it
OMITTED, DRIVER_STEP, MAX_GAIN = 1e-4, 0.02, 10.0
# accuracy of a change point's angle, in [rad], measured 1.5e-11; rates within it are those of the path beyond
CHANGE_POINT_TOLERANCE = 1e-10
# maximum number of cached paths, which later calls extend
MAX_KEPT = 8


class PosePath(ContinuationPath[ModelEquations, ModelStates]):
    """The states of a model's assembly along its crank angle, or the path parameter of its drivers.

    Attributes:
        gain: change of a state by a revolution, (nq,), if the pose returns to the start; otherwise None.
    """

    # the loops hardly constrain the pose within 1.5e-2 rad
    singular_fraction = 0.15

    def __init__(self, closure: ModelLoops, start: Array):
        text = closure.drivers.text
        names = PathNames("the drivers", text, text)
        if closure.drivers.crank:
            names = PathNames("the crank", lambda s: f"{s:.7g} rad", text)
        first = loop_solver(ModelEquations(closure, start), ModelStates(start[None]))
        initial = float(start[closure.crank_address])
        super().__init__(first, lambda s: s[None], initial, closure.change_point, names)
        self.gain: Array | None = None

    def require_travel(self, start: float, target: float) -> None:
        """Reject a path that is too long for one motion."""
        what, position = f"{self.name}: {self.words.mover}", self.words.position
        require_travel(what, position(start), position(target), abs(target - start))

    def revolutions(self, angles: Array) -> Array:
        """Return the whole revolutions between crank angles and the traced revolution, (n,)."""
        return np.zeros(len(angles)) if self.gain is None else np.floor((angles - self.initial) / REVOLUTION)

    def states_at(self, angles: Array) -> Array:
        """Return closed states at crank angles, (n, nq)."""
        closure, revolutions = self.loops.closure, self.revolutions(angles)
        reduced = angles - revolutions * REVOLUTION
        states = np.empty((len(angles), closure.model.nq))
        for _, index, rows in self.chunks(reduced):
            for first in range(0, len(index), closure.chunk):
                chunk = index[first : first + closure.chunk]
                guess = self.unflat(rows[first : first + closure.chunk], reduced[chunk]).qpos
                if self.gain is not None:
                    guess += revolutions[chunk, None] * self.gain
                guess[:, closure.crank_address] = angles[chunk]
                states[chunk] = self._closed(guess, self.near_change_point(reduced[chunk]))
        return states

    def _closed(self, guess: Array, singular: NDArray[np.bool_]) -> Array:
        guess = self._with_pulses(guess, singular)
        closure, states = self.loops.closure, guess.copy()
        if singular.any():
            states[singular] = closed_near(closure, guess[singular])
        if not singular.all():
            states[~singular] = loop_jacobian.close(closure, guess[~singular])
        self._require_small(states, guess, MAX_CORRECTION)
        return states

    def _with_pulses(self, guess: Array, singular: NDArray[np.bool_]) -> Array:
        """Return states whose drivers have moved in steps to their laws, of which polynomials omit pulses."""
        closure, drivers = self.loops.closure, self.loops.closure.drivers
        start = guess[:, drivers.addresses].T
        offset = drivers.law(guess[:, closure.crank_address])[0] - start
        distance = np.abs(offset / closure.units[drivers.dofs, None]).max(0, initial=0.0)
        omitted = (distance > OMITTED) & ~singular
        states, steps = guess.copy(), int(np.ceil(distance[omitted].max(initial=0.0) / DRIVER_STEP))
        for k in range(1, steps + 1):
            locked = drivers.locked_at((start + offset * (k / steps))[:, omitted])
            before = states[omitted]
            states[omitted] = loop_jacobian.close(replace(closure, drivers=locked), before)
            self._require_small(states[omitted], before, MAX_GAIN * DRIVER_STEP)
        return states

    def _require_small(self, states: Array, guess: Array, limit: float) -> None:
        """Raise AssemblyError if a pose differs from its guess by more than a limit in [rad] or [m]."""
        correction = np.abs(states - guess).max(1, initial=0.0)
        if not (correction < limit).all():
            angle = float(guess[np.argmax(correction), self.loops.closure.crank_address])
            raise AssemblyError(
                f"{self.name}: the pose at {self.words.instant(angle)} is too near a singular one to be "
                "distinguished from another assembly; keep away from it"
            )

    def near_change_points(self, angles: Array) -> Iterator[tuple[ChangePoint, NDArray[np.intp], Array]]:
        """Yield change points, the indices of crank angles near them, and these reduced by revolutions.

        An angle at a change point belongs to the path beyond it.
        """
        reduced = angles - self.revolutions(angles) * REVOLUTION
        for crossing in self.crossings:
            close = np.abs(reduced - crossing.parameter) < crossing.radius
            upper = reduced > crossing.parameter - CHANGE_POINT_TOLERANCE
            rising = crossing.beyond.nodes[-1] > crossing.parameter
            for segment, ahead in ((crossing.before, not rising), (crossing.beyond, rising)):
                rows = np.flatnonzero(close & (upper == ahead))
                if len(rows):
                    states = self.unflat(segment.states, segment.nodes).qpos
                    yield ChangePoint(crossing.parameter, states, segment.nodes), rows, reduced[rows]


def follow(loops: ModelLoops, start: Array, angles: ArrayLike) -> Array:
    """Return the states at crank angles in the assembly of a closed start state, (n, nq).

    Continuation keeps the assembly. Its polynomials give all states to within a Newton step or two, which are
    solved together. If a revolution of the crank leads back to the start, one traced revolution serves for
    any number. The angles of an oscillating crank may be offset by whole revolutions if the pose is the same
    there.

    Args:
        loops: of the model.
        start: closed state, (nq,).
        angles: crank angles in any order, (n,) in [rad].

    Raises:
        AssemblyError: with the crank angle beyond which the loops cannot close in this assembly.
    """
    return follow_path(loops, start, angles)[0]


@quiet()
def follow_path(loops: ModelLoops, start: Array, angles: ArrayLike) -> tuple[Array, PosePath]:
    """Return the states of `follow`, and the path on which they lie."""
    angles = np.asarray(angles, dtype=np.float64)
    try:
        return _follow_path(loops, start, angles)
    except AssemblyError:
        for revolutions in other_revolutions(float(start[loops.crank_address]), angles):
            shifted = _shifted(loops, start, revolutions)
            if shifted is not None:
                with suppress(AssemblyError):
                    return _follow_path(loops, shifted, angles)
        raise


def _follow_path(loops: ModelLoops, start: Array, angles: Array) -> tuple[Array, PosePath]:
    path = _pose_path(loops, tuple(start.tolist()))
    revolves = np.ptp(np.append(angles, path.initial)) > 1.5 * REVOLUTION
    if revolves and path.gain is None and loops.drivers.crank:
        # follow one revolution of the crank, and compare its ends
        with suppress(AssemblyError):
            end = path.states_at(np.array([path.initial, path.initial + REVOLUTION]))
            path.gain = revolution_gain(path.loops.closure, end)
    return path.states_at(angles), path


@lru_cache(maxsize=MAX_KEPT)
def _pose_path(loops: ModelLoops, start: tuple[float, ...]) -> PosePath:
    """Return the path of a model from a start, as far as earlier calls traced it."""
    return PosePath(loops, np.array(start))


# fraction of the path by which the straight line extends beyond both of its ends
BEYOND = 0.5


def move_drivers(loops: ModelLoops, state: Array, target: Array, target_text: str) -> Array:
    """Return the closed state with the drivers at their targets, (nq,), and the path parameter at zero.

    All drivers move at once along a straight path.

    Args:
        loops: with drivers that follow a path parameter.
        state: closed, (nq,).
        target: values of the drivers, (k,) in [m] or [rad].
        target_text: description of the target.

    Raises:
        AssemblyError: if the loops do not close on the path.
    """
    drivers, start = loops.drivers, state.copy()
    start[loops.crank_address] = 0.0
    current = start[drivers.addresses]
    distance = float(np.abs((target - current) / loops.units[drivers.dofs]).max(initial=0.0))
    if distance > 0.0:

        def straight(angle: Array) -> tuple[Array, Array, Array]:
            fraction = np.clip(angle / distance, -BEYOND, 1.0 + BEYOND)
            none = np.zeros((len(current), len(angle)))
            displacement = (target - current)[:, None]
            return current[:, None] + displacement * fraction, displacement / distance + none, none

        def along(angle: float) -> str:
            values = straight(np.array([angle]))[0]
            return f"{drivers.locked_at(values).text(angle)} on the way to {target_text}"

        moving = replace(drivers, law=straight, text=along)
        start = follow(replace(loops, drivers=moving), start, [distance])[0]
    start[loops.crank_address], start[drivers.addresses] = 0.0, target
    return start
