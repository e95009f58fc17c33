"""The default motion of a crank that does not turn fully: a swing within its reachable range."""

import numpy as np

from mechsim.analytic.forms import Form
from mechsim.cli.endings import notes
from mechsim.errors import MobilityError
from mechsim.model.crank_profile import PART_OF_RANGE, CrankProfile, within_range


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
