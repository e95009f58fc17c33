"""Forward dynamics: `run` integrates a mechanism's motion from an initial state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim import units
from mechsim.errors import AssemblyError, InputError, first_names
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinetics.compiled_model import CompiledModel
from mechsim.kinetics.compiled_motion import DenseSteps, evaluated
from mechsim.kinetics.contacts import CLOSED_GAP, ContactMode, EventFunction, Stop, gap_indices, stops_of
from mechsim.kinetics.crank_turns import TURNS_BUDGET, CrankTurns
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, Kinematics, equations_of_motion
from mechsim.kinetics.forward_dynamics import BUDGET, UNTIL, Executed, Integration, Piece, Trajectory
from mechsim.kinetics.gaps import GAP, gaps_of, released, require_in_holes
from mechsim.kinetics.initial_state import InitialValues, StateLayout, initial_state, projected
from mechsim.kinetics.model import DynamicModel, dynamic_model
from mechsim.kinetics.passive_rotation import with_determined_motion
from mechsim.kinetics.singular_passages import singular_passages
from mechsim.kinetics.state_quantities import Event, motion_of, parse_event
from mechsim.mechanism.finding import Outcome
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import state_variable
from mechsim.mechanism.limits import Ranges, require_within
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion, short_repr
from mechsim.mechanism.motion_laws import State
from mechsim.mechanism.nonlinear_springs import Phases
from mechsim.numerics.arrays import EPS, Array, unique
from mechsim.numerics.resources import Progress, no_progress

# an initial value: in SI, text with units, or the numbers of a rotation or angular velocity
Initial = float | str | Sequence[float]
# relative error of a step; the error of a pendulum after a hundred periods is then 2e-11 of its amplitude in
# C, and below 4e-12 in numpy (validation/published/forward_dynamics.py)
TOLERANCE = 3e-13
# displacement in units, such as radians, below which a motion is integrated again with errors relative to it;
# numbers of instants at which it is measured, the second where it is small at the first; and roundings of a
# coordinate, and of loops, that the tolerance of a step contains: with 0.3 of the latter, half a second of a
# row of 200 four-bars has errors of 1e-12 rad instead of 3e-13
SMALL, DISPLACEMENTS, ROUNDINGS = 0.1, (10, 400), (3.0, 0.1)
# smallest singular value of the loop constraints at the start, relative to their norm: at a change point,
# loops close to 1e-7 only, and accelerations have no significant digits
SINGULAR_START = 1e-6
# exchange relative to the potential energy that is its rounding: up to 30 of 2e-16 in mechanisms at rest
ENERGY_ROUNDING = 64.0 * EPS
# columns of a run that are energies
ENERGIES = ("kinetic", "potential", "work", "lost")
# difference from the value of an event, in SI, at which it holds: rounding of closed loops
EVENT_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class RunSegment:
    """The motion between two successive impacts or changes of friction.

    Attributes:
        first: start in [s].
        last: end in [s].
        sticking: whether a friction sticks or a stop is in contact.
        touching: whether a stop is in contact.
        closed: gaps of contacts and ropes that are closed.
        phases: phases of the nonlinear springs.
    """

    first: float
    last: float
    sticking: bool
    touching: bool
    closed: tuple[str, ...] = ()
    phases: Phases = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicRun:
    """A run of forward dynamics at n instants, in SI.

    Attributes:
        motion: motion of all points, links and joints; its `time` holds the instants.
        kinetic: kinetic energy, (n,) in [J].
        potential: potential energy of gravity and springs, (n,) in [J].
        work: work of motor and loads since the start, (n,) in [J].
        lost: energy lost in friction, dampers and impacts since the start, (n,) in [J].
        driving: prescribed coordinate -> its drive force or torque, (n,) in [N] or [N m].
        outcome: "done", "stopped", "time over", "diverged", "dead centre", "failed" (a joint beyond its
            range), "too stiff" or "work budget spent"; with turns of the crank also "cannot start" (it did
            not move, or came back) and "turned back" (it moved, but did not make the turns).
        reason: one sentence if the outcome is not "done".
        events: instants of impacts and of changes between sticking and sliding, in [s].
        segments: the motion between them, in order.
        steps: number of integration steps.
        drift: largest magnitude of the summed energy corrections, in [J].
        singular: instants at which the drivers do not determine the motion, in [s].
        executed: what evaluated the equations of motion, "C" or "numpy".
        note: why it was not C; empty if it was.
        activation: states of the actuators that have one, (states, n).
    """

    motion: Motion
    kinetic: Array
    potential: Array
    work: Array
    lost: Array
    driving: Mapping[str, Array]
    outcome: Outcome
    reason: str
    events: tuple[float, ...]
    segments: tuple[RunSegment, ...]
    steps: int
    drift: float
    singular: tuple[float, ...] = ()
    executed: Executed = "numpy"
    note: str = ""
    activation: Array = field(default_factory=lambda: np.zeros((0, 0)))

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.kinetic)

    @property
    def time(self) -> Array:
        """Instants, (n,) in [s]."""
        assert self.motion.time is not None
        return self.motion.time

    @property
    def openings(self) -> dict[str, list[tuple[float, float]]]:
        """Contact or rope -> first and last instants in [s] at which it is open or slack, between impacts."""
        return {
            gap.removesuffix(GAP): [(s.first, s.last) for s in self.segments if gap not in s.closed]
            for gap in self.motion.joints
            if gap.endswith(GAP)
        }

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the motion's columns, kinetic, potential, work and lost in [J], and drive forces."""
        yield from self.motion.columns()
        yield from ((name, getattr(self, name)) for name in ENERGIES)
        yield from ((f"drive {name}", effort) for name, effort in self.driving.items())

    @property
    def energy_error(self) -> float:
        """Largest error of the energy balance, corrections included, relative to the exchanged energy.

        It is 0 for an exchange within the rounding of the potential energy, as of a mechanism at rest.
        """
        total = self.kinetic + self.potential - self.work + self.lost
        exchanged = max(
            float(self.kinetic.max()), float(np.ptp(self.potential)), float(np.abs(self.work).max()), 1e-300
        )
        moves = exchanged > ENERGY_ROUNDING * float(np.abs(self.potential).max())
        return (float(np.abs(total - total[0]).max()) + self.drift) / exchanged if moves else 0.0


