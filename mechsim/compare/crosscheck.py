"""Comparisons of two motions or two force records; each returns a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, Protocol

import numpy as np

from mechsim.compare import quantities
from mechsim.compare.checks import Tolerances, Verdict, checks_of, concluded, tolerances_of
from mechsim.compare.quantities import CRANK_DRIVE, DRIVERS, FORCES, MOTION, force_scales, stroke_of
from mechsim.compare.tolerances import Requested, Tolerance, instants_of
from mechsim.errors import AssemblyError, InputError, first_names
from mechsim.mechanism.finding import POSITION_TOLERANCE
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.motion import Motion, Solver
from mechsim.mechanism.motion_laws import CRANK, MotionLaws
from mechsim.numerics.arrays import REVOLUTION, Array, require, unique

# a simulation is in another assembly mode if its distance from that mode is below this fraction of its
# distance from its own (validation/robustness/assembly_detector.py)
MAX_DISTANCE_RATIO = 0.5
# smallest distance of two assembly modes that are distinguished, relative to the stroke
MIN_ASSEMBLY_DISTANCE = 0.02
# largest number of pairs of consecutive records that are checked
MAX_PAIRS = 100


def elsewhere(simulated: Motion, exact: Motion, solver: Solver) -> float | None:
    """Return the first instant at which a simulation is in another assembly mode; None if it never is.

    The sign of the assembly mode is not sufficient: rounding flips it near a singular pose, and more than two
    modes can share a sign. Positions decide: at two consecutive records, with the modes well separated, the
    simulation must be twice as close to another mode as to its own. Measured on 1,200 runs past singular
    poses: validation/robustness/assembly_detector.py.
    """
    angle = instants_of(simulated).value
    listed = getattr(solver, "assembly_points", None)
    if listed is None:
        sign = solver.assembly_sign({name: point.position for name, point in simulated.points.items()})
        wrong = sign < 0.0
        first = np.flatnonzero(wrong[1:] & wrong[:-1])
        return float(angle[first[0]]) if len(first) else None
    distance = np.max(list(simulated.position_errors(exact).values()), axis=0)
    pairs = unique(np.linspace(0, max(0, len(angle) - 2), MAX_PAIRS).astype(int))
    rows = unique(np.clip(np.concatenate([pairs, pairs + 1]), 0, len(angle) - 1))
    apart = np.zeros(len(rows))
    for k, i in enumerate(rows):
        for _, points in listed(float(exact.angle[i])):
            gap = _farthest(points, {name: exact.points[name].position[i] for name in points})
            difference = _farthest(points, {name: simulated.points[name].position[i] for name in points})
            apart[k] = max(apart[k], gap if difference < MAX_DISTANCE_RATIO * distance[i] else 0.0)
    wrong = apart > MIN_ASSEMBLY_DISTANCE * stroke_of(exact)
    first = np.flatnonzero(wrong[1:] & wrong[:-1])
    return float(angle[rows[first[0]]]) if len(first) else None


def _farthest(points: Mapping[str, Array], others: Mapping[str, Array]) -> float:
    return max(float(np.linalg.norm(points[name] - other)) for name, other in others.items())


class RunWithTolerance(Protocol):
    """A run in MuJoCo with its motion and its position tolerance in [m]."""

    @property
    def motion(self) -> Motion: ...

    @property
    def tolerance(self) -> float: ...


def crosscheck(
    simulated: Motion | RunWithTolerance,
    analytic: Motion | Solver,
    *,
    tolerance: float | None = None,
    bounds: Tolerances | None = None,
    speed: float | None = None,
    assemblies: Solver | None = None,
) -> Verdict:
    """Compare a simulated motion with an analytic one, at the crank angles of the simulation.

    Args:
        simulated: a run of `simulate`, which has a tolerance if stepped, or any motion.
        analytic: a closed form, or a motion of one, which is solved again at the simulated crank angles and
            speeds. A motion without a solver must have the same angles.
        tolerance: of the position of any point, in [m]; the default is the tolerance of the run, or 1e-4 of
            the stroke for a stepped motion, and rounding for solved poses.
        bounds: tolerances that replace those of `quantities`, by name ("position", "velocity", ...).
        speed: requested crank speed, in [rad/s]; the default is the constant speed of the analytic motion.
        assemblies: solver that has all assembly modes; None takes that of the analytic side.

    Returns:
        The verdict. The error of the drive has separate checks. Tolerances apply to each instant; they are
        wider where the loops are poorly conditioned, as the errors of any computed motion are.
    """
    motion, tolerance = _motion_and_tolerance(simulated, tolerance)
    if not (isinstance(analytic, Motion) or hasattr(analytic, "solve")):
        raise InputError(
            f"the analytic side is of type {type(analytic).__name__}; give a motion or a solver; "
            "ms.validate(model, against=FUNCTION) compares a formula"
        )
    if len(motion) == 0:
        raise InputError("the simulated motion has no instants; give at least one")
    if motion.drivers:
        # a path parameter is no crank angle
        speed = None
    elif speed is None and isinstance(analytic, Motion) and np.ptp(analytic.speed) == 0.0:
        speed = float(analytic.speed[0])
    if motion.broken:
        return Verdict("diverged", (), motion.broken)
    if not _finite(motion):
        return Verdict("diverged", (), "the simulated motion contains numbers that are not finite")
    try:
        exact = _analytic_motion(motion, analytic)
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    _require_points(motion, exact)
    solver = _solver(analytic)
    allowed = _motion_tolerances(motion, exact, tolerance) | dict(bounds or {})
    checks = [*checks_of(MOTION, motion, exact, allowed, _conditioning(motion, exact, solver))]
    if speed is not None:
        # a constant speed from the first angle
        time = motion.time
        angle = motion.angle if time is None else motion.angle[0] + speed * (time - time[0])
        steady = replace(motion, angle=angle, speed=np.full_like(angle, speed))
        checks += checks_of(CRANK_DRIVE, motion, steady, allowed)
    motion_laws = getattr(solver, "motion_laws", CRANK)
    if motion.drivers and not motion_laws.crank:
        checks += checks_of(DRIVERS, motion, _under_motion_laws(motion, motion_laws), allowed)
    assembled = assemblies or solver
    other = None if assembled is None else lambda: elsewhere(motion, exact, assembled)
    return concluded(checks, other, instants_of(motion).unit)


def crosscheck_forces(
    computed: ForceRecord,
    exact: ForceRecord,
    *,
    method: Literal["pose", "step"],
    conditioning: Array | None = None,
) -> Verdict:
    """Compare the forces of a run under prescribed motion with the exact forces at the same states.

    Args:
        computed: the record to check.
        exact: the reference record.
        method: method of the computed record: "pose" or "step".
        conditioning: conditioning of the loops at each instant, (n,), which widens tolerances; None if
            unknown.

    Returns:
        The verdict. The scale of forces is the largest root mean square of any joint's force, that of moments
        is this force times the characteristic length; torque and energies have their own. Components that
        rigid links do not determine are left out, and so are forces at instants where a joint with Coulomb
        friction stands still, and the torque if the crank does.
    """
    allowed = tolerances_of(FORCES, method, force_scales(exact), Requested())
    return concluded(checks_of(FORCES, computed, exact, allowed, conditioning))


def _motion_and_tolerance(
    simulated: Motion | RunWithTolerance, tolerance: float | None
) -> tuple[Motion, float | None]:
    """Return the motion to compare, and its position tolerance or None."""
    motion = simulated if isinstance(simulated, Motion) else getattr(simulated, "motion", simulated)
    require("the simulated side", motion, Motion)
    assert isinstance(motion, Motion)
    if tolerance is None and not isinstance(simulated, Motion) and motion.source != "pose":
        tolerance = simulated.tolerance
    return motion, tolerance


def _motion_tolerances(simulated: Motion, exact: Motion, tolerance: float | None) -> dict[str, Tolerance]:
    stroke, reach = stroke_of(exact), quantities.reach_of(exact)
    fastest = float(np.abs(simulated.speed).max())
    quickest = quantities.largest_acceleration(exact, reach)
    rows = (*MOTION, *CRANK_DRIVE, *DRIVERS)
    method = "pose" if simulated.source == "pose" and tolerance is None else "step"
    # poses have the rounding of angles: of the largest angle of a joint, at least one revolution
    turning = [joint.value for joint in exact.joints.values() if joint.unit == "rad" and method == "pose"]
    revolutions = max([1.0, *(float(np.abs(angle).max(initial=0.0)) / REVOLUTION for angle in turning)])
    scales = quantities.motion_scales(stroke, fastest, reach, quickest, revolutions)
    requested = Requested(POSITION_TOLERANCE * stroke if tolerance is None else tolerance, scale=stroke)
    return tolerances_of(rows, method, scales, requested)


def _conditioning(simulated: Motion, exact: Motion, solver: Solver | None) -> Array | None:
    """Return the conditioning of the loops at each instant, the least of both: each has errors by its own.

    It depends on the coordinates: of one Bennett linkage the least is 0.031 by a tree and 0.0097 by links.
    """
    by_poses = getattr(solver, "conditioning", None)
    if exact.conditioning is None and by_poses is not None and exact.links:
        return by_poses(exact)
    conditionings = [motion.conditioning for motion in (simulated, exact) if motion.conditioning is not None]
    return np.min(conditionings, axis=0) if conditionings else None


def _under_motion_laws(simulated: Motion, motion_laws: MotionLaws) -> Motion:
    """Return the motion of the drivers by their motion laws."""
    assert simulated.time is not None
    states = zip(motion_laws.drivers, *motion_laws.state(simulated.time), strict=True)
    joints = {
        name: replace(simulated.joints[name], value=value, rate=rate, acceleration=second)
        for name, value, rate, second in states
        if name in simulated.drivers
    }
    return replace(simulated, joints={**simulated.joints, **joints})


def _solver(analytic: Motion | Solver) -> Solver | None:
    return analytic.origin if isinstance(analytic, Motion) else analytic


def _require_points(simulated: Motion, exact: Motion) -> None:
    """Raise InputError unless the simulation has all analytic points, and all are finite at every instant."""
    missing = sorted(set(exact.points) - set(simulated.points))
    if missing or not exact.points:
        raise InputError(
            f"the simulation has no point {', '.join(missing)} (it has {first_names(simulated.points)}); "
            "name a site of the model like each point of the analytic motion"
            if missing
            else f"the analytic motion has no point; give one or more of {first_names(simulated.points)}"
        )
    instants = instants_of(simulated)
    for name, point in exact.points.items():
        finite = np.isfinite(point.position).all(1)
        if not finite.all():
            value = instants.value[int(np.argmin(finite))]
            label = f"crank angle {value:.6g} rad" if instants.unit == "rad" else f"t = {value:.6g} s"
            raise InputError(
                f"the analytic motion has no finite position of point {name!r} at {label}; give one at every "
                "simulated instant"
            )


def _analytic_motion(simulated: Motion, analytic: Motion | Solver) -> Motion:
    """Return the analytic motion at the simulated crank angles, speeds and accelerations."""
    solver = _solver(analytic)
    if solver is not None:
        motion_laws = getattr(solver, "motion_laws", CRANK)
        if not motion_laws.crank and not simulated.drivers:
            raise InputError(
                f"motion laws drive {', '.join(motion_laws.drivers)} in the analytic motion, and a crank at "
                "a constant speed drives the simulated one; simulate it under the same motion laws"
            )
        if not motion_laws.crank:
            as_driven = getattr(solver, "solve_as", None)
            return solver.solve(t=simulated.time) if as_driven is None else as_driven(simulated)
        return solver.solve(*_crank_motion(simulated))
    assert isinstance(analytic, Motion)
    # the same crank angles, or times under motion laws
    needed, available, label = simulated.angle, analytic.angle, "crank angles"
    if simulated.drivers and simulated.time is not None and analytic.time is not None:
        needed, available, label = simulated.time, analytic.time, "times"
    if available.shape != needed.shape or not np.allclose(available, needed, rtol=0.0, atol=1e-12):
        raise InputError(
            f"the analytic motion has other {label} than the simulated one and no solver; "
            f"give it at the simulated {label}"
        )
    return analytic


def _crank_motion(simulated: Motion) -> tuple[Array, Array, Array]:
    """Return crank angles, speeds and accelerations of a motion, also under a motion law of the crank.

    Raises:
        InputError: if motion laws drive anything but one revolute joint.
    """
    if not simulated.drivers:
        return simulated.angle, simulated.speed, simulated.acceleration
    crank = simulated.joints[simulated.drivers[0]]
    if len(simulated.drivers) > 1 or crank.unit != "rad":
        raise InputError(
            f"motion laws drive {', '.join(simulated.drivers)} in the simulation, and the analytic motion "
            "depends on a crank angle; give a mechanism under the same laws, or use ms.validate"
        )
    return crank.value, crank.rate, crank.acceleration


def _finite(motion: Motion) -> bool:
    arrays = [motion.angle, motion.speed, motion.acceleration]
    for point in motion.points.values():
        arrays += [point.position, point.velocity, point.acceleration]
    return all(bool(np.isfinite(array).all()) for array in arrays)
