"""Data with which the page moves a platform to a prescribed pose, in full precision."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.model.joint_kinds import COLUMN, KINDS
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, Pose, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# coordinates of a platform, named as drivers are: of its reference point in [m], and Cardan angles in [rad]
POSE_COORDINATES = ("x", "y", "z", "rx", "ry", "rz")


def quaternions(rotation: Array) -> Array:
    """Return unit quaternions of rotations, (..., 3, 3) -> (..., 4), scalar first and not negative."""
    from scipy.spatial.transform import Rotation

    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat(canonical=True, scalar_first=True)
    return flat.reshape(*rotation.shape[:-2], 4)


@dataclass(frozen=True, slots=True)
class PlatformDrive:
    """A link that the page moves by its pose; the page solves the joints for it.

    Attributes:
        link: name of the platform.
        point: its reference point, in its own frame in [m].
        origin: name of that point; the link's own name for its origin.
        coordinates: those of `POSE_COORDINATES` that the drivers control.
        start: link -> pose in which the mechanism starts.
        limits: driver -> lowest and highest value in SI, where a file states them.
    """

    link: str
    point: Vector
    origin: str
    coordinates: tuple[str, ...]
    start: Mapping[str, Pose]
    limits: Mapping[str, tuple[float, float]]


def platform_data(mechanism: Mechanism, platform: PlatformDrive) -> dict[str, Any]:
    """Return what the page's solver reads, as plain data; links are numbered, the ground is -1."""
    links = [link.name for link in mechanism.links]
    joints = [joint.name for joint in mechanism.joints]
    return {
        "name": f"{platform.link} by its pose",
        "link": links.index(platform.link),
        "point": list(platform.point),
        "origin": platform.origin,
        "coordinates": list(platform.coordinates),
        "size": mechanism.size,
        "links": links,
        "start": [_pose(platform.start[link]) for link in links],
        "joints": [_joint(joint, links) for joint in mechanism.joints],
        "drivers": [
            {
                "name": driver.name,
                "joint": joints.index(driver.name),
                "unit": KINDS[driver.kind].units[0],
                "limits": list(platform.limits[driver.name]) if driver.name in platform.limits else None,
            }
            for driver in mechanism.driven_joints
        ],
    }


def _pose(pose: Pose) -> list[float]:
    return [*_exact(pose.position), *_exact(quaternions(pose.rotation))]


def _joint(joint: Joint, links: list[str]) -> dict[str, Any]:
    kind = KINDS[joint.kind]
    return {
        "a": _end(joint.a, links),
        "b": _end(joint.b, links),
        "slides": [COLUMN[axis] for axis in kind.slides],
        "turns": len(kind.turns),
        "cosine": float(np.cos(joint.cross_angle)),
    }


def _end(end: End, links: list[str]) -> dict[str, Any]:
    link = -1 if end.link == GROUND else links.index(end.link)
    return {"link": link, "point": list(end.point), "frame": _exact(end.frame.T)}


def _exact(values: Array) -> list[float]:
    """Return numbers that JSON writes with all their digits, in the order of their rows."""
    return [float(value) for value in np.ravel(values)]
