"""Two motions to a verdict: worst error, where, against a bound with a reason."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.maths.given import numbers, require
from mechsim.model.motion import Motion, PointMotion, Solver
from mechsim.model.outcome import Outcome
from mechsim.verdict import tolerances
from mechsim.verdict.tolerances import Tolerance

Array = NDArray[np.float64]
PointFunction = Callable[[Array], Mapping[str, Array]]

# default bound on place, in units of the stroke: a twentieth of what a link 0.1 % long does
DEFAULT_PLACE = 1e-4
# a simulation this much nearer to another assembly than to the right one is in the other
NEARER = 0.5
# if, in units of the stroke, these are farther apart than that
APART = 0.02
# pairs of records at which that is looked at
MOST_PAIRS = 100


# over the cells of checks
HEAD = ("quantity", "worst", "at [rad]", "bound", "unit", "", "why")


@dataclass(frozen=True, slots=True)
class Check:
    """One quantity of a verdict.

    Attributes:
        quantity: what was compared.
        unit: of worst, rms and bound.
        worst: largest error.
        at_angle: crank angle of the largest error, in [rad].
        rms: root mean square of the error over the run.
        bound: largest error allowed.
        why: reason for the bound.
    """

    quantity: str
    unit: str
    worst: float
    at_angle: float
    rms: float
    bound: float
    why: str

    @property
    def passed(self) -> bool:
        """Whether the worst error is within the bound; NaN is not."""
        return self.worst <= self.bound

    @property
    def cells(self) -> tuple[str, str, str, str, str, str, str]:
        """The check as a row of a table under `HEAD`."""
        numbers = f"{self.worst:.2e}", f"{self.at_angle:.4f}", f"{self.bound:.1e}"
        return self.quantity, *numbers, self.unit, "met" if self.passed else "MISSED", self.why

    def as_dict(self) -> dict[str, Any]:
        """Return the check as plain data."""
        names = ("quantity", "unit", "worst", "at_angle", "rms", "bound", "why")
        return {name: getattr(self, name) for name in names} | {"passed": self.passed}

    def __str__(self) -> str:
        relation = "<=" if self.passed else "> " if self.worst == self.worst else "? "
        return (
            f"{self.quantity:<34} {self.worst:9.2e} {relation} {self.bound:8.1e} {self.unit:<6} "
            f"at {self.at_angle:7.4f} rad  ({self.why})"
        )


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a comparison came to; print it to see the table.

    Attributes:
        outcome: one of "met", "missed", "diverged", "changed assembly", "cannot assemble".
        checks: quantity by quantity.
        reason: one sentence where the outcome is not "met".
    """

    outcome: Outcome
    checks: tuple[Check, ...]
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether every quantity is within its bound."""
        return self.outcome == "met"

    def __str__(self) -> str:
        head = self.outcome if not self.reason else f"{self.outcome}: {self.reason}"
        return "\n".join([head, *(f"  {check}" for check in self.checks)])

    __repr__ = __str__


def crosscheck(
    simulated: Motion,
    analytic: Motion | Solver | PointFunction,
    *,
    tolerance: float | None = None,
    bounds: Mapping[str, Tolerance] | None = None,
    speed: float | None = None,
) -> Verdict:
    """Compare a simulated motion with an analytic one, at the crank angles the simulation really had.

    Args:
        simulated: from `simulate`, or any motion.
        analytic: a closed form, a motion it gave (it is then solved again at the simulated crank
            angles and speeds), or a function crank angles (n,) -> {point: (n, 3)}, whose rates come
            by eighth-order differences. A motion nothing can solve again must stand at the same angles.
        tolerance: bound on the place of any point, in [m]; None takes 1e-4 of the stroke for a
            stepped run and rounding for solved poses.
        bounds: bounds that replace those of `tolerances`, by kind ("position", "velocity", ...).
        speed: crank speed that was wanted, in [rad/s]; None takes the analytic motion's, if steady.

    Returns:
        The verdict. An error of the drive stands on lines of its own.
    """
    require("the simulated side", simulated, Motion)
    if not (isinstance(analytic, Motion) or hasattr(analytic, "solve") or callable(analytic)):
        raise InputError(
            f"the analytic side is of type {type(analytic).__name__}; give a motion or a function"
        )
    if len(simulated) == 0:
        raise InputError("the simulated motion has no instants; give at least one")
    if speed is None and isinstance(analytic, Motion) and np.ptp(analytic.speed) == 0.0:
        speed = float(analytic.speed[0])
    if simulated.broken:
        return Verdict("diverged", (), simulated.broken)
    if not _finite(simulated):
        return Verdict("diverged", (), "the simulated motion holds numbers that are not finite")
    solver = _solver(analytic)
    try:
        exact = _at(simulated, analytic, solver)
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    _require_points(simulated, exact)
    stroke = _stroke(exact)
    fastest = float(np.abs(simulated.speed).max())
    allowed = dict(_bounds(simulated, tolerance, stroke, fastest))
    if exact.source == "user":
        rough = tolerances.for_differences(_reach(exact), fastest)
        allowed |= {kind: most for kind, most in rough.items() if most.bound > allowed[kind].bound}
    allowed |= dict(bounds or {})
    checks = tuple(_checks(simulated, exact, allowed, speed))
    failed = [check for check in checks if not check.passed]
    if not failed:
        return Verdict("met", checks)
    where = None if solver is None else _elsewhere(simulated, exact, solver)
    if where is not None:
        return Verdict("changed assembly", checks, f"first seen at crank angle {where:.4f} rad")
    if not all(check.worst == check.worst for check in checks):
        return Verdict("diverged", checks, "an error is not a number")
    names = ", ".join(f"{check.quantity} by {check.worst / check.bound:.3g} times" for check in failed[:3])
    more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
    return Verdict("missed", checks, f"beyond the bound: {names}{more}")


def _solver(analytic: Motion | Solver | PointFunction) -> Solver | None:
    if isinstance(analytic, Motion):
        return analytic.origin
    return analytic if hasattr(analytic, "solve") else None  # pyright: ignore[reportReturnType]


def _elsewhere(simulated: Motion, exact: Motion, solver: Solver) -> float | None:
    """Return the crank angle at which a simulation is first seen in another assembly; None if it is in none.

    The sign that tells assemblies apart is no proof: close to a singular pose rounding turns it, and
    where there are more than two assemblies some share it. So the places decide: at two records in a
    row, with the assemblies well apart, they must be twice as near to another one as to the
    right one. Tried on 1,200 runs past singular poses: validation/robustness/assembly_detector.py.
    """
    angle = simulated.angle
    listed = getattr(solver, "assembly_points", None)
    if listed is None:
        sign = solver.assembly_sign({name: point.position for name, point in simulated.points.items()})
        wrong = sign < 0.0
        first = np.flatnonzero(wrong[1:] & wrong[:-1])
        return float(angle[first[0]]) if len(first) else None
    far = np.max(list(simulated.place_errors(exact).values()), axis=0)
    pairs = np.unique(np.linspace(0, max(0, len(angle) - 2), MOST_PAIRS).astype(int))
    rows = np.unique(np.clip(np.concatenate([pairs, pairs + 1]), 0, len(angle) - 1))
    apart, nearer = np.zeros(len(rows)), np.zeros(len(rows), dtype=np.bool_)
    for k, i in enumerate(rows):
        for _, points in listed(float(angle[i])):
            gap = _farthest(points, {name: exact.points[name].position[i] for name in points})
            off = _farthest(points, {name: simulated.points[name].position[i] for name in points})
            apart[k] = max(apart[k], gap if off < NEARER * far[i] else 0.0)
            nearer[k] |= bool(off < NEARER * far[i])
    wrong = nearer & (apart > APART * _stroke(exact))
    first = np.flatnonzero(wrong[1:] & wrong[:-1])
    return float(angle[rows[first[0]]]) if len(first) else None


def _farthest(points: Mapping[str, Array], others: Mapping[str, Array]) -> float:
    return max(float(np.linalg.norm(points[name] - other)) for name, other in others.items())


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
                f"the analytic side gives no finite place for point {name!r} at crank angle "
                f"{simulated.angle[np.argmin(known)]:.6g} rad; give one at every angle simulated"
            )


def _at(simulated: Motion, analytic: Motion | Solver | PointFunction, solver: Solver | None) -> Motion:
    """Return the analytic motion at the simulated crank angles, speeds and accelerations."""
    if solver is not None:
        return solver.solve(simulated.angle, simulated.speed, simulated.acceleration)
    if isinstance(analytic, Motion):
        same = analytic.angle.shape == simulated.angle.shape and np.allclose(
            analytic.angle, simulated.angle, rtol=0.0, atol=1e-12
        )
        if not same:
            raise InputError(
                "the analytic motion stands at other crank angles than the simulated one and nothing can "
                "solve it again; give it at the simulated angles, or give the function itself"
            )
        return analytic
    assert callable(analytic)
    return _differentiated(analytic, simulated)


# central differences of order eight for first and second derivatives, at 0, +-1 ... +-4
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
SPACING = 0.01  # rad: rounding 1e-14 and truncation 1e-16 x (harmonic)^9 balance for smooth motions


def _differentiated(function: PointFunction, simulated: Motion) -> Motion:
    angle, speed, pull = simulated.angle, simulated.speed[:, None], simulated.acceleration[:, None]
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
        points[name] = PointMotion(values[4], first * speed, second * speed**2 + first * pull)
    return Motion("user", angle, simulated.speed, simulated.acceleration, points)


def _finite(motion: Motion) -> bool:
    arrays = [motion.angle, motion.speed, motion.acceleration]
    for point in motion.points.values():
        arrays += [point.position, point.velocity, point.acceleration]
    return all(bool(np.isfinite(array).all()) for array in arrays)


def _stroke(exact: Motion) -> float:
    """Half the largest extent of any point's path; where nothing moves, the distance from the origin."""
    extents = [np.ptp(point.position, axis=0).max() for point in exact.points.values()]
    return 0.5 * float(max(extents)) or _reach(exact)


