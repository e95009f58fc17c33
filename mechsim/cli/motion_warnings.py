"""Warnings on a motion: loss of significance near a singular pose, a crank that cannot rotate fully."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mechsim.cli.exit_codes import notes, print_stderr
from mechsim.compare.tolerances import RATES
from mechsim.errors import MobilityError
from mechsim.kinematics.loops.motion import conditioning_of
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import Motion, select_instants
from mechsim.mechanism.motion_laws import SWING_FRACTION, Arcs, CrankProfile, within_range
from mechsim.numerics.arrays import REVOLUTION

# accelerations with this many correct digits need no warning
ENOUGH_DIGITS = 6
# crank angle in [rad] from a change point within which rates are limits that conditioning does not describe
NEAR_CHANGE_POINT = 1e-3


@dataclass(frozen=True, slots=True)
class AccuracyWarning:
    """The instant of a motion whose accelerations have the fewest correct digits.

    Attributes:
        digits: correct digits, with rounding as the only error.
        at: crank angle in [rad], or time in [s] under motion laws.
        over: "angle" or "t".
        conditioning: conditioning of the loop equations at that instant; 0 at a singular pose.
    """

    digits: int
    at: float
    over: Literal["angle", "t"]
    conditioning: float

    def warn(self) -> None:
        """Print a line on stderr."""
        instant = f"{self.at:.10g} rad" if self.over == "angle" else f"t = {self.at:.10g} s"
        print_stderr(
            f"mechsim: accelerations at {instant} have about {self.digits} correct digits: the loops' "
            f"conditioning is {self.conditioning:.2g} there; stay further from the singular pose"
        )


def loss_of_significance(solver: KinematicSolver, motion: Motion) -> AccuracyWarning | None:
    """Return the instant with the fewest digits; None for `ENOUGH_DIGITS` digits or more, or if undetermined.

    Digits are undetermined if the drivers leave a degree of freedom, such as that of a floating body.
    """
    error = RATES.widened(motion.conditioning, len(motion))[motion.speed != 0.0].max(initial=0.0)
    if motion.conditioning is not None and error <= 10.0**-ENOUGH_DIGITS:
        return None  # change points, whose search traces a whole revolution, change nothing
    try:
        rows = _examined_rows(solver, motion)
    except MobilityError:
        return None
    if not len(rows):
        return None
    examined = select_instants(motion, rows)
    conditioning = conditioning_of(solver.mechanism, examined)
    worst = int(np.argmin(conditioning))
    digits = int(max(-np.log10(RATES.widened(conditioning[worst : worst + 1], 1)[0]), 0.0))
    if digits >= ENOUGH_DIGITS:
        return None
    laws, instant = solver.motion_laws, float(examined.angle[worst])
    return AccuracyWarning(digits, instant / laws.rate, laws.axis, float(conditioning[worst]))


def _examined_rows(solver: KinematicSolver, motion: Motion) -> NDArray[np.intp]:
    """Return rows away from change points; for a closed form, only the fastest row of each joint.

    Digits are lost at large accelerations. A decomposition for every row would cost more than the motion.
    """
    distance = np.full(len(motion), np.inf)
    for angle in solver.change_points():
        gap = motion.angle - angle
        distance = np.minimum(
            distance, np.abs((gap + np.pi) % REVOLUTION - np.pi if solver.motion_laws.crank else gap)
        )
    rows = np.flatnonzero((distance > NEAR_CHANGE_POINT) & (motion.speed != 0.0))
    if motion.conditioning is None and len(rows):
        fastest = {int(np.argmax(np.abs(joint.acceleration[rows]))) for joint in motion.joints.values()}
        rows = rows[sorted(fastest)]
    return rows


def known_crank_range(solver: KinematicSolver) -> Arcs | None:
    """Return the range of a crank; None of an underdetermined mechanism.

    Its poses do not determine the range, but a run in time does.
    """
    try:
        return solver.crank_range()
    except MobilityError as error:
        if error.outcome != "underdetermined":
            raise
        return None


def limited_swing(solver: KinematicSolver, speed: float) -> CrankProfile | None:
    """Return the default motion of a crank that cannot rotate fully, and note its range; otherwise None.

    The motion is one swing within the reachable range, as `validate` uses it.

    Args:
        solver: the mechanism.
        speed: largest crank speed of the swing in [rad/s].

    Raises:
        AssemblyError: if the loops close at no crank angle.
    """
    arcs = known_crank_range(solver) if solver.motion_laws.crank else None
    if arcs is None or arcs.full or not arcs.arcs:
        return None
    ends = " and ".join(f"{low:.6g} to {high:.6g}" for low, high in np.rad2deg(arcs.arcs))
    notes.append(
        f"{solver.name}: the crank swings, its reachable range is {ends} deg; the motion is one swing over "
        f"the middle {SWING_FRACTION:g} of it"
    )
    return within_range(solver.mechanism, arcs, speed)
