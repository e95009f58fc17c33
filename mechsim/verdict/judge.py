"""The judges: two motions, two records of efforts or two free runs to a verdict."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal, Protocol

import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.model.finding import POSITION_TOLERANCE
from mechsim.model.force_record import ForceRecord, FreeRun
from mechsim.model.motion import Motion, PointMotion, Solver
from mechsim.model.motion_laws import MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers, require
from mechsim.verdict.checks import Tolerances, Verdict, checks_of, concluded, tolerances_of
from mechsim.verdict.quantities import (
    DRIVE,
    EFFORTS,
    FREE,
    MOTION,
    PROGRAMMED,
    efforts_scales,
    free_scales,
    motion_scales,
    reach_of,
    stroke_of,
)
from mechsim.verdict.tolerances import Requested, Tolerance, instants_of

PointFunction = Callable[[Array], Mapping[str, Array]]

# central differences of order eight for first and second derivatives, at 0, +-1 ... +-4
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
SPACING = 0.01  # rad: rounding 1e-14 and truncation 1e-16 x (harmonic)^9 balance for smooth motions


def differentiated(function: PointFunction, angle: Array, speed: Array, acceleration: Array) -> Motion:
    """Return the motion of a function's points at crank angles, speeds and accelerations, (n,) each.

    Raises:
        InputError: unless it gives points of the right shape.
    """
    around = [function(angle + k * SPACING) for k in range(-4, 5)]
    points: dict[str, PointMotion] = {}
    if not isinstance(around[4], Mapping):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"the function gives a {type(around[4]).__name__}; give a dictionary from points to places (n, 3)"
        )
    for name in around[4]:
        parts = [numbers(one[name]) for one in around]
        if {part.shape for part in parts} != {(len(angle), 3)}:
            raise InputError(
                f"the function gives point {name!r} of shape {parts[4].shape} for {len(angle)} crank "
                f"angles; give ({len(angle)}, 3)"
            )
        values = np.stack(parts)
        first = np.tensordot(FIRST, values, 1) / SPACING
        second = np.tensordot(SECOND, values, 1) / SPACING**2
        points[name] = PointMotion(
            values[4], first * speed[:, None], second * speed[:, None] ** 2 + first * acceleration[:, None]
        )
    return Motion("user", angle, speed, acceleration, points)


# a simulation this much nearer to another assembly than to the right one is in the other
NEARER = 0.5
# if, in units of the stroke, these are farther apart than that
APART = 0.02
# pairs of records at which that is looked at
MOST_PAIRS = 100


def elsewhere(simulated: Motion, exact: Motion, solver: Solver) -> float | None:
    """Return the instant at which a simulation is first seen in another assembly; None if it is in none.

    The sign that tells assemblies apart is no proof: close to a singular pose rounding turns it, and
    where there are more than two assemblies some share it. So the places decide: at two records in a
    row, with the assemblies well apart, they must be twice as near to another one as to the
    right one. Tried on 1,200 runs past singular poses: validation/robustness/assembly_detector.py.
    """
    angle = instants_of(simulated).value
    listed = getattr(solver, "assembly_points", None)
    if listed is None:
        sign = solver.assembly_sign({name: point.position for name, point in simulated.points.items()})
        wrong = sign < 0.0
        first = np.flatnonzero(wrong[1:] & wrong[:-1])
        return float(angle[first[0]]) if len(first) else None
    far = np.max(list(simulated.position_errors(exact).values()), axis=0)
    pairs = np.unique(np.linspace(0, max(0, len(angle) - 2), MOST_PAIRS).astype(int))
    rows = np.unique(np.clip(np.concatenate([pairs, pairs + 1]), 0, len(angle) - 1))
    apart = np.zeros(len(rows))
    for k, i in enumerate(rows):
        for _, points in listed(float(exact.angle[i])):
            gap = _farthest(points, {name: exact.points[name].position[i] for name in points})
            off = _farthest(points, {name: simulated.points[name].position[i] for name in points})
            apart[k] = max(apart[k], gap if off < NEARER * far[i] else 0.0)
    wrong = apart > APART * stroke_of(exact)
    first = np.flatnonzero(wrong[1:] & wrong[:-1])
    return float(angle[rows[first[0]]]) if len(first) else None


def _farthest(points: Mapping[str, Array], others: Mapping[str, Array]) -> float:
    return max(float(np.linalg.norm(points[name] - other)) for name, other in others.items())


class Judged(Protocol):
    """A run in MuJoCo: a motion, and the bound on its places in [m] by which it calls itself passed."""

    @property
    def motion(self) -> Motion: ...

    @property
    def tolerance(self) -> float: ...


def crosscheck(
    simulated: Motion | Judged,
    analytic: Motion | Solver | PointFunction,
    *,
    tolerance: float | None = None,
    bounds: Tolerances | None = None,
    speed: float | None = None,
) -> Verdict:
    """Compare a simulated motion with an analytic one, at the crank angles the simulation really had.

    Args:
        simulated: a run from `simulate`, which if stepped is judged by its own tolerance, or any motion.
        analytic: a closed form, a motion it gave (it is then solved again at the simulated crank
            angles and speeds), or a function crank angles (n,) -> {point: (n, 3)}, whose rates come
            by eighth-order differences. A motion nothing can solve again must stand at the same angles.
        tolerance: bound on the place of any point, in [m]; None takes the run's, or 1e-4 of the stroke for
            a stepped motion, and rounding for solved poses.
        bounds: bounds that replace those of `quantities`, by name ("position", "velocity", ...).
        speed: crank speed that was wanted, in [rad/s]; None takes the analytic motion's, if steady.

    Returns:
        The verdict. An error of the drive stands on lines of its own. Bounds hold instant by instant: they
        widen where the loops are poorly conditioned, as errors of any computed motion do there.
    """
    found, tolerance = _taken(simulated, tolerance)
    if not (isinstance(analytic, Motion) or hasattr(analytic, "solve") or callable(analytic)):
        raise InputError(
            f"the analytic side is of type {type(analytic).__name__}; give a motion or a function"
        )
    if len(found) == 0:
        raise InputError("the simulated motion has no instants; give at least one")
    if found.drivers:
        # what its clock does is no crank's
        speed = None
    elif speed is None and isinstance(analytic, Motion) and np.ptp(analytic.speed) == 0.0:
        speed = float(analytic.speed[0])
    if found.broken:
        return Verdict("diverged", (), found.broken)
    if not _finite(found):
        return Verdict("diverged", (), "the simulated motion holds numbers that are not finite")
    try:
        exact = _at(found, analytic)
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    _require_points(found, exact)
    solver = _solver(analytic)
    allowed = _motion_bounds(found, exact, tolerance) | dict(bounds or {})
    checks = [*checks_of(MOTION, found, exact, allowed, _conditioning(found, exact, solver))]
    if speed is not None:
        checks += checks_of(DRIVE, found, _wanted(found, speed), allowed)
    motion_laws = getattr(solver, "motion_laws", None)
    if found.drivers and isinstance(motion_laws, MotionLaws):
        checks += checks_of(PROGRAMMED, found, _programmed(found, motion_laws), allowed)
    other = None if solver is None else lambda: elsewhere(found, exact, solver)
    return concluded(checks, other, instants_of(found).unit)


def judge_efforts(
    found: ForceRecord,
    exact: ForceRecord,
    *,
    method: Literal["pose", "step"],
    tolerance: float | None = None,
    bounds: Tolerances | None = None,
    conditioning: Array | None = None,
) -> Verdict:
    """Compare the efforts of a prescribed crank with the true ones at the same angles, speeds and instants.

    Args:
        found: what is judged.
        exact: what it should be.
        method: how it was found: "pose" or "step".
        tolerance: that a stepped run was asked to keep, as a part; None where it was asked nothing.
        bounds: bounds that replace those of `EFFORTS`, by name; parts of the scale where their unit is "1".
        conditioning: of the loops at each instant, (n,), by which bounds widen; None where it is not known.

    Returns:
        The verdict. Forces are relative to the largest root mean square of any joint's force, moments
        to that times the mechanism's size, torque and energies to their own. Components that rigid
        links do not determine are left out, and so are forces at instants where a joint with dry
        friction stands still, and the torque where the crank does.
    """
    asked = Requested() if tolerance is None else Requested(tolerance)
    by = "asked" if tolerance is not None else method
    allowed = tolerances_of(EFFORTS, by, efforts_scales(exact), asked, bounds)
    return concluded(checks_of(EFFORTS, found, exact, allowed, conditioning))


def judge_free_run(
    found: FreeRun, exact: FreeRun, *, tolerance: float | None = None, bounds: Tolerances | None = None
) -> Verdict:
    """Compare a free run with the true one from the same start, at the same instants.

    Args:
        found: what is judged.
        exact: what it should be; one that ends earlier is told as such.
        tolerance: on the crank angle in [rad], that the run was asked to keep; None where none was.
        bounds: bounds that replace those of `FREE`, by name; parts of the scale where their unit is "1".

    Raises:
        InputError: for a run of fewer than two instants.
    """
    if found.outcome == "diverged":
        return Verdict("diverged", (), found.reason)
    if len(found) < 2:
        raise InputError("a free run of fewer than two instants says nothing; run it longer")
    if len(exact) < len(found):
        why = f"the reduced equation ends after {exact.time[-1]:.6g} s: {exact.reason}"
        return Verdict("failed", (), why)
    turns = float(np.ptp(exact.angle)) / (2.0 * np.pi)
    by = "step" if tolerance is None else "asked"
    allowed = tolerances_of(FREE, by, free_scales(exact), Requested(tolerance or 0.0, turns=turns), bounds)
    return concluded(checks_of(FREE, found, exact, allowed))


def _taken(simulated: Motion | Judged, tolerance: float | None) -> tuple[Motion, float | None]:
    """Return the motion to be judged, and the bound on its places if there is one."""
    motion = simulated if isinstance(simulated, Motion) else getattr(simulated, "motion", simulated)
    require("the simulated side", motion, Motion)
    assert isinstance(motion, Motion)
    if tolerance is None and not isinstance(simulated, Motion) and motion.source != "pose":
        tolerance = simulated.tolerance
    return motion, tolerance


def _motion_bounds(simulated: Motion, exact: Motion, tolerance: float | None) -> dict[str, Tolerance]:
    stroke, reach, fastest = stroke_of(exact), reach_of(exact), float(np.abs(simulated.speed).max())
    quickest = _quickest(exact, reach)
    rows, scales = (*MOTION, *DRIVE, *PROGRAMMED), motion_scales(stroke, fastest, reach, quickest)
    road = "pose" if simulated.source == "pose" and tolerance is None else "step"
    asked = Requested(POSITION_TOLERANCE * stroke if tolerance is None else tolerance, of=stroke)
    allowed = tolerances_of(rows, road, scales, asked)
    if exact.source == "user":
        rough = tolerances_of(rows, "function", motion_scales(reach, fastest, reach, quickest), Requested())
        allowed |= {name: most for name, most in rough.items() if most.value > allowed[name].value}
    return allowed


def _conditioning(simulated: Motion, exact: Motion, solver: Solver | None) -> Array | None:
    """Return the conditioning of the loops at each instant by the exact side, or else by the simulation."""
    told = getattr(solver, "conditioning", None)
    if exact.conditioning is None and told is not None and exact.links:
        return told(exact)
    return simulated.conditioning if exact.conditioning is None else exact.conditioning


def _wanted(simulated: Motion, speed: float) -> Motion:
    """Return the crank's motion as it was wanted, at a constant speed from where it began."""
    time = simulated.time
    angle = simulated.angle if time is None else simulated.angle[0] + speed * (time - time[0])
    return replace(simulated, angle=angle, speed=np.full_like(angle, speed))


