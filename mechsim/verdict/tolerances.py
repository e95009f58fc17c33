"""Bounds with reasons: what a verdict allows, and why.

A bound lies between the error measured and the effect of the smallest mistake worth catching: a link
0.1 % long moves a point of any catalogue mechanism by 1e-3 of the crank's stroke or more.
"""

from dataclasses import dataclass

EPS = 2.0**-52


@dataclass(frozen=True, slots=True)
class Tolerance:
    """A bound, its unit, and the reason it is what it is."""

    bound: float
    unit: str
    why: str

    def allows(self, worst: float) -> bool:
        """Return whether a worst value is within the bound; NaN is not."""
        return worst <= self.bound


# what errors of a stepped run look like beside the error of place, as multiples of place x speed^k:
# measured 2 and 5 for the catalogue at 100 steps a turn or more (validation/choices/
# constraint_settings.py), and 35 for the acceleration of a four-bar a hundredth from its dead centre
RATE_GAIN, PULL_GAIN = 30.0, 300.0
# rounding of a solved pose, measured below 4 eps of the stroke; each rate adds a linear solve
POSE_EPS = 2000.0


def for_steps(place: float, stroke: float, speed: float) -> dict[str, Tolerance]:
    """Return the bounds of a time-stepped run.

    Args:
        place: bound on the place of any tracked point, in [m].
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, in [rad/s].
    """
    asked = f"asked for: {place / stroke:.1g} of the stroke of {stroke:.4g} m"
    angle = place / stroke
    return {
        "position": Tolerance(place, "m", asked),
        "velocity": Tolerance(
            RATE_GAIN * place * speed,
            "m/s",
            f"{RATE_GAIN:.0f} x position bound x crank speed: the loop's swing",
        ),
        "acceleration": Tolerance(
            PULL_GAIN * place * speed**2,
            "m/s2",
            f"{PULL_GAIN:.0f} x position bound x crank speed squared: the loop's swing",
        ),
        "angle": Tolerance(2.0 * angle, "rad", "position bound over the stroke, for levers half as long"),
        "way": Tolerance(place, "m", "position bound"),
        "orientation": Tolerance(
            4.0 * angle, "rad", "position bound over the stroke, for levers a quarter as long"
        ),
        "loop": Tolerance(10.0 * place, "m", "an open loop of this size moves a point by about the bound"),
        "drive angle": Tolerance(
            1e-7, "rad", "does not enter the errors, which are taken at the angle reached"
        ),
        "drive speed": Tolerance(
            1e-8 * speed, "rad/s", "flywheel of 1e12 times the links: no reaction changes its speed"
        ),
    }


def for_poses(stroke: float, speed: float) -> dict[str, Tolerance]:
    """Return the bounds of a motion by solved poses: rounding.

    Args:
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, in [rad/s].
    """
    tiny = POSE_EPS * EPS
    why = f"rounding: {POSE_EPS:.0f} eps; measured a hundredth of it away from dead centres"
    rates = "rounding of a linear solve for each rate"
    return {
        "position": Tolerance(tiny * stroke, "m", why),
        "velocity": Tolerance(10.0 * tiny * stroke * speed, "m/s", rates),
        "acceleration": Tolerance(100.0 * tiny * stroke * speed**2, "m/s2", rates),
        "angle": Tolerance(4.0 * tiny, "rad", why),
        "way": Tolerance(tiny * stroke, "m", why),
        "orientation": Tolerance(4.0 * tiny, "rad", why),
        "loop": Tolerance(tiny * stroke, "m", why),
        "drive angle": Tolerance(tiny * 10.0, "rad", "the crank is placed, not driven"),
        "drive speed": Tolerance(tiny * speed, "rad/s", "the crank is placed, not driven"),
    }


def for_differences(reach: float, speed: float) -> dict[str, Tolerance]:
    """Return the bounds of rates where the analytic side is a function, differentiated by differences.

    Args:
        reach: largest coordinate of any point, in [m].
        speed: largest crank speed, in [rad/s].
    """
    why = "eighth-order differences of the function given"
    return {
        "velocity": Tolerance(
            1e-10 * reach * speed, "m/s", f"{why}: rounding 1e-13, harmonics up to the tenth"
        ),
        "acceleration": Tolerance(
            1e-9 * reach * speed**2, "m/s2", f"{why}: rounding 1e-11, harmonics up to the tenth"
        ),
    }
