"""Tolerances of dimensions and clearances of joints, and their text form."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mechsim import units
from mechsim.errors import InputError, require_once
from mechsim.io.toml_values import suggestion
from mechsim.kinematics.designs import Dimension
from mechsim.mechanism.joint_kinds import KINDS, Kind, kinds_that
from mechsim.mechanism.mechanism import Mechanism
from mechsim.units import SI_UNITS, Unit, WrittenUnits

# suffix of a joint's name for its clearance
CLEARANCE = ".clearance"


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Bounds of dimensions and radial clearances of joints.

    Attributes:
        bounds: dimension -> largest deviation to either side, in SI.
        clearances: hinge or ball -> largest distance of its pin from the hole's centre, in [m].
    """

    bounds: Mapping[str, float]
    clearances: Mapping[str, float]


def parsed_tolerances(
    written: Mapping[str, str | float],
    dimensions: Mapping[str, Dimension],
    mechanism: Mechanism,
    declared: WrittenUnits = SI_UNITS,
) -> Tolerances:
    """Return tolerances from names and bounds, which may follow ± or +-.

    Args:
        written: dimension, or JOINT.clearance -> bound.
        dimensions: the known dimensions.
        mechanism: the mechanism that has the joints.
        declared: units of the model's file. Text without a unit is SI, and rejected where these differ.

    Raises:
        InputError: for an unknown name, or a bound that is not a positive finite number with a clear unit.
    """
    bounds: dict[str, float] = {}
    clearances: dict[str, float] = {}
    joints = {joint.name: joint for joint in mechanism.joints}
    for name, tolerance in written.items():
        if name.endswith(CLEARANCE):
            joint = name.removesuffix(CLEARANCE)
            if joint not in joints:
                raise InputError(f"{mechanism.name} has no joint {joint!r}{suggestion(joint, joints)}")
            if not _has_pin(KINDS[joints[joint].kind]):
                raise InputError(
                    f"joint {joint!r} is {joints[joint].kind}; radial clearances exist for "
                    f"{kinds_that(_has_pin)} joints only"
                )
            clearances[joint] = _tolerance(name, tolerance, "m", declared)
        elif name in dimensions:
            bounds[name] = _tolerance(name, tolerance, dimensions[name].unit, declared)
        else:
            raise InputError(f"{mechanism.name} has no dimension {name!r}{suggestion(name, dimensions)}")
    if not bounds and not clearances:
        raise InputError("no tolerance is given; write crank=±0.02mm")
    return Tolerances(bounds, clearances)


def _tolerance(name: str, written: str | float, unit: str, declared: WrittenUnits) -> float:
    if isinstance(written, str):
        si_unit: Unit = "m" if unit == "m" else "rad" if unit == "rad" else "1"
        text = written.strip().removeprefix("±").removeprefix("+-")
        units.require_written(text, si_unit, declared.declared(si_unit), f"tolerance of {name}")
        value = units.parse(text, si_unit, f"tolerance of {name}")
    else:
        value = float(written)
    if not 0.0 < value < np.inf:
        raise InputError(f"tolerance of {name} is {written}; give a number above 0, as ±0.02mm")
    return value


def _has_pin(kind: Kind) -> bool:
    return kind.hinge or (kind.ball and not kind.slides)


def written_tolerances(text: str, option: str = "--tolerances") -> dict[str, str]:
    """Return the tolerances of `--tolerances`: NAME=±BOUND,...

    Raises:
        InputError: for other text.
    """
    pairs = [[word.strip() for word in pair.partition("=")] for pair in text.split(",") if pair.strip()]
    for name, equals, _ in pairs:
        if not equals or not name:
            raise InputError(f"{option} has {name!r}, which is not NAME=BOUND; write crank=±0.02mm")
    if not pairs:
        raise InputError(f"{option} names no tolerance; write crank=±0.02mm")
    require_once(option, [name for name, _, _ in pairs])
    return {name: tolerance for name, _, tolerance in pairs}