def _programmed(simulated: Motion, motion_laws: MotionLaws) -> Motion:
    """Return the drivers' motion as their programs have it."""
    assert simulated.time is not None
    states = dict(
        zip(motion_laws.drivers, np.moveaxis(np.array(motion_laws.state(simulated.time)), 1, 0), strict=True)
    )
    joints = {
        name: replace(simulated.joints[name], value=value, rate=rate, acceleration=second)
        for name, (value, rate, second) in states.items()
        if name in simulated.drivers
    }
    return replace(simulated, joints={**simulated.joints, **joints})


def _quickest(exact: Motion, reach: float) -> float:
    """Return the largest acceleration of the crank, or of any driver under programs, in [rad/s2]."""
    found = [float(np.abs(exact.acceleration).max())]
    for name in exact.drivers:
        joint = exact.joints[name]
        found.append(float(np.abs(joint.acceleration).max()) / (1.0 if joint.unit == "rad" else reach))
    return max(found)


def _solver(analytic: Motion | Solver | PointFunction) -> Solver | None:
    if isinstance(analytic, Motion):
        return analytic.origin
    return analytic if hasattr(analytic, "solve") else None  # pyright: ignore[reportReturnType]


def _require_points(simulated: Motion, exact: Motion) -> None:
    """Raise InputError unless every point of the analytic side is simulated, and known everywhere."""
    missing = sorted(set(exact.points) - set(simulated.points))
    if missing or not exact.points:
        raise InputError(
            f"the simulation has no point {', '.join(missing)} (it has {', '.join(simulated.points)}); "
            "name a site of the model like each point of the analytic side"
            if missing
            else f"the analytic side gives no point; give one or more of {', '.join(simulated.points)}"
        )
    for name, point in exact.points.items():
        known = np.isfinite(point.position).all(1)
        if not known.all():
            raise InputError(
                f"the analytic side gives no finite place for point {name!r} at "
                f"{_called(simulated, int(np.argmin(known)))}; give one at every instant simulated"
            )


