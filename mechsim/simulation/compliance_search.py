"""How hard loops are held instead, where no number of steps keeps a tolerance of places.

What softness leaves of an error is in proportion to the compliance; rounding of forces, where a solver takes
accelerations from these, to its inverse. Which of the two is left a run by another compliance tells: measured
in validation/choices/compliance.py.
"""

from collections.abc import Callable

from mechsim.simulation.refine import MIN_GAIN, TARGET_FRACTION

# beyond these nothing falls any more: MuJoCo's own least softness, and its own softness
HARDEST, SOFTEST = 1e-16, 1.0
# what a compliance is changed by at least
MIN_FACTOR = 100.0


def improving_compliance(
    error: Callable[[float], float], compliance: float, known: float, tolerance: float
) -> tuple[float, float] | None:
    """Return a compliance by which much less is left of an error, and how much; None where none was found.

    Args:
        error: compliance -> worst error of a run by it, in [m].
        compliance: by which an error is left.
        known: that error, in [m].
        tolerance: that it should keep, in [m].
    """
    far = max(MIN_FACTOR, known / (TARGET_FRACTION * tolerance))
    tried = {compliance}
    for other in (compliance / far, compliance * far, compliance * MIN_FACTOR):
        there = min(max(other, HARDEST), SOFTEST)
        if there in tried:
            continue
        tried.add(there)
        left = error(there)
        if left <= tolerance or left < MIN_GAIN * known:
            return there, left
    return None