def run(
    source: Any,
    forces: Forces | None = None,
    *,
    initial: Mapping[str, Initial] | None = None,
    prescribed: Sequence[str] = (),
    duration: float | str | None = None,
    until: str | None = None,
    turns: float | None = None,
    samples: int = 500,
    tolerance: float = TOLERANCE,
    restitution: float = 0.0,
    budget: int | None = None,
    progress: Progress = no_progress,
) -> DynamicRun:
    """Integrate the motion of a mechanism from an initial state under forces.

    Drivers are free unless they are prescribed; motor, loads, springs, friction and weight move them. The
    mechanism may have any number of degrees of freedom, with or without loops.

    Args:
        source: a mechanism, or an object with one, such as the result of `ms.load`; links without an inertia
            are rods.
        forces: applied forces; None selects those of the source, or else gravity along -y.
        initial: initial coordinates `J.q` and rates `J.v` in SI, or text with a unit, such as
            {"crank.q": "10deg"}; of spherical and floating joints axis and angle `J.q`, (4,), and angular
            velocity `J.w`, (3,), of side b in side a's frame. Others start as assembled, at rest.
        prescribed: coordinates that follow the motion laws of the source.
        duration: longest time in [s], or text; may be left out with `turns`.
        until: an event that ends the run, such as "P.y=0", "J.q=90deg" or "distance:P,Q=10mm"; both
            directions of crossing count.
        turns: revolutions of the crank that end the run; negative for backwards.
        samples: instants after the first at which the result is evaluated.
        tolerance: relative error of an integration step.
        restitution: coefficient of restitution of joint stops: rate after an impact divided by that before
            it, 0 to 1.
        budget: largest number of states that the run evaluates; then it ends. None takes twenty times as many
            with `turns` as without.
        progress: called after each integration step with a text and the finished fraction.

    Returns:
        The run; `motion` has the columns `t`, `P.x`, `J.q`, `J.v`, `J.a`.

    Raises:
        InputError: for invalid values, and for an event that already holds at the start.
        AssemblyError: if the loops do not close at the initial values.

    Accuracy: about 2e-11 of the amplitude over a hundred periods at the default tolerance; residuals of the
        loops at rounding.

    Example:
        >>> import mechsim as ms
        >>> run = ms.dynamics.run("four_bar", initial={"A.q": "30deg"}, duration="2s")  # doctest: +SKIP
    """
    model: DynamicModel = source if isinstance(source, DynamicModel) else dynamic_model(source, forces)
    model = released(model)
    values = initial_values(model, initial or {})
    require_in_holes(model, values.coordinates)
    end = units.si(duration, "s", "the duration")
    if turns is None and end is None:
        raise InputError("a run needs a duration, or turns of the crank, after which to end")
    budget = (BUDGET if turns is None else TURNS_BUDGET) if budget is None else budget
    require_settings(end, samples, tolerance, restitution, budget)
    laws = _prescribed_laws(model, prescribed)
    ranges = model.solver.ranges
    names = {*values.coordinates, *values.rates, *ranges, *gaps_of(model.mechanism)}
    event = None if until is None else parse_event(model.mechanism, until, model.solver.written)
    if event is not None:
        names.update(event.quantity.subjects("joint"))
    equations = equations_of_motion(model, names, laws)
    q, rates = initial_state(equations, values)
    start = equations.kinematics(q, rates)
    require_regular(start)
    start = with_determined_motion(start)
    equations = start.equations
    stops = stops_of(equations)
    _require_within(equations, q, stops)

    def integrated(displacement: float) -> Trajectory:
        integration = Integration(start, tolerance, stops, restitution, progress, budget, displacement)
        if turns is not None:
            crank = CrankTurns.from_state(equations, turns, integration.kinematics())
            return crank.trajectory(integration, end)
        assert end is not None
        return integration.run(end) if event is None else _run_until(integration, end, event, until)

    trajectory = integrated(1.0)
    # the mean change of coordinates by the rounding of loops: J^+ of it, mostly along the smallest of the
    # singular values of their constraints J
    loops = EPS / (float(start.conditioning[0]) * equations.rank**0.5) if equations.rank else 0.0
    displacement = _displacement(trajectory, StateLayout(equations).positions, tolerance, loops)
    if displacement < SMALL:
        # errors are relative to the motion, whose size is known now
        trajectory = integrated(displacement)
    result = run_at(equations, trajectory, np.linspace(0.0, trajectory.end, samples + 1))
    return result if result.outcome == "failed" else with_ranges_checked(result, model.mechanism, ranges)


