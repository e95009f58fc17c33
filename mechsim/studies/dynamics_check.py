"""Comparison of MuJoCo's dynamics with the formulas at the states that the run reached."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.compare.checks import Check, Verdict, check_of, concluded
from mechsim.compare.crosscheck import crosscheck_forces
from mechsim.compare.quantities import ZERO_TORQUE
from mechsim.compare.record_errors import lengths
from mechsim.compare.tolerances import RecordInstants, Tolerance
from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.motion import conditioning_of
from mechsim.kinetics import DynamicModel, DynamicRun, Equilibrium, InverseDynamics, prescribed
from mechsim.kinetics.dynamic_run import RunSegment
from mechsim.kinetics.gaps import released, without_gaps
from mechsim.kinetics.initial_state import InitialValues
from mechsim.kinetics.state_quantities import motion_of
from mechsim.kinetics.statics import with_stops
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion, select_instants
from mechsim.numerics.arrays import EPS, Array, worst
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation.dynamics.forward_run import SteppedRun, start_of
from mechsim.simulation.dynamics.static_state import StaticModel
from mechsim.simulation.mjcf.link_inertias import with_accepted_inertia
from mechsim.simulation.result import Driven

# fewest and most MuJoCo steps for each step of collocation. A pendulum needs 1500 in a period, for which
# collocation needs 5 (validation/published/forward_dynamics.py); a collocation step that loads over time keep
# short needs fewer, and the tolerance with Coulomb friction is reached by fewer.
MIN_STEPS_PER_STEP, MIN_WITH_FRICTION, STEPS_PER_STEP = 20, 2, 300
# number of steps in C for each step of collocation: 2.7 to 5.3 in runs of half a second of four_bar,
# slider_crank, rssr, watt_six_bar, jansen and scotch_yoke. Least number of steps of collocation in a segment:
# the first ones are short in both, 8 to 9 in each segment of a screw between stops
STEPS_IN_C, STEPS_PER_SEGMENT = 4, 8
# largest number of steps of one run, and of compared segments of a run with impacts
MAX_STEPS, MAX_SEGMENTS = 400_000, 8
# distance of eigenvalues in [1/s] that stands for infinite ones and for no number
HUGE = 1e300
# rate of a joint that never moves, in [rad/s] or [m/s]: accelerations of 1e-11 are rounding of weight
REST = 1e-10
# rate of points at rest relative to that of rotations at the size of the mechanism, from rounding
RESTING = 1e-9
# tolerance relative to the largest value, for rounding and the compliance of MuJoCo's constraints; MuJoCo
# models Coulomb friction by a soft constraint
RELATIVE_TOLERANCE, FRICTION_TOLERANCE = 1e-9, 1e-4
# the same for redundant loops, whose constraints are compliant: rates of Bennett's linkage vibrate by 3e-8
COMPLIANT_TOLERANCE = 1e-7
# roundings of a pose in forces, at most: 16 in a pendulum that swings by 1e-6 rad; and those of the loops in
# coordinates, relative to their mean: 1 to 2 in rows of 25 to 200 four-bars that swing by 1e-7 to 1e-6 rad
ROUNDED_POSES, ROUNDED_LOOPS = 64.0, 4.0
# multiple of the tolerance of rounding at which the error of the steps is small enough where limits of
# actuators make forces kinked: there halving a step gains a factor of 2 to 4 instead of 16
KINKED = 100.0
# factor on the compliance of MuJoCo's loops and frictions in another run, where the tolerance of compliance
# and rounding is exceeded: the change shows both errors. In planetary_gear on a spring compliance is 6 times
# a relative 1e-9; slides that stick accelerate by up to 4e-4 of what their friction balances
SOFTER = 10.0
# largest number of instants at which the forces of a file are balanced, and tolerance of the balance: files
# state dimensions with six digits
BALANCED, BALANCE_TOLERANCE = 10, 1e-6
# units of coordinates, and their relative change that is rounding
COORDINATE_UNITS, ROUNDING = ("m", "rad"), 1e-12
# order with which the error is extrapolated if the changes by two halvings of the step show at least this
# order; otherwise the whole change of the last halving counts
HIGH_ORDER = 3.4
# largest error of an equilibrium, in [rad] or sizes, and of accelerations by MuJoCo's soft loops relative to
# those without loops; measured 5e-7 in rack_steering
CONFIGURATION_TOLERANCE = 1e-6
# of an eigenvalue relative to its size, and multiple of the error of MuJoCo's differences, an estimate
EIGENVALUE_TOLERANCE, EIGENVALUE_SAFETY = 1e-6, 4.0
# rounding of an acceleration in [1/s2]
ACCELERATION_ROUNDING = 1e-9
# name and unit of a compared quantity, and its values in each motion
Compared = tuple[str, str, Sequence[Array]]


def crosscheck_driven(
    run: Driven,
    model: DynamicModel,
    *,
    solved: InverseDynamics | None = None,
    progress: Progress = no_progress,
) -> Verdict:
    """Compare a prescribed run with inverse dynamics at its own angles, speeds and accelerations.

    Args:
        run: from `simulation.dynamics.prescribed_motion.driven`.
        model: the analytic side.
        solved: inverse dynamics of the model, which is compared if it is of the instants of the run.
        progress: called with a text and the finished fraction.
    """
    motion = run.motion
    if run.outcome == "diverged" or motion.broken:
        return Verdict("diverged", (), motion.broken or "MuJoCo's state became invalid")
    instants = (motion.angle, motion.speed, motion.acceleration)
    # MuJoCo's model has negligible masses and moments where the mechanism has none
    model = replace(model, mechanism=with_accepted_inertia(model.mechanism))
    if solved is None or run.method == "step" or not _of_instants(solved, model, motion):
        solved = prescribed(model, *instants, time=motion.time, as_run=motion, progress=progress)
    else:
        progress("forces", 1.0)
    conditioning = conditioning_of(model.solver.mechanism, motion)
    return crosscheck_forces(run.forces, solved.forces, method=run.method, conditioning=conditioning)


def _of_instants(solved: InverseDynamics, model: DynamicModel, motion: Motion) -> bool:
    """Return whether inverse dynamics is of the instants of a motion, to rounding, and of its inertias."""
    links = zip(solved.model.mechanism.links, model.mechanism.links, strict=True)
    if any(own.inertia is not other.inertia for own, other in links) or len(solved) != len(motion):
        return False
    forces, fastest = solved.forces, float(np.abs(motion.speed).max())
    scales = 1.0, fastest, max(fastest**2, float(np.abs(motion.acceleration).max()))
    own = forces.angle - motion.angle, forces.speed - motion.speed, forces.acceleration - motion.acceleration
    return all(worst(difference) <= ROUNDING * scale for difference, scale in zip(own, scales, strict=True))


def compared_segments(run: DynamicRun) -> tuple[RunSegment, ...]:
    """Return the segments of a run that are compared with MuJoCo.

    They are the longest without contacts, which are soft in MuJoCo; none if the mechanism never moves, or the
    run ends at its start.
    """
    rates = [joint.rate for joint in run.motion.joints.values()]
    rates += [link.angular_velocity for link in run.motion.links.values()]
    moves = run.time[-1] > 0.0 and any(np.abs(rate).max() > REST for rate in rates)
    free = [each for each in run.segments if not each.touching and _instants(run, each).sum() > 1]
    longest = sorted(free if moves else (), key=lambda segment: segment.first - segment.last)[:MAX_SEGMENTS]
    return tuple(sorted(longest, key=lambda segment: segment.first))


def _instants(run: DynamicRun, segment: RunSegment) -> NDArray[np.bool_]:
    """Return which instants of a run are in a segment, an interval at least from impacts and reversals.

    MuJoCo's Coulomb friction is soft within a few steps of the reversal of a rate.
    """
    interval = run.time[1] - run.time[0]
    after = segment.first + interval if segment != run.segments[0] else 0.0
    before = segment.last - interval if segment != run.segments[-1] else np.inf
    return (run.time >= after) & (run.time <= before)


def crosscheck_forward(
    run: DynamicRun,
    dynamic_model: DynamicModel,
    initial: InitialValues,
    *,
    progress: Progress = no_progress,
) -> Verdict:
    """Compare a run of forward dynamics with MuJoCo, stepped from the start of each compared segment.

    All joints start in MuJoCo at their values of the run, since `initial` may leave some out. MuJoCo runs
    again with half the step until the error is below the rounding that is tolerated, or the step is short
    enough. The changes between the last three runs give the error of the last.

    Args:
        run: of the analytic side.
        dynamic_model: the model of the run.
        initial: its initial values.
        progress: called with a text and the finished fraction of a run in MuJoCo.

    Returns:
        The verdict; "failed" without checks if nothing can be compared.
    """
    dynamic_model = released(dynamic_model)
    segments, checks = compared_segments(run), list(_balance(run, dynamic_model))
    if not (segments or checks):
        reason = "no segment of the run is comparable: nothing moves, stops touch, or all segments are short"
        return Verdict("failed", (), reason)
    for segment in segments:
        rows = _instants(run, segment)
        section = replace(
            run,
            activation=run.activation[:, rows],
            motion=select_instants(run.motion, rows),
            driving={name: effort[rows] for name, effort in run.driving.items()},
        )
        joints = section.motion.joints
        closed = {gap: float(joints[gap].value[0]) for gap in segment.closed}
        mechanism = without_gaps(dynamic_model.mechanism, closed)
        if closed and dynamic_model.forces.clearances:
            mechanism = _guessed_at(mechanism, section.motion)
        model = replace(dynamic_model, mechanism=mechanism)
        compared = _compared_with_mujoco(run, section, segment, model, initial, progress)
        if isinstance(compared, Verdict):
            return compared
        title = f"{segment.first:.4g} to {segment.last:.4g} s" if run.events else ""
        checks += [replace(check, variant=title) for check in compared]
    return concluded(checks)


def _balance(run: DynamicRun, model: DynamicModel) -> Iterator[Check]:
    """Yield the check that a run of an MJCF file has all forces of the file; none with other forces."""
    read = model.solver.source
    if read is None:
        return
    from mechsim.simulation.dynamics.file_balance import has_balance, imbalance

    if not has_balance(read, model.forces):
        return
    rows = np.arange(0, len(run.time), -(-len(run.time) // BALANCED))
    section, time = select_instants(run.motion, rows), run.time[rows]
    # along these, other forces act than those of springs, dampers and actuators
    fixed = {*model.mechanism.locked, *run.driving}
    fixed |= {friction.joint for friction in model.forces.friction if friction.coulomb}
    if run.events or any(segment.touching for segment in run.segments):
        fixed |= {*read.limits}
    errors, largest = imbalance(read, model.forces, section, time, run.activation[:, rows], fixed)
    reason = (
        f"{BALANCE_TOLERANCE:.0e} of the largest force in the file's own model, whose dimensions are rounded"
    )
    tolerance = Tolerance(BALANCE_TOLERANCE * max(largest, _least_torque(run, model)), "N m", reason)
    check = check_of("forces of the file", "", errors, RecordInstants(time, "s"), tolerance)
    yield replace(check, method="balance")


def _guessed_at(mechanism: Mechanism, motion: Motion) -> Mechanism:
    """Return a mechanism with the first poses of a motion as its guess: a pin touches its hole there."""
    poses = {link.name: motion.links[link.name] for link in mechanism.links}
    guess = {name: Pose(link.position[0], link.rotation[0]) for name, link in poses.items()}
    start = float(motion.joints[mechanism.crank.name].value[0]) if mechanism.has_crank else mechanism.start
    return mechanism.with_guess(guess, start)


def _compared_with_mujoco(
    run: DynamicRun,
    section: DynamicRun,
    segment: RunSegment,
    dynamic_model: DynamicModel,
    initial: InitialValues,
    progress: Progress,
) -> list[Check] | Verdict:
    """Return the checks of a section of a run in a segment; a verdict if MuJoCo diverges."""
    # the function: number of steps between two instants -> run in MuJoCo from the section's start
    joints, driving = section.motion.joints, section.driving
    start = start_of(
        dynamic_model.mechanism,
        dynamic_model.forces,
        {name: float(joint.value[0]) for name, joint in joints.items()},
        {name: float(joint.rate[0]) for name, joint in joints.items()},
        kept={*initial.coordinates, *initial.rates, *driving, *dynamic_model.forces.controlled},
        ranges=dynamic_model.solver.ranges,
        links=section.motion.links,
        activation=section.activation[:, 0],
        phases=segment.phases,
    )
    prescribed = {name: dynamic_model.solver.motion_laws.by_name[name] for name in driving}
    times, mechanism = section.time, dynamic_model.mechanism

    def stepped(substeps: int, softer: float = 1.0) -> SteppedRun:
        return start.stepped(times, substeps, None, prescribed, progress, softer)

    intervals = len(run.time) - 1
    least = STEPS_PER_SEGMENT * len(run.segments)
    steps = max(run.steps // STEPS_IN_C, least) if run.executed == "C" else run.steps
    most = min(MAX_STEPS, 2 * STEPS_PER_STEP * steps) // intervals
    rubbing = any(friction.dry for friction in dynamic_model.forces.friction)
    fewest = MIN_WITH_FRICTION if rubbing else MIN_STEPS_PER_STEP
    substeps = max(1, min(most, fewest * steps // intervals))
    coarse, before, gains = stepped(substeps), dict[str, float](), dict[str, float]()
    # tolerance relative to the largest value of a quantity, besides the error of the steps
    floor = COMPLIANT_TOLERANCE if coarse.compliant else RELATIVE_TOLERANCE
    roundings = max(ROUNDED_POSES, ROUNDED_LOOPS * start.loop_rounding())
    floor = max(FRICTION_TOLERANCE if rubbing else floor, EPS * roundings / _displacement(section, mechanism))
    enough = KINKED if any(a.limited for a in dynamic_model.forces.actuators) else 1.0
    while True:
        fine, substeps = stepped(2 * substeps), 2 * substeps
        valid = not (coarse.diverged or fine.diverged)
        # damping of light links limits the step of an explicit method
        finest = 2 * substeps > (most if valid else MAX_STEPS // intervals)
        if valid:
            compared = _forward_quantities(section, mechanism, coarse, fine)
            largest = _largest_values(run, compared, dynamic_model)
            changes = {name: _change(*pair) for name, _, (_, *pair) in compared}
            errors = {name: _remaining(change, before.get(name, 0.0)) for name, change in changes.items()}
            if enough > 1.0:
                # a limit lies anywhere within a step, so that a change may be small by chance
                errors = {name: max(change, before.get(name, np.inf)) for name, change in changes.items()}
            relative = [(unit, changes[name] / largest[unit]) for name, unit, _ in compared if largest[unit]]
            gains |= _gains(relative)
            floors = {unit: floor * gains.get(unit, 1.0) * largest[unit] for unit in largest}
            converged = all(errors[name] <= enough * floors[unit] for name, unit, _ in compared)
            # kinked forces reduce the error too slowly for the halvings that remain
            halvings = np.log2(max(1.0, most / substeps))
            slow = enough > 1.0 and any(
                changes[name] * (changes[name] / before[name]) ** halvings > enough * floors[unit]
                for name, unit, _ in compared
                if before.get(name)
            )
            if converged or finest or slow:
                limits = times, fine.timestep, errors, floors
                checks = [_forward_check(row, *limits) for row in compared]
                soft = coarse if all(each.passed for each in checks) else stepped(substeps // 2, SOFTER)
                if soft is coarse or soft.diverged:
                    return checks
                pairs = _forward_quantities(section, mechanism, soft, coarse)
                soft_changes = {name: _change(*pair) for name, _, (_, *pair) in pairs}
                return [_forward_check(row, *limits, soft_changes) for row in compared]
            before = changes
        if finest:
            reason = (
                f"MuJoCo's state became invalid with steps of {fine.timestep:.3g} s; "
                "give a shorter run, weaker motors and dampers, or --method none"
            )
            return Verdict("diverged", (), reason)
        coarse = fine


def _displacement(run: DynamicRun, mechanism: Mechanism) -> float:
    """Return the largest displacement of a link, in sizes or radians; infinite if nothing moves."""
    length = mechanism.characteristic_length
    largest = max(
        max(
            float(np.abs(link.rotation - link.rotation[0]).max()),
            float(np.abs(link.position - link.position[0]).max()) / length,
        )
        for link in run.motion.links.values()
    )
    return largest or np.inf


def _gains(changes: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Return the relative change of rates, accelerations and forces over that of coordinates, at least 1.

    A shorter step changes the motion by dq, and its accelerations by da = (da/dq) dq + (da/dv) dv, which is
    large for stiff springs and dampers. The tolerance of coordinates, times this gain, is that of the others.

    Args:
        changes: unit of each quantity, and its change by a shorter step relative to the largest value.

    Returns:
        Unit -> gain; empty if coordinates change by rounding.
    """
    largest: dict[str, float] = {}
    for unit, change in changes:
        largest[unit] = max(largest.get(unit, 0.0), change)
    motion = max(largest.get(unit, 0.0) for unit in COORDINATE_UNITS)
    if not motion > ROUNDING:
        return {}
    return {
        unit: max(1.0, change / motion) for unit, change in largest.items() if unit not in COORDINATE_UNITS
    }


