"""The joints of bodies: each body hangs on the one above by its joints, one after the other.

Between several joints of one body stand links of no extent, whose names begin with `UNSEEN`.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import KINDS, displaced
from mechsim.model.joints import End, Joint
from mechsim.model.links import EX, EZ, GROUND, IDENTITY, ORIGIN, UNSEEN, Link, Pose, Vector
from mechsim.simulation.mjcf_reader.kinds import OF_JOINT
from mechsim.simulation.mjcf_reader.link_places import Carrier, carriers, link_name, rotation, shifted, vector

# begins the name of a link between two joints of one body; no user sees it


@dataclass(frozen=True)
class Chains:
    """The moving links of a model and the joints of its tree, in the order of the model.

    Attributes:
        carriers: of every body.
        links: the moving links, those between joints of one body too.
        joints: one for each of the model's.
    """

    carriers: list[Carrier]
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]


def chains(model: mujoco.MjModel) -> Chains:
    """Return the links and joints of a model's tree; a hinge's angle is counted as in qpos."""
    found = carriers(model)
    links: list[Link] = []
    joints: list[Joint] = []
    for body in range(1, model.nbody):
        above = found[model.body_parentid[body]]
        near = Carrier(above.link, shifted(above.at, model.body_pos[body], model.body_quat[body]))
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        for j in range(first, first + count):
            last = j == first + count - 1
            name = model.joint(j).name
            far = Carrier(link_name(model, body) if last else f"{UNSEEN}{name}", IDENTITY)
            links.append(Link(far.link))
            joints.append(_joint(model, j, near, far))
            near = far
    return Chains(found, tuple(links), tuple(joints))


def _joint(model: mujoco.MjModel, j: int, near: Carrier, far: Carrier) -> Joint:
    kind = OF_JOINT[int(model.jnt_type[j])]
    name, row = model.joint(j).name, KINDS[kind]
    if row.floats:
        return Joint(name, kind, End(GROUND), End(far.link))
    point = model.jnt_pos[j]
    if row.ball:
        axes = (near.direction(np.array(axis)) for axis in (EZ, EX))
        return Joint(
            name, kind, End(near.link, near.point(point), *axes), End(far.link, vector(point), EZ, EX)
        )
    plain = End(far.link, vector(point), vector(model.jnt_axis[j]))
    axis, mark = np.array(plain.axis), np.array(plain.mark)
    zero = float(model.qpos0[model.jnt_qposadr[j]])
    start = -zero * axis if row.slides else np.zeros(3)
    a = End(near.link, near.point(point + start), near.direction(axis), near.direction(mark))
    turned = np.cos(zero) * mark + np.sin(zero) * np.cross(axis, mark)
    return Joint(
        name, kind, a, plain if row.slides else End(far.link, plain.point, plain.axis, vector(turned))
    )


def poses(model: mujoco.MjModel, chained: Chains, qpos: Array) -> dict[str, Pose]:
    """Return where the joints put the links at coordinates qpos (nq,)."""
    placed: dict[str, Pose] = {GROUND: IDENTITY}
    for j, joint in enumerate(chained.joints):
        near = placed[joint.a.link]
        frame = Pose(near.point(joint.a.point), near.rotation @ joint.a.frame)
        gap, turn = _displaced(joint, qpos[int(model.jnt_qposadr[j]) :])
        turned = frame.rotation @ turn @ joint.b.frame.T
        placed[joint.b.link] = Pose(frame.point(gap) - turned @ np.array(joint.b.point), turned)
    del placed[GROUND]
    return placed


def _displaced(joint: Joint, qpos: Array) -> tuple[Vector, Array]:
    """Return where side b of a joint stands in side a's frame at its own part of qpos."""
    kind = KINDS[joint.kind]
    if kind.floats:
        return vector(qpos[:3]), rotation(qpos[3:7])
    if kind.ball:
        return ORIGIN, rotation(qpos[:4])
    gap, turn = displaced(kind, (float(qpos[0]),), joint.cross_angle)
    return vector(gap), turn