def _displacement(trajectory: Trajectory, count: int, tolerance: float, loops: float) -> float:
    """Return the largest displacement in a run, in units, or more: one whose tolerance is above rounding.

    The first `count` components of a state are positions, which change by the rounding of `loops`. Runs
    without any displacement, or that failed, have that of `Integration`.
    """
    if trajectory.outcome != "done":
        return 1.0
    largest, positions = 0.0, np.empty(0)
    for instants in DISPLACEMENTS:
        states = _states_at(trajectory.pieces, np.linspace(0.0, trajectory.end, instants))[1]
        positions = states[:, :count]
        largest = float(np.abs(positions - positions[0]).max())
        if largest >= SMALL:
            return largest
    rounding = max(ROUNDINGS[0] * EPS * float(np.abs(positions).max()), ROUNDINGS[1] * loops)
    return max(largest, rounding / tolerance) if largest > 0.0 else 1.0


def with_ranges_checked(result: DynamicRun, mechanism: Mechanism, ranges: Ranges) -> DynamicRun:
    """Return a run, with the outcome "failed" if a joint leaves its range.

    Joints at which a loop is cut have no stop in the equations of motion.
    """
    try:
        require_within(
            mechanism.name,
            ranges,
            {name: joint.value for name, joint in result.motion.joints.items()},
            {name: mechanism.unit(name) for name in ranges},
            lambda i: f"{result.time[i]:.6g} s",
            "end the run before, since a loop is cut at this joint, which leaves it without a stop",
        )
    except AssemblyError as error:
        return replace(result, outcome="failed", reason=str(error))
    return result