def _remaining(change: float, before: float) -> float:
    """Return the error after halving the step: the change, or less if it falls with high order."""
    return change / (2.0**HIGH_ORDER - 1.0) if change * 2.0**HIGH_ORDER <= before else change


def _forward_quantities(
    run: DynamicRun, mechanism: Mechanism, coarse: SteppedRun, fine: SteppedRun
) -> list[Compared]:
    """Return name, unit and values of the quantities of a run and of two runs in MuJoCo."""
    motions = run.motion, coarse.motion, fine.motion
    compared = [*_compared(motions, mechanism, rates_only=fine.compliant)]
    for name, effort in run.driving.items():
        unit = mechanism.effort_unit(name)
        compared.append((f"drive of {name}", unit, [effort, coarse.driving[name], fine.driving[name]]))
    return compared


def _largest_values(
    run: DynamicRun, compared: Iterable[Compared], dynamic_model: DynamicModel
) -> dict[str, float]:
    """Return unit -> largest value in a run of all compared points or joints, since one of them may rest.

    Points that all rest on rotating links have the motions of the rotations at a characteristic length [m],
    and links that do not rotate those of their points over it; rotations and points without acceleration
    have the square of their rates, over the characteristic length.
    """
    length = dynamic_model.mechanism.characteristic_length
    whole = {name: exact for name, _, (exact,) in _compared([run.motion], dynamic_model.mechanism)}
    whole |= {f"drive of {name}": effort for name, effort in run.driving.items()}
    largest: dict[str, float] = {}
    for name, unit, _ in compared:
        largest[unit] = max(largest.get(unit, 0.0), float(np.abs(whole[name]).max()))
    least = _least_torque(run, dynamic_model)
    largest |= {u: max(largest[u], f) for u, f in (("N m", least), ("N", least / length)) if u in largest}
    for rate, acceleration, unit in (("rad/s", "rad/s2", 1.0), ("m/s", "m/s2", length)):
        uniform = largest.get(rate, 0.0) ** 2 / unit
        if largest.get(acceleration, np.inf) < RESTING * uniform:
            largest[acceleration] = uniform
    for points, rotations in (("m", "rad"), ("m/s", "rad/s"), ("m/s2", "rad/s2")):
        rate = length * largest.get(rotations, 0.0)
        rotation = largest.get(points, 0.0) / length
        if points in largest and largest[points] < RESTING * rate:
            largest[points] = rate
        elif rotations in largest and largest[rotations] < RESTING * rotation:
            largest[rotations] = rotation
    return largest


