"""Intervals of a mechanism's joints within the tolerances of its dimensions."""

from collections.abc import Mapping

import numpy as np

from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array


def joint_radii(designs: DesignFamily, bounds: Mapping[str, float]) -> dict[str, Array]:
    """Return JOINT.a and JOINT.b -> radii of point, axis and mark, (3, 3), within bounds of dimensions.

    Each dimension is moved by its bound to either side; the radius adds the larger deviation and the
    difference of both, which bounds the curvature. The certificate holds for the joints in these radii.

    Raises:
        InputError: for a dimension that changes more than points and axes of joints.
    """
    nominal = designs.describe({})
    total = {key: np.zeros((3, 3)) for key in _joint_numbers(nominal)}
    for name, tolerance in bounds.items():
        value = designs.dimensions[name].value
        moved = [designs.describe({name: value + sign * tolerance}) for sign in (-1.0, 1.0)]
        if any(_without_joints(mechanism) != _without_joints(nominal) for mechanism in moved):
            raise InputError(
                f"dimension {name} changes a coupling, a lock or a kind of joint; "
                "a certificate holds within tolerances of points and axes only: leave it out of --within"
            )
        low, high = (_joint_numbers(mechanism) for mechanism in moved)
        for key, start in _joint_numbers(nominal).items():
            down, up = low[key] - start, high[key] - start
            total[key] += np.maximum(np.abs(down), np.abs(up)) + np.abs(down + up)
    return {key: radii for key, radii in total.items() if radii.any()}


def _joint_numbers(mechanism: Mechanism) -> dict[str, Array]:
    return {
        f"{joint.name}.{side}": np.array([end.point, end.axis, end.reference])
        for joint in mechanism.joints
        for side, end in (("a", joint.a), ("b", joint.b))
    }


def _without_joints(mechanism: Mechanism) -> object:
    """Return what of a mechanism tolerances may not change."""
    joints = [(joint.name, joint.kind, joint.cross_angle, joint.lead) for joint in mechanism.joints]
    return joints, mechanism.laws, dict(mechanism.locked), mechanism.drivers
