"""Dry friction that MuJoCo does not model: actuators whose controls oppose their own velocities.

MuJoCo's own dry friction acts on single coordinates: on a hinge or a slide, or on a sum of hinge angles. The
friction of a ball joint opposes its spin and does not act about three separate axes. Ball joints, and
revolute joints at which a spatial loop is cut, therefore have controls. These are exact while the joint
moves; they do not hold a joint at rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.forces import Friction
from mechsim.numerics.arrays import TINY, Array
from mechsim.simulation.mjcf.force_elements import AXES, coulomb_name


@dataclass(frozen=True, slots=True)
class DryJoint:
    """The dry friction of one joint: its name, indices of its actuators, and its magnitude in [N m]."""

    joint: str
    actuators: NDArray[np.int64]
    magnitude: float


def dry_frictions(model: mujoco.MjModel, friction: Sequence[Friction]) -> list[DryJoint]:
    """Return the joints of a model whose dry friction acts by controls."""
    indices = {model.actuator(i).name: i for i in range(model.nu)}
    joints = []
    for row in friction:
        numbers = [indices[name] for axis in AXES if (name := f"{coulomb_name(row.joint)}.{axis}") in indices]
        if numbers:
            joints.append(DryJoint(row.joint, np.array(numbers, dtype=np.int64), row.coulomb))
    return joints


def oppose(dry: Sequence[DryJoint], velocity: Array, controls: Array) -> None:
    """Set the controls (n, nu) that oppose the velocities of actuators (n, nu).

    Args:
        dry: the frictions.
        velocity: of all actuators, in [rad/s].
        controls: of all actuators; those of dry friction are set.
    """
    for joint in dry:
        rate = velocity[:, joint.actuators]
        fast = np.sqrt((rate * rate).sum(1))[:, None]
        controls[:, joint.actuators] = -joint.magnitude * rate / np.maximum(fast, TINY)