def _least_torque(run: DynamicRun, model: DynamicModel) -> float:
    """Return the torque in [N m] that counts as zero by the kinetic energy and the moments of weights."""
    mass = sum(link.inertia.mass for link in model.mechanism.links if link.inertia)
    moment = mass * np.linalg.norm(model.forces.gravity) * model.mechanism.characteristic_length
    return ZERO_TORQUE * float(run.kinetic.max(initial=0.0) + moment)


def _change(coarse: Array, fine: Array) -> float:
    """Return the largest distance between the values of two runs."""
    difference = (fine - coarse).reshape(len(fine), -1)
    return float(lengths(difference).max())


def _nearest_pairs(distances: Array) -> list[tuple[int, int]]:
    """Return the pairs with the least sum of distances, (m, n); others take the nearest one."""
    from scipy import optimize

    routines: Any = optimize
    rows, columns = routines.linear_sum_assignment(np.fmin(distances, HUGE))
    pairs = list(zip(rows.tolist(), columns.tolist(), strict=True))
    alone = np.setdiff1d(np.arange(len(distances)), rows)
    pairs += [(k, int(distances[k].argmin())) for k in alone.tolist()]
    alone = np.setdiff1d(np.arange(distances.shape[1]), columns)
    return pairs + [(int(distances[:, i].argmin()), i) for i in alone.tolist()]


