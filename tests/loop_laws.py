"""Laws that hold for the motion of any mechanism, shared by tests."""

import numpy as np
from strategies import CLOSED, EPS, longest

import mechsim as ms
from mechsim.kinematics.loops.record import joint_motions, tracked_points
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import LinkMotion
from mechsim.numerics.rank import least_norm


def agrees_with_loop_equations(linkage: KinematicSolver, motion: ms.Motion, slack: float = 1.0) -> None:
    """Assert that a motion satisfies the loop equations and their derivatives."""
    mechanism = linkage.mechanism
    poses = {name: ms.Pose(link.position, link.rotation) for name, link in motion.links.items()}
    length_residual, angle_residual = ms.loops.residual_norms(mechanism, poses, motion.angle)
    assert length_residual.max() <= slack * CLOSED * longest(linkage)
    assert angle_residual.max() <= slack * 32 * EPS
    exact = rates_by_six_coordinates(mechanism, poses, motion.angle, motion.speed, motion.acceleration)
    assert motion.joints.keys() == exact.joints.keys()
    square = float((motion.speed**2).max())
    for kind in ("points", "links", "joints"):
        for name, measured in getattr(motion, kind).items():
            expected = getattr(exact, kind)[name]
            for quantity in measured.__dataclass_fields__:
                if quantity in ("unit", "index") or (name in motion.spinning and "angular" in quantity):
                    continue
                difference = getattr(measured, quantity) - getattr(expected, quantity)
                if quantity == "value" and measured.unit == "rad":
                    difference = difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi))
                angle = (
                    "angular" in quantity or quantity == "rotation" or getattr(measured, "unit", "m") == "rad"
                )
                unit = 1.0 if angle else longest(linkage)
                if quantity in ("position", "rotation", "value"):
                    assert np.abs(difference).max() <= 1e-13 * unit, (kind, name, quantity)
                else:
                    scale = max(np.abs(getattr(expected, quantity)).max(), square * unit)
                    assert np.abs(difference).max() <= 1e-10 * scale, (kind, name, quantity)


def rates_by_six_coordinates(
    mechanism: ms.Mechanism,
    poses: dict[str, ms.Pose],
    angle: np.ndarray,
    speed: np.ndarray,
    acceleration: np.ndarray,
) -> ms.Motion:
    """Return the motion at closed poses by the equations of six coordinates a link, differentiated twice.

    Passive freedoms, such as the spin of an unguided coupler, get the least rates that agree.
    """
    names, columns = [link.name for link in mechanism.links], mechanism.characteristic_length * np.ones(6)
    columns[3:] = 1.0
    twists, derivatives = None, []
    for driven in (speed, acceleration):
        rows = ms.loops.equations(mechanism, poses, angle, twists)
        right = -rows.bias if derivatives else np.zeros_like(rows.residual)
        right[:, -1] += driven
        units = np.tile(columns, len(names))
        derivatives.append((units * least_norm(rows.jacobian * units, right)).reshape(len(angle), -1, 6))
        twists = {name: derivatives[0][:, i] for i, name in enumerate(names)}
    links = {
        name: LinkMotion(
            poses[name].position,
            poses[name].rotation,
            *(d[:, i, k : k + 3] for d in derivatives for k in (0, 3)),
        )
        for i, name in enumerate(names)
    }
    joints = {name: item for joint in mechanism.joints for name, item in joint_motions(joint, links).items()}
    points = tracked_points(mechanism, links)
    return ms.Motion("loop equations", angle, speed, acceleration, points, links, joints)