def _run_until(integration: Integration, end: float, event: Event, text: str | None) -> Trajectory:
    """Return the trajectory to an event, given as a text, or to a time in [s]."""
    equations = integration.equations
    first = float(event.function(equations, integration.kinematics())[0])
    if abs(first) <= EVENT_ROUNDING * (1.0 + abs(event.value)):
        raise InputError(
            f"{equations.model.mechanism.name}: {text} holds at the start already, where the run would end; "
            "start elsewhere, or give an event that is reached later"
        )
    ends: dict[str, EventFunction] = {UNTIL: lambda state, _: event.function(equations, state)}
    trajectory = integration.run(end, ends, watched=event.watched(equations, first))
    if trajectory.outcome != "done" or trajectory.event:
        return trajectory
    return replace(trajectory, outcome="time over", reason=f"{text} was not reached within {end:g} s")


@dataclass(frozen=True, slots=True)
class RecordedStates:
    """States at n instants, on the loops.

    Attributes:
        states: the states, (n, size).
        accelerations: accelerations of the coordinates in units, (n, count).
        kinetic: kinetic energies, (n,) in [J].
        potential: potential energies, (n,) in [J].
        driving: drive force of each prescribed coordinate, (n, prescribed) in [N m] or [N].
    """

    states: Array
    accelerations: Array
    kinetic: Array
    potential: Array
    driving: Array


def joined(records: Sequence[RecordedStates]) -> RecordedStates:
    """Return several records as one."""
    names = [field.name for field in fields(RecordedStates)]
    return RecordedStates(*(np.concatenate([getattr(record, name) for record in records]) for name in names))


def recorded_states(
    equations: EquationsOfMotion,
    compiled: CompiledModel | None,
    mode: ContactMode,
    contacts: Sequence[int],
    times: Array,
    states: Array,
) -> RecordedStates:
    """Return what is recorded of approximate states (n, size) at times (n,) in [s], by C if there is a model.

    `contacts` are the indices of the coordinates that stops hold in the mode.

    Raises:
        AssemblyError: if the loops do not close near a state.
    """
    layout, locked = StateLayout(equations), mode.locked(equations, contacts)
    # C gives no drive forces of prescribed coordinates
    if compiled is not None and locked is not None and not equations.prescribed:
        in_c = evaluated(compiled, states, times, mode, locked, closing=True)
        if np.isfinite(in_c.derivatives).all():
            accelerations = layout.accelerations(in_c.derivatives)
            return RecordedStates(
                in_c.states, accelerations, in_c.kinetic, in_c.potential, np.zeros((len(times), 0))
            )
    q, rates = projected(equations, *layout.unpack_states(states), times)
    state = equations.kinematics(q, rates, layout.activation(states))
    dynamics = equations.accelerate(state, times, mode.sliding, mode.stuck, contacts, mode.phases)
    return RecordedStates(
        layout.replaced(states, q, rates),
        dynamics.acceleration.T,
        dynamics.kinetic,
        dynamics.potential,
        dynamics.driving.T,
    )


def motion_in(equations: EquationsOfMotion, states: Array, accelerations: Array, times: Array) -> Motion:
    """Return the motion at states (n, size) with accelerations (n, count) in units."""
    q, rates = StateLayout(equations).unpack_states(states)
    return motion_of(equations, equations.kinematics(q, rates), accelerations.T, times)


