"""What a model says beside its geometry: limits, actuators, and how far its loops stand open."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from mechsim.model.joints import Joint
from mechsim.model.links import GROUND, IDENTITY, Link, Pose, Vector
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.driven_joints import actuated_joints
from mechsim.simulation.mjcf_reader.joint_chains import KinematicTree
from mechsim.simulation.mjcf_reader.joint_types import DRIVABLE


def coordinate_values(model: mujoco.MjModel, qpos: Array) -> dict[str, float]:
    """Return the values of the hinges and slides at qpos (nq,): joint -> [rad] or [m]."""
    return {
        model.joint(j).name: float(qpos[model.jnt_qposadr[j]])
        for j in range(model.njnt)
        if int(model.jnt_type[j]) in DRIVABLE
    }


def with_outlines(model: mujoco.MjModel, chain: KinematicTree) -> tuple[Link, ...]:
    """Return the moving links; with their masses and geoms where all joints of each lie in one place."""
    joint_points = {link.name: set[Vector]() for link in chain.links}
    for joint in chain.joints:
        for end in (joint.a, joint.b):
            joint_points.setdefault(end.link, set()).add(end.point)
    joint_points.pop(GROUND, None)
    if any(len(points) > 1 for points in joint_points.values()):
        return chain.links
    outlines = {link.name: list[Vector]() for link in chain.links}
    for body, carrier in enumerate(chain.carriers):
        if carrier.link in outlines:
            joint_points = [model.body_ipos[body], *_corners(model, body)]
            outlines[carrier.link] += [carrier.point(place) for place in joint_points]
    return tuple(Link(link.name, tuple(outlines[link.name])) for link in chain.links)


def _corners(model: mujoco.MjModel, body: int) -> list[Array]:
    """Return two opposite corners of the box about each geom of a body, in the body's frame."""
    corners: list[Array] = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        centre, half = np.split(model.geom_aabb[geom], 2)
        corners += [
            model.geom_pos[geom] + rotation.reshape(3, 3) @ corner
            for corner in (centre - half, centre + half)
        ]
    return corners


def limits(model: mujoco.MjModel) -> dict[str, tuple[float, float]]:
    """Return the ranges of the limited hinges and slides, in [rad] or [m]; none where limits are off."""
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return {}
    return {
        model.joint(j).name: (float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1]))
        for j in range(model.njnt)
        if model.jnt_limited[j] and int(model.jnt_type[j]) in DRIVABLE
    }


# what may have a range: where the specification lists it, and what says there whether it counts
_RANGES = (
    ("joint", "range", "limited"),
    ("tendon", "range", "limited"),
    ("actuator", "ctrlrange", "ctrllimited"),
    ("actuator", "forcerange", "forcelimited"),
)


def ignored_ranges(spec: mujoco.MjSpec) -> list[str]:
    """Say which ranges of a specification limit nothing, because they do not go from low to high."""
    return [
        f"{kind} {element.name!r} has {attribute} {low:g} {high:g}, which MuJoCo takes as no limit: "
        "it goes from low to high"
        for kind, attribute, flag in _RANGES
        for element in getattr(spec, f"{kind}s")
        for low, high in [getattr(element, attribute)]
        if getattr(element, flag) == mujoco.mjtLimited.mjLIMITED_AUTO and not low < high and (low or high)
    ]


def actuators(model: mujoco.MjModel) -> dict[str, Sequence[str]]:
    """Return the joints on which each actuator acts."""
    return {
        model.actuator(a).name or f"actuator{a + 1}": actuated_joints(model, a)
        for a in range(len(model.actuator_trntype))
    }


def largest_gap(joints: Sequence[Joint], poses: Mapping[str, Pose]) -> float:
    """Return how far apart the points of the joints that close loops are, the worst in [m]."""
    frames = {GROUND: IDENTITY, **poses}
    offsets = [
        frames[joint.b.link].point(joint.b.point) - frames[joint.a.link].point(joint.a.point)
        for joint in joints
    ]
    return max((float(np.linalg.norm(offset)) for offset in offsets), default=0.0)
