"""The size of a requested motion, checked before any work is done.

Every command builds its motion from a crank motion or from motion laws, so that one check here bounds the
continuation steps of the loop equations, the poses that MuJoCo solves and the time steps it takes. What a
record of the motion holds in memory is checked by `mechsim.numerics.resources`.
"""

import math

from mechsim.errors import InputError
from mechsim.numerics.angles import TURN

# revolutions of the fastest driver in one motion; loop equations take 4 ms (four-bar linkage) to 40 ms (leg
# of a humanoid robot) to follow one
MAX_REVOLUTIONS = 1_000.0
# time steps of one run; MuJoCo takes about 3 us for one of a four-bar linkage
MAX_STEPS = 100_000_000
# of one free run whose motor or damping is so stiff that it, not the motion, limits explicit steps
MAX_STIFF_STEPS = 500_000
# of one run of an MJCF scene as it is, at 10 to 100 us each
MAX_SCENE_STEPS = 2_000_000


def require_revolutions(who: str, revolutions: float, duration: float) -> None:
    """Raise InputError where motion laws take the drivers through too many revolutions.

    Args:
        who: the mechanism, as the sentence names it.
        revolutions: the longest way or the number of oscillations of any driver.
        duration: of the motion in [s].
    """
    if not revolutions <= MAX_REVOLUTIONS:
        raise InputError(
            f"{who}: the motion laws take the drivers through {revolutions:.4g} revolutions or oscillations "
            f"in {duration:g} s, and {MAX_REVOLUTIONS:,.0f} are the limit of one motion; give a --duration "
            f"of {_rounded_down(duration * MAX_REVOLUTIONS / revolutions):g} s or less, or slower laws"
        )


def _rounded_down(value: float) -> float:
    """Return a positive value with two significant digits, no larger than it is."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.floor(value / unit) * unit:.2g}")


def require_travel(who: str, start: str, end: str, travel: float) -> None:
    """Raise InputError where a path is too long to be followed.

    Args:
        who: the mechanism and what moves, as the sentence names them.
        start: where the path starts, as the sentence names it.
        end: where it ends.
        travel: its length in [rad] of the fastest driver.
    """
    # what is looked at beyond the end of a motion is no part of it
    if not travel <= TURN * MAX_REVOLUTIONS + 1.0:
        raise InputError(
            f"{who} would be followed from {start} to {end}, {travel / TURN:,.0f} revolutions, and "
            f"{MAX_REVOLUTIONS:,.0f} are the limit of one motion; ask for a motion "
            f"{math.ceil(travel / TURN / MAX_REVOLUTIONS):,} times shorter"
        )


def require_steps(what: str, steps: float, remedy: str, limit: int = MAX_STEPS) -> None:
    """Raise InputError where a run takes too many time steps.

    Args:
        what: takes them, as the sentence names it.
        steps: how many.
        remedy: what to do.
        limit: of time steps.
    """
    if not steps <= limit:
        raise InputError(
            f"{what} takes {steps:.3g} time steps, and {limit:,} are the limit of one run; {remedy}"
        )