def _reach(exact: Motion) -> float:
    """The largest coordinate of any point."""
    return float(max(np.abs(point.position).max() for point in exact.points.values()))


def _bounds(
    simulated: Motion, tolerance: float | None, stroke: float, fastest: float
) -> Mapping[str, Tolerance]:
    if simulated.source == "pose" and tolerance is None:
        return tolerances.for_poses(stroke, fastest)
    return tolerances.for_steps(DEFAULT_PLACE * stroke if tolerance is None else tolerance, stroke, fastest)


def _checks(
    simulated: Motion, exact: Motion, allowed: Mapping[str, Tolerance], speed: float | None
) -> Iterator[Check]:
    angle = simulated.angle

    def check(quantity: str, kind: str, error: Array) -> Check:
        tolerance = allowed[kind]
        # NaN counts as the worst there is
        at = int(np.argmax(np.where(np.isnan(error), np.inf, error)))
        rms = float(np.sqrt(np.mean(error**2)))
        worst, place = float(error[at]), float(angle[at])
        return Check(quantity, tolerance.unit, worst, place, rms, tolerance.bound, tolerance.why)

    for name, point in exact.points.items():
        for kind in ("position", "velocity", "acceleration"):
            gap = getattr(simulated.points[name], kind) - getattr(point, kind)
            yield check(f"{kind} of {name}", kind, np.sqrt((gap**2).sum(1)))
    for name in exact.joints:
        if name in simulated.joints and name != "crank":
            gap = simulated.joints[name].value - exact.joints[name].value
            turning = exact.joints[name].unit == "rad"
            if turning:
                gap -= 2.0 * np.pi * np.round(gap / (2.0 * np.pi))
            yield check(f"joint {name}", "angle" if turning else "way", np.abs(gap))
    for name, link in exact.links.items():
        if name in simulated.links and name not in exact.spinning:
            turned = np.swapaxes(link.rotation, 1, 2) @ simulated.links[name].rotation
            # for a small turn the off-diagonal difference is twice its vector
            vector = turned[:, [2, 0, 1], [1, 2, 0]] - turned[:, [1, 2, 0], [2, 0, 1]]
            sine = 0.5 * np.sqrt((vector**2).sum(1))
            cosine = 0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0)
            yield check(f"orientation of {name}", "orientation", np.arctan2(sine, cosine))
    if simulated.closure is not None:
        yield check("loop residual", "loop", simulated.closure)
    if speed is not None:
        yield check("drive: crank speed", "drive speed", np.abs(simulated.speed - speed))
        if simulated.time is not None:
            meant = simulated.angle[0] + speed * (simulated.time - simulated.time[0])
            yield check("drive: crank angle", "drive angle", np.abs(simulated.angle - meant))
