"""Derivatives of drive torques and joint reactions by dimensions, for the same motion of the drivers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.kinematics.derivatives.dimensions import numbers_in, numbers_of, renumbered
from mechsim.kinematics.derivatives.motion import TracedMotion
from mechsim.kinetics.applied_forces import STILL
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.prescribed_motion import InverseDynamics, moved_as, times_along
from mechsim.kinetics.unit_motion import from_motion
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import change_of, stepped


@dataclass(frozen=True, slots=True)
class EffortDerivatives:
    """Forces and their derivatives by dimensions, as columns of a table in SI.

    Attributes:
        columns: name -> values, (n,), named as in `InverseDynamics.columns`.
        by: dimension -> derivatives of the columns, in SI per SI unit of the dimension.
    """

    columns: Mapping[str, Array]
    by: Mapping[str, Mapping[str, Array]]


def forces_along(
    model: DynamicModel,
    followed: TracedMotion,
    change: Mapping[str, Array | None],
    speed: ArrayLike = 1.0,
    acceleration: ArrayLike = 0.0,
) -> EffortDerivatives:
    """Return drive forces and reactions along a motion, and their exact derivatives by dimensions.

    Args:
        model: dynamic model: mechanism with masses, and its forces.
        followed: the motion, at unit rate of the path parameter.
        change: dimension -> derivatives of `model_numbers`, from `changes`; None for the derivative by the
            driver positions themselves, if no load depends on their angle.
        speed: rate of the path parameter, scalar or (n,) in [rad/s].
        acceleration: its second derivative, scalar or (n,) in [rad/s2].

    Raises:
        AssemblyError: as `motion_derivatives`.

    Accuracy: about 1e-15 times the condition number of the loops.
    """
    followed = replace(followed, mechanism=model.mechanism)
    study = perturbed_forces(model, followed.motion(), speed, acceleration)
    by: dict[str, dict[str, Array]] = {}
    acting = numbers_in(model.forces)
    for name, derivative in change.items():
        own, others = _split(derivative, len(acting))
        mechanism, motion = followed.changed(name, own)
        forces = renumbered(model.forces, stepped(acting, others))
        moved = replace(model, mechanism=mechanism, forces=forces)
        forces_moved = perturbed_forces(moved, motion, speed, acceleration, model.mechanism)
        by[name] = {column: change_of(values) for column, values in forces_moved.columns()}
    return EffortDerivatives(dict(study.columns()), by)


def _split(derivative: Array | None, acting: int) -> tuple[Array | None, Array]:
    """Return changes of the numbers of a mechanism, and of its forces."""
    if derivative is None:
        return None, np.zeros(acting)
    return derivative[: len(derivative) - acting], derivative[len(derivative) - acting :]


def model_numbers(mechanism: Mechanism, forces: Forces) -> Array:
    """Return the numbers of a mechanism with masses and of its forces, (k,) in SI."""
    return np.concatenate([numbers_of(mechanism), numbers_in(forces)])


def perturbed_forces(
    model: DynamicModel,
    motion: Motion,
    speed: ArrayLike,
    acceleration: ArrayLike = 0.0,
    nominal: Mechanism | None = None,
) -> InverseDynamics:
    """Return the inverse dynamics of a model with a given motion at unit speed of its crank.

    Args:
        model: the dynamic model.
        motion: its motion at unit rate of the path parameter, complex or real.
        speed: scalar or (n,) in [rad/s].
        acceleration: scalar or (n,) in [rad/s2].
        nominal: the unperturbed mechanism, if that of the model has complex steps.
    """
    speed, acceleration = (
        np.broadcast_to(np.asarray(rate, dtype=np.float64), motion.angle.shape)
        for rate in (speed, acceleration)
    )
    standing = np.abs(speed) <= STILL * np.abs(speed).max()
    unit = from_motion(model.mechanism, motion, nominal)
    times = times_along(model, motion.angle, speed, acceleration)
    return moved_as(model, unit, speed, acceleration, times, standing)