def crosscheck_equilibrium(equilibrium: Equilibrium, model: DynamicModel) -> Verdict:
    """Compare an equilibrium with MuJoCo at rest in its configuration.

    Args:
        equilibrium: of the analytic side.
        model: the model of the equilibrium.
    """
    linear = equilibrium.linear
    if equilibrium.open:
        model = replace(model, mechanism=linear.equations.model.mechanism)
    index_of = linear.equations.loops.tree.index_of
    coordinates = {name: float(linear.q.values[i, 0]) for name, i in index_of.items()}
    at_rest = linear.equations.kinematics(linear.q, np.zeros((len(linear.q.values), 1)))
    motion = motion_of(linear.equations, at_rest, at_rest.rates, np.zeros(1))
    others = {name: float(joint.value[0]) for name, joint in motion.joints.items() if name not in index_of}
    try:
        state = _static_model(model, tuple(equilibrium.stops.items())).state(
            coordinates, motion.links, others
        )
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    exact = linear.roots.values
    if len(exact) != len(state.eigenvalues):
        reason = f"{len(state.eigenvalues) // 2} degrees of freedom in MuJoCo, {len(exact) // 2} in formulas"
        return Verdict("failed", (), reason)
    still = CONFIGURATION_TOLERANCE * (state.stiffness + state.unconstrained) + ACCELERATION_ROUNDING
    reason = f"effect of {CONFIGURATION_TOLERANCE:.0e} rad or sizes from the equilibrium, and soft loops"
    checks = [_static_check("acceleration at rest", state.accelerations, Tolerance(still, "1/s2", reason))]
    # each eigenvalue is compared once; those of conjugate ones are conjugate
    distances = np.abs(exact[:, None] - state.eigenvalues)
    pairs = sorted(_nearest_pairs(distances), key=lambda pair: abs(exact[pair[0]]))
    upper = [(k, i) for k, i in pairs if exact[k].imag >= 0.0]
    for number, (k, i) in enumerate(upper, start=1):
        error, value = float(distances[k, i]), complex(exact[k])
        checks.append(_eigenvalue_check(f"eigenvalue {number}", error, value, float(state.errors[i])))
    return concluded(checks)


