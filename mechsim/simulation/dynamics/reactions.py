"""Joint reactions, from the forces that MuJoCo propagates through the tree and from the loop constraints."""

from collections.abc import Mapping

import numpy as np

from mechsim.mechanism.force_record import Reaction
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Joint
from mechsim.numerics.arrays import Array, cross
from mechsim.simulation.dynamics.applied_forces import rod_force, thread_forces
from mechsim.simulation.dynamics.loaded_model import LoadedModel


def transmitted(
    loaded: LoadedModel, joint: Joint, fields: Mapping[str, Array], multipliers: Array
) -> Reaction:
    """Return the reaction of a joint, without the components that rigid links leave undetermined.

    Args:
        loaded: the mechanism and its forces.
        joint: one of its joints, in the tree or cut.
        fields: MuJoCo's fields of a model in which all forces act as wrenches on bodies.
        multipliers: of the loop constraints, (n, m); each acts on a pair's first point, which is on link a.
    """
    rod = loaded.rods.get(joint.name)
    if rod is not None:
        row = loaded.loops.rod_rows.start + rod
        force, points = rod_force(fields, loaded.loops.rods[rod], multipliers[:, row])
        return Reaction(
            link=joint.b.link, by=joint.a.link, force=-force, moment=np.zeros_like(force), point=points[1]
        )
    axes = fields["xmat"].reshape(len(multipliers), -1, 3, 3)
    proximal, distal = loaded.ends(joint)
    first, second = loaded.body(proximal), loaded.body(distal)
    point = fields["xpos"][:, second] + axes[:, second] @ np.asarray(joint.b.point)
    numbers = loaded.cut_pairs(joint)
    if numbers:
        force, moment = np.zeros((2, len(point), 3))
        for number in numbers:
            on_second = -multipliers[:, 3 * number : 3 * number + 3]
            body, local = loaded.loops.pairs[number].ends[1]
            force += on_second
            moment += cross(fields["xpos"][:, body] + axes[:, body] @ local - point, on_second)
        moment += _welding(loaded, joint, axes, multipliers)
    else:
        below = loaded.parent(distal) == proximal
        body, sign = (second, 1.0) if below else (first, -1.0)
        wrench = sign * fields["cfrc_int"][:, body]  # on the child by its parent: moment, force
        root = fields["subtree_com"][:, loaded.model.body_rootid[body]]
        force = wrench[:, 3:]
        moment = wrench[:, :3] + cross(root - point, force)
    force, moment = _constraint_part(joint, axes[:, first], axes[:, second], force, moment)
    for along, about in thread_forces(loaded, joint, multipliers):
        axis = axes[:, second] @ np.asarray(joint.b.axis)
        force, moment = force + along[:, None] * axis, moment + about[:, None] * axis
    return Reaction(link=joint.b.link, by=joint.a.link, force=force, moment=moment, point=point)


def _welding(loaded: LoadedModel, joint: Joint, axes: Array, multipliers: Array) -> Array:
    """Return the moment on link b that keeps frames parallel at a cut joint, (n, 3)."""
    number = loaded.welded(joint)
    if number is None:
        return np.zeros((len(axes), 3))
    pair, first = loaded.loops.frames[number], loaded.loops.frame_rows.start + 3 * number
    rate = pair.rotation_error(*(axes[:, body] for body in pair.bodies))[1]
    return -(np.swapaxes(rate, 1, 2) @ multipliers[:, first : first + 3, None])[..., 0]


def _constraint_part(
    joint: Joint, rotation_a: Array, rotation_b: Array, force: Array, moment: Array
) -> tuple[Array, Array]:
    """Return force and moment without the components along the degrees of freedom of a joint."""
    kind = KINDS[joint.kind]
    frame_a, axis_b = rotation_a @ joint.a.frame, rotation_b @ np.asarray(joint.b.axis)
    for axis in kind.slides:
        force = _across(frame_a[..., COLUMN[axis]], force)
    if kind.ball:
        return force, np.zeros_like(moment)
    if kind.crossed:
        normal = cross(frame_a[..., 2], axis_b)
        normal = normal / np.sqrt((normal**2).sum(1))[:, None]
        return force, normal * (normal * moment).sum(1)[:, None]
    return force, _across(axis_b, moment) if kind.turns else moment


def _across(axis: Array, vector: Array) -> Array:
    """Return the components of vectors perpendicular to unit axes, (n, 3)."""
    return vector - axis * (axis * vector).sum(1)[:, None]
