"""Which link carries each body: bodies without joints are part of the nearest one above that has some."""

from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.model.links import GROUND, IDENTITY, Pose, Vector
from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True)
class Carrier:
    """The link that a body is part of, and where the body's frame is in the link's."""

    link: str
    at: Pose

    def point(self, local: Array) -> Vector:
        """Return the place of a body's point in the link's frame, in [m]."""
        return vector(self.at.point(vector(local)))

    def direction(self, local: Array) -> Vector:
        """Return a body's direction in the link's frame."""
        return vector(self.at.rotation @ local)


def carriers(model: mujoco.MjModel) -> list[Carrier]:
    """Return the carrier of every body, the world first."""
    result = [Carrier(GROUND, IDENTITY)]
    for body in range(1, model.nbody):
        if model.body_jntnum[body]:
            result.append(Carrier(link_name(model, body), IDENTITY))
        else:
            parent = result[model.body_parentid[body]]
            result.append(
                Carrier(parent.link, shifted(parent.at, model.body_pos[body], model.body_quat[body]))
            )
    return result


def link_name(model: mujoco.MjModel, body: int) -> str:
    """Return what the link of a body is called: as the body, unless that is called as the frame."""
    name = model.body(body).name
    return f"{name}_body" if name == GROUND else name


def shifted(pose: Pose, position: Array, quaternion: Array) -> Pose:
    """Return the pose of a frame given in another frame's, that one being at `pose`."""
    return Pose(pose.position + pose.rotation @ position, pose.rotation @ rotation(quaternion))


def rotation(quaternion: Array) -> Array:
    """Return the rotation matrix of a quaternion (w, x, y, z), (3, 3)."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def vector(values: Array) -> Vector:
    """Return three numbers as a point or direction."""
    x, y, z = (float(value) for value in values)
    return x, y, z