@lru_cache(maxsize=1)
def _static_model(model: DynamicModel, stops: tuple[tuple[str, float], ...]) -> StaticModel:
    """Return a model in MuJoCo under its loads and forces of stops: the last one of the same model."""
    return StaticModel(model.mechanism, with_stops(model.forces, dict(stops)))


def _eigenvalue_check(name: str, error: float, value: complex, uncertainty: float) -> Check:
    """Return the check of an eigenvalue in [1/s], with the bound of MuJoCo's differences."""
    tolerance = EIGENVALUE_TOLERANCE * abs(value) + EIGENVALUE_SAFETY * uncertainty
    reason = (
        f"{EIGENVALUE_SAFETY:g} times the error of MuJoCo's differences and {EIGENVALUE_TOLERANCE:.0e} of it"
    )
    return _static_check(name, np.array([error]), Tolerance(float(tolerance), "1/s", reason))


def _static_check(name: str, errors: Array, tolerance: Tolerance) -> Check:
    return replace(check_of(name, "", np.abs(errors), np.zeros(len(errors)), tolerance), method="pose")


def _compared(
    motions: Sequence[Motion], mechanism: Mechanism, *, rates_only: bool = False
) -> Iterator[Compared]:
    """Yield the quantities that all motions have.

    Links on spherical or floating joints are compared by their rotation, which no coordinate describes.
    With `rates_only`, accelerations are omitted.
    """
    derivatives = 2 if rates_only else 3
    for name in motions[-1].points:
        for what, unit in (("position", "m"), ("velocity", "m/s"), ("acceleration", "m/s2"))[:derivatives]:
            yield f"{what} of {name}", unit, [getattr(motion.points[name], what) for motion in motions]
    ends = (link for joint in mechanism.joints if KINDS[joint.kind].ball for link in joint.links)
    for name in dict.fromkeys(link for link in ends if link != GROUND):
        links = [motion.links[name] for motion in motions]
        # the distance of two rotation matrices is sqrt(2) times the angle between them
        yield f"orientation of {name}", "rad", [link.rotation * np.sqrt(0.5) for link in links]
        yield f"angular velocity of {name}", "rad/s", [link.angular_velocity for link in links]
    for name, joint in motions[-1].joints.items():
        for what, label, unit in (
            ("value", "coordinate", joint.unit),
            ("rate", "rate", f"{joint.unit}/s"),
            ("acceleration", "acceleration", f"{joint.unit}/s2"),
        )[:derivatives]:
            yield f"{label} of {name}", unit, [getattr(motion.joints[name], what) for motion in motions]


def _forward_check(
    row: Compared,
    times: Array,
    timestep: float,
    errors: Mapping[str, float],
    floors: Mapping[str, float],
    soft_changes: Mapping[str, float] | None = None,
) -> Check:
    """Return the check of a quantity, with its change by softer loops where these were tried."""
    name, unit, values = row
    error, floor, compliance_error = errors[name], floors[unit], (soft_changes or {}).get(name, 0.0)
    exact, _, fine = (value.reshape(len(times), -1) for value in values)
    reason = (
        f"{error:.1e} {unit} by halving MuJoCo's step to {timestep:.3g} s, and {floor:.1e} {unit} of "
        f"compliance and rounding{'' if unit in COORDINATE_UNITS else ', as in the coordinates'}"
        + (
            f"; {compliance_error:.1e} {unit} with {SOFTER:g} times the compliance"
            if compliance_error
            else ""
        )
    )
    tolerance = Tolerance(error + floor + compliance_error, unit, reason)
    check = check_of(name, "", lengths(fine - exact), RecordInstants(times, "s"), tolerance)
    return replace(check, method="step")
