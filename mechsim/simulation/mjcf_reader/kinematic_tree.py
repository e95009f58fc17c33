"""Links and joints of a model's kinematic tree.

Virtual links, whose names begin with `VIRTUAL_PREFIX`, lie between several joints of one body.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mechsim.mechanism.joint_kinds import KINDS, KindName, displaced
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import (
    EX,
    EZ,
    GROUND,
    IDENTITY,
    ORIGIN,
    VIRTUAL_PREFIX,
    Link,
    Pose,
    Vector,
    vector,
)
from mechsim.numerics.arrays import Array
from mechsim.simulation.state import BALL, FREE, HINGE, SLIDE, rotation_matrix


@dataclass(frozen=True, slots=True)
class Carrier:
    """The link that a body belongs to, and the pose of the body in the link."""

    link: str
    pose: Pose

    def point(self, local: Array) -> Vector:
        """Return the position of a body's point in the link's frame, in [m]."""
        return vector(self.pose.point(vector(local)))

    def direction(self, local: Array) -> Vector:
        """Return a body's direction in the link's frame."""
        return vector(self.pose.rotation @ local)


def carriers(model: mujoco.MjModel) -> list[Carrier]:
    """Return the carrier of every body, the world first."""
    result = [Carrier(GROUND, IDENTITY)]
    for body in range(1, model.nbody):
        if model.body_jntnum[body]:
            result.append(Carrier(link_name(model, body), IDENTITY))
        else:
            parent = result[model.body_parentid[body]]
            pose = shifted(parent.pose, model.body_pos[body], model.body_quat[body])
            result.append(Carrier(parent.link, pose))
    return result


def link_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body's link: the name of the body, unless the link is the ground."""
    name = model.body(body).name
    return f"{name}_body" if name == GROUND else name


def shifted(pose: Pose, position: Array, quaternion: Array) -> Pose:
    """Return the pose of a frame whose position and quaternion are relative to a frame at `pose`."""
    return Pose(pose.position + pose.rotation @ position, pose.rotation @ rotation_matrix(quaternion))


OF_JOINT: dict[int, KindName] = {
    HINGE: "revolute",
    SLIDE: "prismatic",
    BALL: "spherical",
    FREE: "floating",
}
# kinds of loop-closing joints: points coincide; points and frames coincide
POINTS: KindName = "spherical"
FRAMES: KindName = "fixed"


@dataclass(frozen=True)
class KinematicTree:
    """The moving links of a model and the joints of its tree, in the order of the model.

    Attributes:
        carriers: carriers of all bodies.
        links: the moving links, including virtual links.
        joints: one joint for each joint of the model.
    """

    carriers: list[Carrier]
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


def kinematic_tree(model: mujoco.MjModel) -> KinematicTree:
    """Return the links and joints of a model's tree; the angle of a hinge is that of qpos."""
    body_carriers = carriers(model)
    links: list[Link] = []
    joints: list[Joint] = []
    for body in range(1, model.nbody):
        parent = body_carriers[model.body_parentid[body]]
        end = Carrier(parent.link, shifted(parent.pose, model.body_pos[body], model.body_quat[body]))
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for j in range(first, first + count):
            last = j == first + count - 1
            name = model.joint(j).name
            next_carrier = Carrier(link_name(model, body) if last else f"{VIRTUAL_PREFIX}{name}", IDENTITY)
            links.append(Link(next_carrier.link))
            joints.append(_joint(model, j, end, next_carrier))
            end = next_carrier
    return KinematicTree(body_carriers, tuple(links), tuple(joints))


def _joint(model: mujoco.MjModel, j: int, parent: Carrier, child: Carrier) -> Joint:
    kind = OF_JOINT[int(model.jnt_type[j])]
    name, joint_kind = model.joint(j).name, KINDS[kind]
    if joint_kind.floating:
        return Joint(name, kind, End(GROUND), End(child.link))
    point = model.jnt_pos[j]
    if joint_kind.ball:
        a = End(parent.link, parent.point(point), *(parent.direction(np.array(axis)) for axis in (EZ, EX)))
        return Joint(name, kind, a, End(child.link, vector(point), EZ, EX))
    b = End(child.link, vector(point), vector(model.jnt_axis[j]))
    axis, reference = np.array(b.axis), np.array(b.reference)
    zero = float(model.qpos0[model.jnt_qposadr[j]])
    if joint_kind.slides:
        point = point - zero * axis
    else:
        direction = np.cos(zero) * reference + np.sin(zero) * np.cross(axis, reference)
        b = replace(b, reference=vector(direction))
    a = End(parent.link, parent.point(point), parent.direction(axis), parent.direction(reference))
    return Joint(name, kind, a, b)


def poses(model: mujoco.MjModel, tree: KinematicTree, qpos: Array) -> dict[str, Pose]:
    """Return the poses of the links at a state, (nq,)."""
    frames: dict[str, Pose] = {GROUND: IDENTITY}
    for j, joint in enumerate(tree.joints):
        parent = frames[joint.a.link]
        frame = Pose(parent.point(joint.a.point), parent.rotation @ joint.a.frame)
        shift, relative = _displaced(joint, qpos[int(model.jnt_qposadr[j]) :])
        rotation_ = frame.rotation @ relative @ joint.b.frame.T
        frames[joint.b.link] = Pose(frame.point(shift) - rotation_ @ np.array(joint.b.point), rotation_)
    del frames[GROUND]
    return frames


def _displaced(joint: Joint, qpos: Array) -> tuple[Vector, Array]:
    """Return the position and rotation of side b of a joint in side a, at the joint's entries of qpos."""
    kind = KINDS[joint.kind]
    if kind.floating:
        return vector(qpos[:3]), rotation_matrix(qpos[3:7])
    if kind.ball:
        return ORIGIN, rotation_matrix(qpos[:4])
    shift, rotation_ = displaced(kind, (float(qpos[0]),), joint.cross_angle)
    return vector(shift), rotation_
