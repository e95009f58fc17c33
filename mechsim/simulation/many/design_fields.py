"""The models of designs as fields of one model: what the generator and MuJoCo's compiler make of each."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from mujoco import batch

from mechsim.model.design_arrays import DesignArrays
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.body_inertia import PLACEHOLDER, placeholder, principal
from mechsim.simulation.mjcf.generator import DRIVE_INERTIA_RATIO
from mechsim.simulation.mjcf.joints import (
    CRANK,
    Branch,
    EndArrays,
    coincident_points,
    model_joints,
    seated_pose,
)
from mechsim.simulation.mjcf.loop_cuts import Tree

Fields = dict[str, Array]
BODY = int(mujoco.mjtSameFrame.mjSAMEFRAME_BODY)
INERTIA = int(mujoco.mjtSameFrame.mjSAMEFRAME_INERTIA)
INERTIA_TURN = int(mujoco.mjtSameFrame.mjSAMEFRAME_INERTIAROT)
NONE = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


def seated_fields(
    model: mujoco.MjModel, tree: Tree, arrays: DesignArrays, poses: Mapping[str, Pose]
) -> tuple[Fields, Array]:
    """Return where bodies and joints of designs are when links stand as in some poses, and those states.

    Args:
        model: of one of the designs; it says which body and joint has which number.
        tree: of its loops, cut.
        arrays: the designs.
        poses: link -> (d, 3) and (d, 3, 3).

    Returns:
        Fields of the model, (d, ...) each, in whose reference configuration the tree's joints have taken
        their coordinates from the poses; and that configuration, (d, nq).
    """
    count = arrays.count
    names = ("body_pos", "body_quat", "jnt_pos", "jnt_axis")
    fields: Fields = {name: np.repeat(getattr(model, name)[None], count, 0) for name in names}
    qpos = np.repeat(model.qpos0[None], count, 0)
    placed = {GROUND: IDENTITY}
    for one in tree.branches:
        branch, link = _branch(one, arrays), one.child.link
        parent = placed[branch.parent.link]
        local, values = seated_pose(branch, parent, poses[link])
        body = model.body(link).id
        fields["body_pos"][:, body] = local.position
        fields["body_quat"][:, body] = quaternions(local.rotation)
        for made in model_joints(tree.mechanism, branch, local, values):
            joint = model.joint(made.name).id
            fields["jnt_pos"][:, joint], fields["jnt_axis"][:, joint] = made.place, made.axis
            if made.value is not None:
                qpos[:, model.jnt_qposadr[joint]] = made.value
        along = (parent.rotation @ local.position[..., None])[..., 0]
        placed[link] = Pose(parent.position + along, parent.rotation @ local.rotation)
    return fields, qpos


def _branch(branch: Branch, arrays: DesignArrays) -> Branch:
    """Return a joint of the tree as all designs have it."""
    point_a, frame_a, point_b, frame_b = arrays.sides()[branch.joint.name]
    a = EndArrays(branch.joint.a.link, point_a, frame_a)
    b = EndArrays(branch.joint.b.link, point_b, frame_b)
    return Branch(branch.joint, *((a, b) if branch.sense > 0 else (b, a)), branch.sense)


def site_fields(model: mujoco.MjModel, tree: Tree, arrays: DesignArrays) -> Fields:
    """Return where the sites of designs are, (d, nsite, 3): tracked points, and points that close loops."""
    places = np.repeat(model.site_pos[None], arrays.count, 0)
    for name, place in arrays.points.items():
        places[:, model.site(name).id] = place.T
    known = {model.site(i).name for i in range(model.nsite)}
    for joint in tree.cuts:
        point_a, frame_a, point_b, frame_b = arrays.ends[joint.name]
        heights = coincident_points(KINDS[joint.kind]) or ()
        for suffix, height in zip(("", "+"), heights, strict=False):
            for end, point, frame in ((joint.a, point_a, frame_a), (joint.b, point_b, frame_b)):
                name = f"{joint.name}@{end.link}{suffix}"
                if name in known:
                    places[:, model.site(name).id] = (point + height * arrays.size * frame[:, 2]).T
    return {"site_pos": places}


def placeholder_fields(model: mujoco.MjModel, arrays: DesignArrays) -> Fields:
    """Return the placeholder inertias of designs, and their cranks' flywheels, as the generator has them."""
    names = ("body_mass", "body_ipos", "body_inertia", "dof_armature")
    fields: Fields = {name: np.repeat(getattr(model, name)[None], arrays.count, 0) for name in names}
    size = arrays.size
    for link in arrays.mechanism.links:
        body = model.body(link.name).id
        mass, centre, moment = placeholder(arrays.on(link.name), size)
        fields["body_mass"][:, body], fields["body_ipos"][:, body] = mass, centre.T
        fields["body_inertia"][:, body] = moment[:, None]
    crank = model.jnt_dofadr[model.joint(CRANK).id]
    fields["dof_armature"][:, crank] = DRIVE_INERTIA_RATIO * PLACEHOLDER * size
    return fields