def run_at(equations: EquationsOfMotion, trajectory: Trajectory, times: Array) -> DynamicRun:
    """Return a trajectory evaluated at instants (n,) in [s], each state projected onto the loops."""
    pieces, layout = trajectory.pieces, StateLayout(equations)

    def coordinates_at(times: Array) -> Coordinates:
        return layout.unpack_states(_states_at(pieces, times)[1])[0]

    numbers, states = _states_at(pieces, times)
    piece_of = [pieces[k] for k in numbers]
    in_c = [isinstance(piece.solution, DenseSteps) for piece in piece_of]
    records: list[RecordedStates] = []
    for (_, dense), group in groupby(range(len(times)), key=lambda i: (id(piece_of[i].mode), in_c[i])):
        which = [*group]
        piece, compiled = piece_of[which[0]], trajectory.compiled if dense else None
        records.append(
            recorded_states(equations, compiled, piece.mode, piece.contacts, times[which], states[which])
        )
    record, gaps = joined(records), gaps_of(equations.model.mechanism)
    motion = motion_in(equations, record.states, record.accelerations, times)
    # a gap has no body
    links = {k: link for k, link in motion.links.items() if k.removeprefix(VIRTUAL_PREFIX) not in gaps}
    return DynamicRun(
        motion=replace(motion, links=links),
        kinetic=record.kinetic,
        potential=record.potential,
        work=record.states[:, -2],
        lost=record.states[:, -1],
        driving=dict(zip(equations.prescribed, record.driving.T, strict=True)),
        outcome=trajectory.outcome,
        reason=trajectory.reason,
        events=trajectory.events,
        segments=_segments(pieces, gap_indices(equations)),
        steps=trajectory.steps,
        drift=trajectory.drift,
        singular=singular_passages(equations, coordinates_at, trajectory),
        executed=trajectory.executed,
        note=trajectory.note,
        activation=layout.activation(record.states),
    )


