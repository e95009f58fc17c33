"""Where loops stand so near to a singular pose that few digits of accelerations are left: said in a line."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.forms import Form
from mechsim.cli.exit_codes import notes, tell
from mechsim.errors import MobilityError
from mechsim.model.motion import Motion, select_instants
from mechsim.model.motion_laws import PART_OF_RANGE, CrankProfile, within_range
from mechsim.numerics.angles import REVOLUTION
from mechsim.verdict.tolerances import RATES

# of accelerations, which nothing is said of
ENOUGH = 6
# nearer to a change point than this, in [rad] of the crank, rates are limits and not the loops' at all
LIMIT = 1e-3


@dataclass(frozen=True, slots=True)
class FewDigits:
    """The instant of a motion whose accelerations have the fewest correct digits.

    Attributes:
        digits: about so many, by rounding alone.
        at: the crank angle in [rad], or the time in [s] of programs.
        over: "angle" or "t".
        conditioning: of the loops there.
    """

    digits: int
    at: float
    over: str
    conditioning: float


def few_digits(form: Form, motion: Motion) -> FewDigits | None:
    """Return where accelerations have the fewest digits; None where they have `ENOUGH`, or none is known.

    None is known where the drivers leave something open, as a body that floats beside the mechanism.
    """
    try:
        rows = _told(form, motion)
    except MobilityError:
        return None
    if not len(rows):
        return None
    some = select_instants(motion, rows)
    far = some.conditioning if some.conditioning is not None else form.conditioning(some)
    at = int(np.argmin(far))
    digits = int(max(-np.log10(RATES.widened(far[at : at + 1], 1)[0]), 0.0))
    if digits >= ENOUGH:
        return None
    motion_laws = form.motion_laws
    place = some.angle[at] if motion_laws is None else some.angle[at] / motion_laws.rate
    return FewDigits(digits, float(place), "angle" if motion_laws is None else "t", float(far[at]))


def worse(one: FewDigits | None, other: FewDigits | None) -> FewDigits | None:
    """Return the one with fewer digits."""
    return min((few for few in (one, other) if few), key=lambda few: few.conditioning, default=None)


def tell_digits(few: FewDigits | None) -> None:
    """Say in a line on stderr where few digits of accelerations are left."""
    if few is not None:
        where = f"{few.at:.10g} rad" if few.over == "angle" else f"t = {few.at:.10g} s"
        tell(
            f"mechsim: accelerations at {where} have about {few.digits} correct digits: the loops' "
            f"conditioning is {few.conditioning:.2g} there; stay further from the singular pose"
        )


def digits_in_json(few: FewDigits | None) -> dict[str, Any]:
    """Return what --json tells of it."""
    return {"few_digits": None if few is None else asdict(few)}


def _told(form: Form, motion: Motion) -> NDArray[np.intp]:
    """Return the rows to look at: those away from change points; of a closed form the fastest of each joint.

    What loses digits is fast, and a decomposition for every row would cost more than the motion.
    """
    off = np.full(len(motion), np.inf)
    for meeting in form.change_points():
        gap = motion.angle - meeting
        off = np.minimum(off, np.abs(gap if form.motion_laws else (gap + np.pi) % REVOLUTION - np.pi))
    rows = np.flatnonzero((off > LIMIT) & (motion.speed != 0.0))
    if motion.conditioning is None and len(rows):
        fastest = {int(np.argmax(np.abs(joint.acceleration[rows]))) for joint in motion.joints.values()}
        rows = rows[sorted(fastest)]
    return rows


def swing_of(form: Form, speed: float) -> CrankProfile | None:
    """Return the swing of a crank that does not turn fully, as `validate` has it; None of any other.

    A line on stderr states the reachable range.

    Args:
        form: what moves.
        speed: largest crank speed of the swing in [rad/s].

    Raises:
        AssemblyError: where the loops close at no crank angle.
    """
    if form.motion_laws is not None:
        return None
    try:
        arcs = form.crank_range()
    except MobilityError as error:
        if error.outcome != "underdetermined":
            raise
        # how far it can turn no pose says, but a run in time does
        return None
    if arcs.full or not arcs.arcs:
        return None
    swing = within_range(form.mechanism, arcs, speed)
    ends = " and ".join(f"{low:.6g} to {high:.6g}" for low, high in np.rad2deg(arcs.arcs))
    notes.append(
        f"{form.name}: the crank swings, its reachable range is {ends} deg; the motion is one swing over the "
        f"middle {PART_OF_RANGE:g} of it"
    )
    return swing