def inertia_fields(model: mujoco.MjModel, designs: Sequence[Mechanism]) -> Fields:
    """Return the inertias of designs, whose links must have them."""
    names = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
    fields: Fields = {name: np.repeat(getattr(model, name)[None], len(designs), 0) for name in names}
    for i, design in enumerate(designs):
        for link in design.links:
            body, inertia = model.body(link.name).id, link.inertia
            assert inertia is not None
            fields["body_mass"][i, body], fields["body_ipos"][i, body] = inertia.mass, inertia.centre
            fields["body_iquat"][i, body], fields["body_inertia"][i, body] = principal(inertia)
    return fields


def with_constants(model: mujoco.MjModel, fields: Mapping[str, Array], qpos0: Array) -> Fields:
    """Return fields of designs and all that MuJoCo's compiler works out from them."""
    sims = batch.Batch(model, len(qpos0), 1)
    given = {**fields, "qpos0": qpos0, "qpos_spring": qpos0}
    for name, values in given.items():
        sims.expand(name)[:] = values
    sims.set_const()
    found: Fields = {}
    for name in sorted(batch.MODEL_FIELDS):
        values = sims.expanded(name)
        if values is not None:
            found[name] = np.array(values)
    return found


def loosened(model: mujoco.MjModel, fields: Mapping[str, Array]) -> None:
    """Take back what the compiler of one model knew of places that all designs do not share."""
    for kind, local in (("site", fields["site_pos"]), ("body", fields["body_ipos"])):
        same = getattr(model, f"{kind}_sameframe")
        away = (local != 0.0).any((0, 2))
        same[away & (same == BODY) | (same == INERTIA)] = NONE
    if "body_iquat" in fields:
        turned = (fields["body_iquat"] != UNTURNED).any((0, 2))
        model.body_sameframe[turned] = NONE
        model.site_sameframe[model.site_sameframe == INERTIA_TURN] = NONE


def quaternions(rotation: Array) -> Array:
    """Return the unit quaternions (w, x, y, z) of rotation matrices, (d, 3, 3) -> (d, 4)."""
    d = np.stack([rotation[:, i, i] for i in range(3)], 1)
    trace = d.sum(1)
    # four times the square of each part; the largest is divided by
    squares = np.concatenate([1.0 + trace[:, None], 1.0 + 2.0 * d - trace[:, None]], 1)
    r = rotation
    products = np.empty((len(r), 4, 4))
    index = np.arange(4)
    products[:, index, index] = squares
    pairs = {
        (0, 1): r[:, 2, 1] - r[:, 1, 2],
        (0, 2): r[:, 0, 2] - r[:, 2, 0],
        (0, 3): r[:, 1, 0] - r[:, 0, 1],
        (1, 2): r[:, 0, 1] + r[:, 1, 0],
        (1, 3): r[:, 0, 2] + r[:, 2, 0],
        (2, 3): r[:, 1, 2] + r[:, 2, 1],
    }
    for (i, j), product in pairs.items():
        products[:, i, j] = products[:, j, i] = product
    chosen = products[np.arange(len(r)), squares.argmax(1)]
    return chosen / np.sqrt((chosen**2).sum(1))[:, None]
