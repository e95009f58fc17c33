"""Masses of a model: a link's own inertia about its principal axes, or a placeholder."""

from typing import Any

import mujoco
import numpy as np

from mechsim.model.links import Inertia
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# mass of a link x size of its mechanism where only motion counts, in [kg m]
PLACEHOLDER = 0.1


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix."""
    out = np.empty(4)
    mujoco.mju_mat2Quat(out, np.ascontiguousarray(rotation, dtype=np.float64).ravel())
    return out


def set_inertia(body: mujoco.MjsBody, inertia: Inertia) -> None:
    """Give a body mass, centre and principal moments."""
    body.explicitinertial = True
    body.mass, body.ipos = inertia.mass, inertia.centre
    body.iquat, body.inertia = principal(inertia)


def principal(inertia: Inertia) -> tuple[Array, Array]:
    """Return the quaternion of the principal axes and the moments about them, (4,) and (3,)."""
    moments = inertia.matrix
    rotation = np.eye(3)
    values = np.diag(moments).copy()
    if np.count_nonzero(moments - np.diag(values)):
        values, rotation = np.linalg.eigh(moments)
        rotation[:, 2] *= np.sign(np.linalg.det(rotation))
    # the largest of a flat body may exceed the sum of the others by rounding, which MuJoCo refuses
    largest = int(np.argmax(values))
    values[largest] = min(values[largest], values.sum() - values[largest])
    return quaternion(rotation), values


def set_placeholder(body: mujoco.MjsBody, mechanism: Mechanism, link: str) -> None:
    """Give a link a placeholder inertia: a ball about the middle of its joints, 1 kg in a linkage of 0.1 m.

    Under a prescribed crank no motion depends on it; a ball of the link's own size keeps the mass
    matrix well conditioned whatever the scale. MuJoCo takes a moment of inertia below 1e-15 (mjMINVAL)
    for zero: with a mass inverse to the size it stays far from that for linkages down to 1e-8 m.
    """
    points = np.array([end.point for end in mechanism.ends(link)])
    body.explicitinertial = True
    body.mass, body.ipos, moment = placeholder(points, mechanism.size)
    body.inertia = np.full(3, moment)


def placeholder(points: Array, length: float | Array) -> tuple[Any, Array, Any]:
    """Return mass, centre and moment of a placeholder.

    Args:
        points: of the joints on a link, (k, 3) in [m], or (k, 3, d) of d designs.
        length: of the mechanism, in [m], or (d,).
    """
    centre = (points.min(0) + points.max(0)) / 2.0
    radius = np.maximum(np.linalg.norm(points - centre, axis=1).max(0), 0.1 * length)
    mass = PLACEHOLDER / length
    return mass, centre, 0.4 * mass * radius**2
