"""Forces of redundant actuators: minimum weighted norm for a prescribed motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mechsim.errors import InputError, first_names
from mechsim.kinetics.prescribed_motion import InverseDynamics, prescribed_along
from mechsim.numerics.arrays import Array


def actuator_forces(
    result: InverseDynamics, actuators: Sequence[str] | Mapping[str, float]
) -> dict[str, Array]:
    """Return the forces of actuators that together replace the drivers of a prescribed motion.

    Of all forces with the power of the drivers in every motion, those with the smallest sum of weighted
    squares are returned: tau = W^-1 J (J^T W^-1 J)^-1 tau_d, with the derivatives J of the actuated joints by
    the drivers. For as many actuators as drivers they are unique.

    Args:
        result: result of `prescribed`.
        actuators: joints with one coordinate, with a weight for each squared torque or force; the default
            weight is 1.

    Returns:
        Joint -> torque in [N m] or force in [N], (n,).

    Raises:
        InputError: for an unknown joint, a weight that is not above 0, or actuators that do not determine the
            motion.

    Source:
        Nakamura & Ghodoussi 1989, "Dynamics computation of closed-link robot mechanisms with nonredundant and
        redundant actuators", IEEE Transactions on Robotics and Automation 5(3).

    Example:
        >>> study = ms.dynamics.prescribed(model, t=times)
        >>> forces = ms.dynamics.actuator_forces(study, {"left": 1.0, "right": 1.0, "elbow_l": 4.0})
    """
    weights = dict(actuators) if isinstance(actuators, Mapping) else dict.fromkeys(actuators, 1.0)
    jacobian, drives = _actuator_jacobian(result, tuple(weights)), _drives(result)
    if not all(0.0 < weight < np.inf for weight in weights.values()):
        raise InputError(f"weights of actuators are {list(weights.values())}; give finite numbers above 0")
    root = np.sqrt(np.array(list(weights.values())))
    scaled = jacobian / root[:, None]
    if len(weights) < drives.shape[1] or np.linalg.matrix_rank(scaled).min() < drives.shape[1]:
        raise InputError(
            f"actuators {', '.join(weights)} do not determine the motion of {drives.shape[1]} degrees of "
            "freedom; name more"
        )
    least_norm = np.swapaxes(np.linalg.pinv(scaled), 1, 2) @ drives[..., None]
    return dict(zip(weights, (least_norm[..., 0] / root).T, strict=True))


def actuated(result: InverseDynamics, actuators: Sequence[str] | Mapping[str, float]) -> InverseDynamics:
    """Return a prescribed motion with the forces of actuators in place of the drivers', and its reactions.

    `forces.actuators` has the forces of `actuator_forces`. The drive torque and `forces.drives` remain those
    of the drivers alone.
    """
    forces, before = actuator_forces(result, actuators), result.forces
    after = prescribed_along(
        result.model, before.angle, before.speed, before.acceleration, time=before.time, actuators=forces
    )
    names = ("reactions", "sums", "gears", "meshes", "undetermined", "residual", "at_branch_point")
    changed = {name: getattr(after.forces, name) for name in names}
    return replace(result, forces=replace(before, actuators=forces, **changed))


def _drives(result: InverseDynamics) -> Array:
    """Return the torque or force of each driver, (n, m)."""
    drives = result.forces.drives
    names = result.model.mechanism.drivers
    return np.stack([drives[name] for name in names], 1) if drives else result.forces.torque[:, None]


def _actuator_jacobian(result: InverseDynamics, names: Sequence[str]) -> Array:
    """Return the derivatives of joint coordinates by the drivers at the instants of a result, (n, a, m)."""
    solver, parameter = result.model.solver, result.forces.angle
    if solver.motion_laws.crank:
        moving = [solver.solve_along(parameter)]
    else:
        still = solver.solve_along(parameter, 0.0, 0.0)
        moving = []
        for driver in solver.mechanism.drivers:
            rates = {
                name: replace(still.joints[name], rate=np.full(len(parameter), float(name == driver)))
                for name in solver.mechanism.drivers
            }
            moving.append(solver.solve_as(replace(still, joints={**still.joints, **rates})))
    joints = moving[0].joints
    for name in names:
        if name not in joints:
            raise InputError(f"{solver.name} has no joint coordinate {name!r}; it has {first_names(joints)}")
    return np.stack([[motion.joints[name].rate for name in names] for motion in moving]).transpose(2, 1, 0)
