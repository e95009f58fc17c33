"""The table of compared quantities: error, unit, scale, tolerance by method and its reason.

Verdicts, the trade-off study, its plots and the report read this table.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from mechsim.compare import record_errors as errors
from mechsim.compare.record_errors import Error, Subjects, field_error, field_value
from mechsim.compare.tolerances import FRACTION_OF, ToleranceRule
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import EPS, rms, worst
from mechsim.numerics.convergence import half_extent

# a drive torque below this fraction of the kinetic energy counts as zero
ZERO_TORQUE = 1e-3
# a drive torque below this fraction of the moments of forces is a small difference of them. Those of a screw
# of lead 5 mm that lifts 80 kg are 1,600 times its torque and have errors of 2e-13
SMALL_TORQUE = 1e-2
# rounding of a prescribed crank angle in [rad]
ANGLE_ROUNDING = 2000.0 * EPS
# points that move by less than this fraction of their distance from the origin are at rest (rounding)
AT_REST = 1e-12
# errors of the rates of a stepped run as multiples of (position error x speed^k):
# measured 2 and 5 for the catalogue at 100 or more steps per turn (validation/choices/
# constraint_settings.py), 12 and 69 for random mechanisms at 400 (validation/robustness/bounds.py)
RATE_GAIN, ACCELERATION_GAIN = 30.0, 300.0


@dataclass(frozen=True, slots=True)
class ComparedQuantity:
    """A quantity that is compared in two records.

    Attributes:
        name: its kind.
        unit: unit of the error.
        error: (computed, exact, subject) -> errors >= 0, (n,); None if the quantity is undefined.
        scale: scale of errors and tolerances; a key of `motion_scales` or `force_scales`.
        bounds: method -> tolerance rule.
        over: (computed, exact) -> the points, links or joints to compare.
        text: label with {} for the subject; the default is the name.
        title: title of a plot's axis.
    """

    name: str
    unit: str
    error: Error
    scale: str
    bounds: Mapping[str, ToleranceRule]
    over: Subjects = errors.whole
    text: str = ""
    title: str = ""

    def label(self, subject: str = "") -> str:
        """Return the quantity and its subject in words."""
        return (self.text or self.name).format(subject)

    def largest(self, computed: Any, exact: Any, scales: Mapping[str, float]) -> float:
        """Return the largest error relative to its scale; 0 if the quantity is undefined."""
        errors_of = (self.error(computed, exact, subject) for subject in self.over(computed, exact))
        largest = max((worst(error) for error in errors_of if error is not None), default=0.0)
        return largest / scales[self.scale]


VIBRATION = "x position tolerance x crank speed{}: vibration of the loop"


def _rounding(eps: int, measured: int, power: int, scale: str = "", how: str = "rounding") -> ToleranceRule:
    """Return the tolerance of a solved pose in multiples of eps; `measured` is over random mechanisms."""
    reason = f"{how}: {eps} times 2.2e-16; random mechanisms had up to {measured} times"
    return ToleranceRule(reason, eps * EPS, power=power, scale=scale)


# errors of joint coordinates
ANGLES, DISPLACEMENTS = errors.of_joints("rad"), errors.of_joints("m")
ANGLE_SET = "the crank angle is set, not driven"
ROTATION = {
    "pose": _rounding(1024, 240, 1),
    # measured 7.3, by a Bennett of twists 0.07 and 1.2: validation/robustness/bounds.py
    "step": ToleranceRule(
        "position tolerance over the stroke, for levers a tenth as long", requested=10.0, power=1
    ),
}

POSITION = {
    "pose": _rounding(512, 100, 1, "reach"),
    "step": ToleranceRule("requested: {part:.1g} of the stroke of {scale:.4g} m", requested=1.0),
}
VELOCITY = {
    "pose": _rounding(2048, 220, 3, "reach · crank speed", "a linear solve"),
    "step": ToleranceRule(f"{RATE_GAIN:.0f} {VIBRATION.format('')}", requested=RATE_GAIN, power=2),
    "closed form": _rounding(1024, 100, 3, "reach · crank speed", "a linear solve"),
}
SQUARED = f"{ACCELERATION_GAIN:.0f} {VIBRATION.format(' squared')}"
ACCELERATION = {
    "pose": _rounding(8192, 1000, 5, "reach · crank speed²", "two linear solves"),
    "step": ToleranceRule(SQUARED, requested=ACCELERATION_GAIN, power=4),
    "closed form": _rounding(4096, 160, 5, "reach · crank speed²", "two linear solves"),
}
DISPLACEMENT = {
    "pose": _rounding(128, 8, 1, "reach"),
    "step": ToleranceRule("position tolerance", requested=1.0),
}
LOOP_GAP = "a loop-closure error of this size moves a point by about the tolerance"
LOOP = {"pose": _rounding(256, 51, 0, "reach"), "step": ToleranceRule(LOOP_GAP, requested=10.0)}


def _of_points(
    name: Literal["position", "velocity", "acceleration"],
    unit: str,
    scale: str,
    bounds: Mapping[str, ToleranceRule],
) -> ComparedQuantity:
    error, title = errors.of_points(name), f"{name} error"
    return ComparedQuantity(name, unit, error, scale, bounds, errors.points, f"{name} of {{}}", title)


MOTION = (
    _of_points("position", "m", "stroke", POSITION),
    _of_points("velocity", "m/s", "stroke · crank speed", VELOCITY),
    _of_points("acceleration", "m/s2", "stroke · crank speed²", ACCELERATION),
    ComparedQuantity("angle", "rad", ANGLES, "rad", ROTATION, errors.joints, "joint {}", "joint angle error"),
    ComparedQuantity("displacement", "m", DISPLACEMENTS, "stroke", DISPLACEMENT, errors.joints, "joint {}"),
    ComparedQuantity(
        "orientation", "rad", errors.orientation, "rad", ROTATION, errors.links, "orientation of {}"
    ),
    ComparedQuantity(
        "loop", "m", field_value("closure"), "stroke", LOOP, text="loop residual", title="loop residual"
    ),
)

DRIVE_SPEED = {
    "pose": ToleranceRule(ANGLE_SET, ANGLE_ROUNDING),
    "step": ToleranceRule(
        "virtual drive inertia of 1e12 times the links: no reaction changes its speed", 1e-8
    ),
}
DRIVE_ANGLE = {
    "pose": ToleranceRule(ANGLE_SET, 10.0 * ANGLE_ROUNDING),
    "step": ToleranceRule("not in the errors, which are computed at the actual crank angle", 1e-7),
}
# the crank compared with its requested motion
CRANK_DRIVE = (
    ComparedQuantity(
        "drive speed", "rad/s", field_error("speed"), "crank speed", DRIVE_SPEED, text="drive: crank speed"
    ),
    ComparedQuantity(
        "drive",
        "rad",
        errors.drive_angle,
        "rad",
        DRIVE_ANGLE,
        text="drive: crank angle",
        title="error of the crank angle over time",
    ),
)

DRIVER = {
    "pose": ToleranceRule(ANGLE_SET, 10.0 * ANGLE_ROUNDING),
    "step": ToleranceRule(
        "not in the errors, which are computed at the actual driver positions; a force that is constant over "
        "a step has a second-order error: measured 2.4e-4 at 100 steps per turn",
        1e-3,
    ),
}
# drivers compared with their motion laws
DRIVERS = (
    ComparedQuantity("driver angle", "rad", ANGLES, "rad", DRIVER, errors.drivers, "drive: {}"),
    ComparedQuantity("driver displacement", "m", DISPLACEMENTS, "reach", DRIVER, errors.drivers, "drive: {}"),
)

SPRINGS = ToleranceRule(
    f"{FRACTION_OF}rounding, without integration; 3e-14 without springs, 3e-11 with stiff springs in balance",
    1e-10,
    power=5,
)
SHARED = ToleranceRule("redundant constraints share forces by their compliance: 1e-4", 1e-3)
TORQUE = {
    "pose": replace(SPRINGS, scale="torque, as a difference of moments"),
    "step": ToleranceRule(
        f"{FRACTION_OF}error of 1,000 steps per turn, fourth order: measured 6e-8 at most", 1e-6
    ),
}
REACTION = {
    "pose": SPRINGS,
    "step": ToleranceRule(f"{FRACTION_OF}as the torque, with forces that cancel in it: 1.5e-7", 1e-5),
}
ENERGY = {
    "pose": ToleranceRule(f"{FRACTION_OF}rounding: measured 1e-14", 1e-12, power=3),
    "step": ToleranceRule(f"{FRACTION_OF}rates of closed loops: measured 1e-9", 1e-8),
}
POWER = {
    "pose": SPRINGS,
    "step": ToleranceRule(f"{FRACTION_OF}rates of loops closed to 1e-8: measured 4e-9", 4e-7),
}
RESIDUAL = {
    "pose": ToleranceRule("rounding times the condition of the mass matrix; measured 1e-10", 1e-8),
    "step": SHARED,
}

FORCES = (
    ComparedQuantity("drive torque", "N m", errors.torque, "torque", TORQUE),
    ComparedQuantity(
        "force", "N", errors.of_reactions("force"), "force", REACTION, errors.reactions, "force in {}"
    ),
    ComparedQuantity(
        "moment", "N m", errors.of_reactions("moment"), "moment", REACTION, errors.reactions, "moment in {}"
    ),
    ComparedQuantity(
        "gear torque", "N m", errors.gear_torque, "moment", REACTION, errors.gears, "torque of gear {}"
    ),
    ComparedQuantity("mesh force", "N", errors.mesh_force, "force", REACTION, errors.meshes, "teeth of {}"),
    ComparedQuantity(
        "driver effort", "N m", errors.drive_effort, "moment", REACTION, errors.drives, "drive of {}"
    ),
    ComparedQuantity("kinetic energy", "J", field_error("kinetic"), "kinetic energy", ENERGY),
    ComparedQuantity("potential energy", "J", field_error("potential"), "potential energy", ENERGY),
    ComparedQuantity("power loads", "W", field_error("power_loads"), "power", POWER),
    ComparedQuantity("power lost", "W", field_error("power_lost"), "power", POWER),
    ComparedQuantity("accelerations under these forces", "1", field_value("residual"), "1", RESIDUAL),
)

QUANTITIES = {row.name: row for row in (*MOTION, *CRANK_DRIVE, *DRIVERS, *FORCES)}


def motion_scales(
    stroke: float,
    speed: float,
    reach: float | None = None,
    acceleration: float = 0.0,
    revolutions: float = 1.0,
) -> dict[str, float]:
    """Return the scales of motions.

    Args:
        stroke: in [m].
        speed: largest crank speed, in [rad/s].
        reach: largest coordinate of any point in [m]; the default is the stroke.
        acceleration: largest crank acceleration, in [rad/s2]; it replaces the speed squared if it is larger.
        revolutions: largest angle of a joint in revolutions, for configurations of rounding alone.
    """
    reach, rate_squared = revolutions * (stroke if reach is None else reach), max(speed**2, acceleration)
    return {
        "stroke": stroke,
        "stroke · crank speed": stroke * speed,
        "stroke · crank speed²": stroke * rate_squared,
        "reach": reach,
        "reach · crank speed": reach * speed,
        "reach · crank speed²": reach * rate_squared,
        "crank speed": speed,
        "rad": revolutions,
    }


def force_scales(exact: ForceRecord) -> dict[str, float]:
    """Return the scales of forces: root mean squares of torque and forces, largest energies.

    For rounding alone, the torque counts as `SMALL_TORQUE` of the moments at least, and so do forces of those
    by the torque, which the spring of a stop on the crank takes up.
    """
    kinetic = float(np.abs(exact.kinetic).max())
    torque = max(rms(exact.torque), ZERO_TORQUE * kinetic)
    largest = max(rms(errors.lengths(reaction.force)) for reaction in exact.reactions.values())
    by_torque = torque / exact.characteristic_length
    force = max(largest, SMALL_TORQUE * by_torque) if largest else by_torque
    return {
        "torque": torque,
        "torque, as a difference of moments": max(torque, SMALL_TORQUE * force * exact.characteristic_length),
        "force": force,
        "moment": force * exact.characteristic_length,
        "kinetic energy": kinetic,
        # if gravity does no work, the error is the rounding of positions
        "potential energy": max(
            float(np.abs(exact.potential).max()), ZERO_TORQUE * force * exact.characteristic_length
        ),
        "power": torque * float(np.abs(exact.speed).max()),
        "1": 1.0,
    }


def stroke_of(motion: Motion) -> float:
    """Return half the largest extent of any point's path in [m]; `reach_of` it if nothing moves."""
    extent, reach = half_extent(point.position for point in motion.points.values()), reach_of(motion)
    return extent if extent > AT_REST * reach else reach


def reach_of(motion: Motion) -> float:
    """Return the largest coordinate of any point or link's origin in [m]; 1 if all lie at the origin."""
    paths = (*motion.points.values(), *motion.links.values())
    return float(max(np.abs(path.position).max() for path in paths)) or 1.0


def largest_acceleration(motion: Motion, reach: float) -> float:
    """Return the largest acceleration of the crank, or of any driver under motion laws, in [rad/s2].

    That of a sliding driver is divided by the reach, in [m].
    """
    largest = [float(np.abs(motion.acceleration).max())]
    for name in motion.drivers:
        joint = motion.joints[name]
        largest.append(float(np.abs(joint.acceleration).max()) / (1.0 if joint.unit == "rad" else reach))
    return max(largest)