def _states_at(pieces: Sequence[Piece], times: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the piece of each instant of an ascending sequence, (n,), and its state, (n, size)."""
    # at an instant of an impact: the state after it
    numbers = np.searchsorted([piece.last for piece in pieces], times, side="right")
    numbers = np.minimum(numbers, len(pieces) - 1)
    return numbers, np.concatenate([pieces[k].solution(times[numbers == k]) for k in unique(numbers)])


def _segments(pieces: Sequence[Piece], gaps: Mapping[int, str]) -> tuple[RunSegment, ...]:
    """Return the segments of a run; `gaps` are the indices of the gaps of contacts, with their names."""
    segments: list[RunSegment] = []
    for _, group in groupby(pieces, key=lambda piece: id(piece.mode)):
        together = [*group]
        begin, contacts, mode = together[0].first, together[0].contacts, together[0].mode
        closed = tuple(gaps[index] for index in contacts if index in gaps)
        touching = len(contacts) > len(closed)
        sticking = bool(mode.stuck) or touching
        segments.append(RunSegment(begin, together[-1].last, sticking, touching, closed, mode.phases))
    return tuple(segments)


def initial_values(model: DynamicModel, initial: Mapping[str, Initial]) -> InitialValues:
    """Return initial values in SI: those of the model, overridden by `initial`.

    Names are `J.q` and `J.v` of a coordinate, `J.x` and `J.vx` of a displacement, `J.q` (axis and angle) and
    `J.w` (angular velocity) of a spherical or floating joint.

    Raises:
        InputError: for an unknown name, or a value that is not a finite number.
    """
    mechanism = model.mechanism
    names = [coordinate for joint in mechanism.joints for coordinate in joint.coordinates]
    balls = [joint.name for joint in mechanism.joints if KINDS[joint.kind].ball]
    coordinates, rates = dict[str, float](), dict[str, float]()
    rotations, spins = dict[str, Array](), dict[str, Array]()
    for quantity, value in {**model.solver.initial, **initial}.items():
        name, _, component = quantity.rpartition(".")
        if component in ("q", "w") and name in balls:
            vector = _rotation_or_spin(quantity, value, model.solver.written)
            (rotations if component == "q" else spins)[name] = vector
            continue
        variable = state_variable(quantity, names)
        if variable is None:
            choices = [f"{name}.q" for name in [*names, *balls]] + [f"{ball}.w" for ball in balls]
            raise InputError(
                f"initial value {quantity!r} is no value or rate of a joint of {mechanism.name}; it has "
                f"{first_names(choices)}"
            )
        name, component = variable
        unit: Any = mechanism.unit(name) + ("/s" if component == "v" else "")
        what, length = f"initial value {quantity}", mechanism.characteristic_length
        if isinstance(value, str):
            value = units.parse_coordinate(value, unit, what, model.solver.written, length=length)
        (coordinates if component == "q" else rates)[name] = _finite(what, value)
    return InitialValues(coordinates, rates, rotations, spins)


def _rotation_or_spin(quantity: str, value: Initial, written: units.WrittenUnits) -> Array:
    """Return the rotation matrix of `J.q`, X,Y,Z,ANGLE, or the angular velocity of `J.w`, WX,WY,WZ."""
    from scipy.spatial.transform import Rotation

    what, rotates = f"initial value {quantity}", quantity.endswith(".q")
    expected, example = ("X,Y,Z,ANGLE", "1,0,0,30deg") if rotates else ("WX,WY,WZ", "0,0,2")
    names: tuple[units.Unit, ...] = ("1", "1", "1", "rad") if rotates else ("rad/s",) * 3
    entries: list[Any] = value.split(",") if isinstance(value, str) else list(np.atleast_1d(value))
    if len(entries) != len(names):
        raise InputError(f"{what} is {value!r}; give {expected}, as in {quantity}={example}")
    numbers = np.zeros(len(names))
    for i, (entry, unit) in enumerate(zip(entries, names, strict=True)):
        if unit == "rad" and isinstance(entry, str):
            units.require_written(entry, unit, written.declared(unit), what)
        numbers[i] = _finite(what, units.parse(entry, unit, what) if isinstance(entry, str) else entry)
    if not rotates:
        return numbers
    length = float(np.linalg.norm(numbers[:3]))
    if not length > 0.0:
        raise InputError(f"{what} has an axis of length zero; give {expected} with an axis that is not zero")
    matrix: Array = Rotation.from_rotvec(numbers[:3] / length * numbers[3]).as_matrix()
    return matrix


def _finite(what: str, value: Any) -> float:
    if np.ndim(value):
        raise InputError(
            f"{what} is {value}, but the joint has one coordinate; give one number, or load the model with "
            "still=True if the joint is a ball in its file"
        )
    number = float(value)
    if not abs(number) < np.inf:
        raise InputError(f"{what} is {number}; give a finite number")
    return number


def _prescribed_laws(model: DynamicModel, names: Sequence[str]) -> dict[str, State]:
    laws = model.solver.motion_laws.by_name
    for name in names:
        if name not in laws:
            raise InputError(
                f"{model.mechanism.name}: {name!r} has no motion law to follow; load the model with "
                f"drive={{{name!r}: LAW}}"
            )
    return {name: laws[name] for name in names}


def require_regular(state: Kinematics) -> None:
    """Raise InputError for a singular initial configuration: the motion from it is undetermined."""
    equations = state.equations
    limit = SINGULAR_START * float(np.linalg.norm(state.jacobian))
    if equations.rank and state.conditioning[0] < limit:
        raise InputError(
            f"{equations.model.mechanism.name}: the initial configuration is singular, as a change point is: "
            "assembly modes meet there, and the motion is not determined; start next to it"
        )


def _require_within(equations: EquationsOfMotion, q: Coordinates, stops: Sequence[Stop]) -> None:
    """Raise InputError for a start beyond a stop."""
    names = {index: name for name, index in equations.loops.tree.index_of.items()}
    for stop in stops:
        unit = equations.loops.units[stop.index]
        value, limit = float(q.values[stop.index, 0]), stop.limit * unit
        if stop.side * (value - limit) > CLOSED_GAP * unit:
            source, name = equations.model.solver.source, names[stop.index]
            keyframes = "" if source is None else "".join(f"--key {key}, " for key in source.keyframes)
            raise InputError(
                f"{equations.model.mechanism.name}: {name} starts at {value:.6g}, beyond its "
                f"stop at {limit:.6g}; start within its range, by "
                f"{keyframes}--initial {name}.q=VALUE or --start JOINT=VALUE"
            )


def require_settings(
    duration: float | None, samples: int, tolerance: float, restitution: float = 0.0, budget: int = BUDGET
) -> None:
    """Raise InputError for invalid settings of a run."""
    if duration is not None and not 0.0 < duration < np.inf:
        raise InputError(f"duration of a run is {duration} s; give a finite number above 0")
    if not budget >= 1:
        raise InputError(f"budget of a run is {budget} states; give at least 1")
    if not samples >= 1:
        raise InputError(f"samples of a run are {samples}; give at least 1")
    if not 0.0 <= restitution <= 1.0:
        raise InputError(f"coefficient of restitution is {restitution}; give 0 to 1")
    if not 1e-14 <= tolerance <= 1e-2:
        raise InputError(f"tolerance of a step is {tolerance}; give 1e-14 to 1e-2")