def _called(motion: Motion, row: int) -> str:
    """Return what an instant of a motion is called."""
    instants = instants_of(motion)
    value = instants.value[row]
    return f"crank angle {value:.6g} rad" if instants.unit == "rad" else f"t = {value:.6g} s"


def _at(simulated: Motion, analytic: Motion | Solver | PointFunction) -> Motion:
    """Return the analytic motion at the simulated crank angles, speeds and accelerations."""
    solver = _solver(analytic)
    if solver is not None:
        motion_laws = getattr(solver, "motion_laws", None)
        if motion_laws is not None and not simulated.drivers:
            raise InputError(
                f"motion laws drive {', '.join(motion_laws.drivers)} on the analytic side, and a crank at a "
                "given speed drives the simulated one; simulate it under the same motion laws"
            )
        if motion_laws is not None:
            as_driven = getattr(solver, "solve_as", None)
            return solver.solve(t=simulated.time) if as_driven is None else as_driven(simulated)
        return solver.solve(*_crank_motion(simulated))
    if isinstance(analytic, Motion):
        _require_same_instants(simulated, analytic)
        return analytic
    assert callable(analytic)
    return differentiated(analytic, *_crank_motion(simulated))


def _crank_motion(simulated: Motion) -> tuple[Array, Array, Array]:
    """Return crank angles, speeds and accelerations of a motion, also where a motion law drives the crank.

    Raises:
        InputError: where motion laws drive anything but one revolute joint.
    """
    if not simulated.drivers:
        return simulated.angle, simulated.speed, simulated.acceleration
    crank = simulated.joints[simulated.drivers[0]]
    if len(simulated.drivers) > 1 or crank.unit != "rad":
        raise InputError(
            f"motion laws drive {', '.join(simulated.drivers)} in the simulation, and the analytic side "
            "knows crank angles only; give a mechanism under the same laws, or use ms.validate"
        )
    return crank.value, crank.rate, crank.acceleration


def _require_same_instants(simulated: Motion, analytic: Motion) -> None:
    """Raise InputError unless two motions are at the same crank angles, or times under motion laws."""
    found, given, what = simulated.angle, analytic.angle, "crank angles"
    if simulated.drivers and simulated.time is not None and analytic.time is not None:
        found, given, what = simulated.time, analytic.time, "times"
    if given.shape != found.shape or not np.allclose(given, found, rtol=0.0, atol=1e-12):
        raise InputError(
            f"the analytic motion stands at other {what} than the simulated one and nothing can solve it "
            f"again; give it at the simulated {what}, or give the function itself"
        )


def _finite(motion: Motion) -> bool:
    arrays = [motion.angle, motion.speed, motion.acceleration]
    for point in motion.points.values():
        arrays += [point.position, point.velocity, point.acceleration]
    return all(bool(np.isfinite(array).all()) for array in arrays)
