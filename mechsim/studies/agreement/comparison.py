"""Claims held against the exact motion: each quantity's error, its bound and the reason for the bound."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.studies.agreement.claim import Claim
from mechsim.studies.agreement.named_quantities import Kind, NamedQuantity
from mechsim.studies.agreement.situation import Comparand
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
MEASURED = "what was measured is uncertain by that"


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


def scales_of(situation: Comparand, claims: Sequence[Claim]) -> Scales:
    """Return the scales of a situation; those of efforts only where some are claimed."""
    motion = situation.motion
    length, stroke = reach_of(motion), stroke_of(motion)
    rate = float(np.abs(situation.speed).max())
    if not any(claim.named.kind in ("torque", "force", "moment") for claim in claims):
        return Scales(length, stroke, rate)
    found = efforts_scales(situation.efforts)
    return Scales(length, stroke, rate, found["force"] or 1.0, found["torque"] or 1.0)


def errors(named: NamedQuantity, found: Array, exact: Array) -> Array:
    """Return the differences of values (n, k), of angles by the shorter turn."""
    gap = found - exact
    return gap - 2.0 * np.pi * np.round(gap / (2.0 * np.pi)) if named.angle else gap


def bound_of(claim: Claim, scales: Scales, asked: float | None) -> Tolerance:
    """Return how far a claim may be off.

    Args:
        claim: what is said.
        scales: of the situation.
        asked: bound on places in [m], other quantities in proportion; None takes the usual part.
    """
    named, scale = claim.named, scales.of(claim.named)
    part, power = PART[named.kind]
    if asked is not None:
        more = part / PLACES if named.kind not in ("position", "joint") else 1.0
        return Tolerance(asked / scales.length * scale * more, named.unit, ASKED)
    return Tolerance(part * scale, named.unit, WHY.format(part=part, scale=scale, unit=named.unit), power)


def check(claim: Claim, exact: Array, situation: Comparand, scales: Scales, asked: float | None) -> Check:
    """Return how far one claim is from what is exact (n, k)."""
    gap = errors(claim.named, claim.values, exact)
    tolerance, conditioning = bound_of(claim, scales, asked), situation.motion.conditioning
    if conditioning is None:
        conditioning = situation.form.conditioning(situation.motion)
    size = np.sqrt((gap**2).sum(1))
    if claim.uncertainty is not None:
        # each component has its own: what is more than uncertain counts
        wide = np.sqrt((claim.uncertainty**2).sum(1))
        tolerance = Tolerance(float(wide.max()), claim.named.unit, MEASURED)
        size = np.where(wide > 0.0, size / np.where(wide > 0.0, wide, 1.0), np.inf) * tolerance.bound
    kind = _said(claim.named)
    return check_of(kind, "", size, situation.angle, tolerance, conditioning)


def _said(named: NamedQuantity) -> str:
    if named.kind in ("position", "velocity", "acceleration"):
        axes = f", {named.axes}" if len(named.axes) < 3 else ""
        return f"{named.kind} of {named.subject}{axes}"
    if named.kind in ("force", "moment"):
        return f"{named.kind} in {named.subject}"
    if named.kind == "torque":
        return f"{'force' if named.unit == 'N' else 'torque'} of drive {named.subject}"
    return f"{named.kind} {named.subject}"
