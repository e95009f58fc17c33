"""Claims held against the exact motion: each quantity's error, its bound and the reason for the bound."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.claim import Claim
from mechsim.studies.agreement.comparand import Comparand
from mechsim.studies.agreement.named_quantities import Kind, NamedQuantity
from mechsim.studies.agreement.noise import Noise, noise_of
from mechsim.verdict.checks import Check, check_of
from mechsim.verdict.quantities import efforts_scales, reach_of, stroke_of
from mechsim.verdict.tolerances import Tolerance

# a formula is held to this part of what it measures: between its rounding, 1e-15, and a link 0.1 % long, 1e-3
PLACES, RATES, SECONDS, LOADS = 1e-8, 1e-6, 1e-5, 1e-6
PART: dict[Kind, tuple[float, int]] = {
    "position": (PLACES, 1),
    "joint": (PLACES, 1),
    "velocity": (RATES, 3),
    "joint rate": (RATES, 3),
    "acceleration": (SECONDS, 5),
    "joint acceleration": (SECONDS, 5),
    "torque": (LOADS, 5),
    "force": (LOADS, 5),
    "moment": (LOADS, 5),
}
WHY = "{part:.0e} of {scale:.3g} {unit}: a formula of one's own; a link 0.1 % long is 1e-3 of it"
ASKED = "asked for"


@dataclass(frozen=True)
class Scales:
    """By what errors of quantities are measured beside each other.

    Attributes:
        length: largest coordinate of anything, in [m].
        stroke: half the largest extent of a path, in [m].
        rate: of the fastest driver, in [rad/s].
        force: in [N].
        torque: in [N m].
    """

    length: float
    stroke: float
    rate: float
    force: float = 1.0
    torque: float = 1.0

    def of(self, named: NamedQuantity) -> float:
        """Return the scale of a quantity in its unit."""
        length = 1.0 if named.unit.startswith("rad") else self.length
        return {
            "position": self.length,
            "velocity": self.length * self.rate,
            "acceleration": self.length * self.rate**2,
            "joint": length,
            "joint rate": length * self.rate,
            "joint acceleration": length * self.rate**2,
            "torque": self.force if named.unit == "N" else self.torque,
            "force": self.force,
            "moment": self.force * self.length,
        }[named.kind]


def scales_of(comparand: Comparand, claims: Sequence[Claim]) -> Scales:
    """Return the scales of a comparand; those of efforts only where some are claimed."""
    motion = comparand.motion
    length, stroke = reach_of(motion), stroke_of(motion)
    rate = float(np.abs(comparand.speed).max())
    if not any(claim.named.kind in ("torque", "force", "moment") for claim in claims):
        return Scales(length, stroke, rate)
    found = efforts_scales(comparand.efforts)
    return Scales(length, stroke, rate, found["force"] or 1.0, found["torque"] or 1.0)


def errors(named: NamedQuantity, found: Array, exact: Array) -> Array:
    """Return the differences of values (n, k), of angles by the shorter turn."""
    gap = found - exact
    return gap - 2.0 * np.pi * np.round(gap / (2.0 * np.pi)) if named.angle else gap


def bound_of(claim: Claim, scales: Scales, asked: float | None) -> Tolerance:
    """Return how far a claim may be off.

    Args:
        claim: what is said.
        scales: of the comparand.
        asked: bound on places in [m], other quantities in proportion; None takes the usual part.
    """
    named, scale = claim.named, scales.of(claim.named)
    part, power = PART[named.kind]
    if asked is not None:
        more = part / PLACES if named.kind not in ("position", "joint") else 1.0
        return Tolerance(asked / scales.length * scale * more, named.unit, ASKED)
    return Tolerance(part * scale, named.unit, WHY.format(part=part, scale=scale, unit=named.unit), power)


def weights(claim: Claim, comparand: Comparand, tolerance: Tolerance) -> Array:
    """Return by what the errors of a claim are divided at each instant, (n, 1) or (n, k).

    That is the tolerance, or the standard deviation of what was measured where that is larger.
    """
    if claim.uncertainty is None:
        return tolerance.widened(comparand.conditioning, len(comparand))[:, None]
    return np.maximum(claim.uncertainty, tolerance.value)


def measured(claims: Sequence[Claim]) -> int:
    """Return how many quantities have standard deviations."""
    return sum(claim.uncertainty is not None for claim in claims)


def noise_in(claim: Claim, error: Array, phase: Array, tolerance: Tolerance, quantities: int) -> Noise | None:
    """Return the tests of a claim's errors (n, k) for what is not noise; None without standard deviations.

    Args:
        claim: what is said.
        error: of all its components.
        phase: over which systematic errors are smooth, (n,).
        tolerance: systematic error that is allowed.
        quantities: how many are tested at once.
    """
    if claim.uncertainty is None:
        return None
    known = (claim.uncertainty > 0.0).all(0)
    return noise_of(
        error[:, known],
        claim.uncertainty[:, known],
        phase,
        allowed=tolerance.value,
        quantities=quantities,
    )


def check(
    claim: Claim, exact: Array, comparand: Comparand, tolerance: Tolerance, noise: Noise | None
) -> Check:
    """Return how far one claim is from what is exact, (n, k).

    A measured claim is as good as its noise tests and its components without standard deviation.
    """
    error = errors(claim.named, claim.values, exact)
    kind, subject = _compared(claim.named)
    if noise is None or claim.uncertainty is None:
        size = np.sqrt((error**2).sum(1))
        return check_of(kind, subject, size, comparand.instants, tolerance, comparand.conditioning)
    bare = error[:, ~(claim.uncertainty > 0.0).all(0)]
    if bare.size:
        size = np.sqrt((bare**2).sum(1))
        hard = check_of(kind, subject, size, comparand.instants, tolerance, comparand.conditioning)
        if hard.fraction_of_tolerance is None or hard.fraction_of_tolerance > noise.decisive.used:
            return hard
    return Check(
        kind=kind,
        subject=subject,
        unit=claim.named.unit,
        worst=noise.decisive.worst * noise.deviation,
        at=float(comparand.instants.value[noise.row]),
        at_unit=comparand.instants.unit,
        rms=float(np.sqrt(np.mean(error**2))),
        tolerance=noise.decisive.limit * noise.deviation,
        reason=noise.reason,
    )


def _compared(named: NamedQuantity) -> tuple[str, str]:
    """Return what is compared and of what, as the table of quantities has them where it knows the kind."""
    if named.kind in ("position", "velocity", "acceleration"):
        axes = f", {named.axes}" if len(named.axes) < 3 else ""
        return named.kind, named.subject + axes
    if named.kind == "torque":
        return f"{'force' if named.unit == 'N' else 'torque'} of drive {named.subject}", ""
    if named.kind in ("force", "moment"):
        return named.kind, named.subject
    if named.kind == "joint":
        return "angle" if named.angle else "displacement", named.subject
    return f"{named.kind} {named.subject}", ""
