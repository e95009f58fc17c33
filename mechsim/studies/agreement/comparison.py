"""Tolerances and checks of candidate data, compared with the exact motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.compare.checks import Check, check_of
from mechsim.compare.quantities import force_scales, reach_of, stroke_of
from mechsim.compare.tolerances import Tolerance
from mechsim.mechanism.expressions import unit_powers
from mechsim.mechanism.quantity import Quantity
from mechsim.numerics.arrays import EPS, Array, wrapped
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.evaluation_points import EvaluationPoints


@dataclass(frozen=True, slots=True)
class FormulaTolerances:
    """Tolerances relative to the scale of a quantity, each with a power of the loops' conditioning.

    For poorly conditioned loops a tolerance widens by that power.

    Attributes:
        motion: of positions, velocities and accelerations of points and joints.
        forces: of torques, reactions and energies.
        reason: template with {part}, {scale} and {unit} of the tolerance.
    """

    motion: tuple[tuple[float, int], ...]
    forces: tuple[float, int]
    reason: str


# for any function or table: between the error of a solver inside a function, the square of the 1.5e-8 at
# which scipy's fsolve stops, and the effect of a link that is 0.1 % too long, 1e-3
USER_TOLERANCES = FormulaTolerances(
    motion=((1e-8, 1), (1e-6, 3), (1e-5, 5)),
    forces=(1e-6, 5),
    reason="{part:.0e} of the motion's {scale:.3g} {unit} (a link 0.1 % too long would change 1e-3)",
)
# for the formula of a model's file: rounding times the condition of the loops. Positions of the 24
# gallery mechanisms differ by 10 eps at most; the powers are those of solved poses (`verdict.quantities`)
EXACT_TOLERANCES = FormulaTolerances(
    motion=((1024 * EPS, 1), (8192 * EPS, 3), (65536 * EPS, 5)),
    forces=(1e-10, 5),
    reason="{part:.0e} of the motion's {scale:.3g} {unit} (rounding; formulas have 2e-15)",
)


@dataclass(frozen=True)
class Scales:
    """Scales by which errors of quantities are divided.

    Attributes:
        length: largest coordinate of any point, in [m].
        stroke: half the largest extent of a path, in [m].
        rate: speed of the fastest driver, in [rad/s].
        force: in [N].
        torque: in [N m].
    """

    length: float
    stroke: float
    rate: float
    force: float = 1.0
    torque: float = 1.0

    def scale(self, quantity: Quantity) -> float:
        """Return the scale of a quantity in its unit."""
        if quantity.kind == "torque":
            return self.force if quantity.unit == "N" else self.torque
        mass, length, time, _ = unit_powers(quantity.unit)
        # the force moves a mass by `length` while the driver moves by 1 rad
        weight = self.force / (self.length * self.rate**2)
        return weight**mass * self.length**length * self.rate**-time


def scales_of(evaluation: EvaluationPoints, candidates: Sequence[Candidate]) -> Scales:
    """Return the scales at evaluation points; force scales only if forces are compared."""
    motion = evaluation.motion
    length, stroke = reach_of(motion), stroke_of(motion)
    rate = float(np.abs(evaluation.speed).max())
    if not any(candidate.quantity.loaded for candidate in candidates):
        return Scales(length, stroke, rate)
    scales = force_scales(evaluation.forces)
    return Scales(length, stroke, rate, scales["force"] or 1.0, scales["torque"] or 1.0)


def candidate_errors(quantity: Quantity, values: Array, exact: Array) -> Array:
    """Return the differences of values (n, k); those of angles lie within half a revolution."""
    difference = values - exact
    return wrapped(difference) if quantity.angle else difference


def formula_tolerance(
    candidate: Candidate, scales: Scales, requested: float | None, *, exact: bool = False
) -> Tolerance:
    """Return the tolerance of a candidate.

    Args:
        candidate: the candidate values.
        scales: at the evaluation points.
        requested: tolerance of positions in [m], other quantities in proportion; None takes the default.
        exact: whether the candidate is a formula that is exact except for rounding.
    """
    quantity, scale = candidate.quantity, scales.scale(candidate.quantity)
    usual = EXACT_TOLERANCES if exact and requested is None else USER_TOLERANCES
    fraction, power = usual.forces if quantity.loaded else usual.motion[quantity.order]
    if requested is not None:
        more = fraction / USER_TOLERANCES.motion[0][0]
        return Tolerance(requested / scales.length * scale * more, quantity.unit, "requested")
    reason = usual.reason.format(part=fraction, scale=scale, unit=quantity.unit)
    return Tolerance(fraction * scale, quantity.unit, reason, power)


def candidate_check(
    candidate: Candidate, exact: Array, evaluation: EvaluationPoints, tolerance: Tolerance
) -> Check:
    """Return the check of one candidate against exact values, (n, k)."""
    error = candidate_errors(candidate.quantity, candidate.values, exact)
    kind, subject = _compared(candidate.quantity)
    length = np.sqrt((error**2).sum(1))
    return check_of(kind, subject, length, evaluation.instants, tolerance, evaluation.conditioning)


def _compared(quantity: Quantity) -> tuple[str, str]:
    """Return the name of the compared quantity and its subject, as in the table of quantities."""
    if quantity.kind in ("position", "velocity", "acceleration"):
        axes = f", {quantity.axes}" if len(quantity.axes) < 3 else ""
        return quantity.kind, quantity.subject + axes
    if quantity.kind == "torque":
        return f"{'force' if quantity.unit == 'N' else 'torque'} of drive {quantity.subject}", ""
    if quantity.kind in ("force", "moment"):
        return quantity.kind, quantity.subject
    if quantity.kind == "joint":
        return "angle" if quantity.angle else "displacement", quantity.subject
    if quantity.function is not None or quantity.kind == "effort":
        return quantity.name, ""
    return f"{quantity.kind} {quantity.subject}", ""
