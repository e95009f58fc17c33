"""What a model says beside its geometry: limits, actuators, and how far its loops stand open."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND, IDENTITY, Link, Pose, Vector
from mechsim.simulation.mjcf_reader.driven_joints import acted_on
from mechsim.simulation.mjcf_reader.joint_chains import Chains
from mechsim.simulation.mjcf_reader.kinds import DRIVABLE


def coordinate_values(model: mujoco.MjModel, qpos: Array) -> dict[str, float]:
    """Return the values of the hinges and slides at qpos (nq,): joint -> [rad] or [m]."""
    return {
        model.joint(j).name: float(qpos[model.jnt_qposadr[j]])
        for j in range(model.njnt)
        if int(model.jnt_type[j]) in DRIVABLE
    }


def outlined(model: mujoco.MjModel, chained: Chains) -> tuple[Link, ...]:
    """Return the moving links; with their masses and geoms where all joints of each lie in one place."""
    places = {link.name: set[Vector]() for link in chained.links}
    for joint in chained.joints:
        for end in (joint.a, joint.b):
            places.setdefault(end.link, set()).add(end.point)
    places.pop(GROUND, None)
    if any(len(points) > 1 for points in places.values()):
        return chained.links
    held = {link.name: list[Vector]() for link in chained.links}
    for body, carrier in enumerate(chained.carriers):
        if carrier.link in held:
            places = [model.body_ipos[body], *_corners(model, body)]
            held[carrier.link] += [carrier.point(place) for place in places]
    return tuple(Link(link.name, tuple(held[link.name])) for link in chained.links)


def _corners(model: mujoco.MjModel, body: int) -> list[Array]:
    """Return two opposite corners of the box about each geom of a body, in the body's frame."""
    found: list[Array] = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        centre, half = np.split(model.geom_aabb[geom], 2)
        found += [
            model.geom_pos[geom] + turn.reshape(3, 3) @ corner for corner in (centre - half, centre + half)
        ]
    return found


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


def idle_ranges(spec: mujoco.MjSpec) -> list[str]:
    """Say which ranges of a specification limit nothing, because they do not go from low to high."""
    return [
        f"{kind} {part.name!r} has {called} {low:g} {high:g}, which MuJoCo takes as no limit: "
        "it goes from low to high"
        for kind, called, counts in _RANGES
        for part in getattr(spec, f"{kind}s")
        for low, high in [getattr(part, called)]
        if getattr(part, counts) == mujoco.mjtLimited.mjLIMITED_AUTO and not low < high and (low or high)
    ]


def actuators(model: mujoco.MjModel) -> dict[str, Sequence[str]]:
    """Return the joints on which each actuator acts."""
    return {
        model.actuator(a).name or f"actuator{a + 1}": acted_on(model, a)
        for a in range(len(model.actuator_trntype))
    }


def gap(joints: Sequence[Joint], poses: Mapping[str, Pose]) -> float:
    """Return how far apart the points of the joints that close loops are, the worst in [m]."""
    placed = {GROUND: IDENTITY, **poses}
    apart = [
        placed[joint.b.link].point(joint.b.point) - placed[joint.a.link].point(joint.a.point)
        for joint in joints
    ]
    return max((float(np.linalg.norm(one)) for one in apart), default=0.0)
