"""Models of many designs with closed loops: one compiled model and arrays of fields that differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from mechsim.model.design_arrays import DesignArrays, StartedDesigns
from mechsim.model.forces import Forces
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, IDENTITY, Pose, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import Scene
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.dynamics.loaded_model import loaded_model
from mechsim.simulation.loop_jacobian import NEWTON
from mechsim.simulation.mjcf.compiling import BODY, INERTIA, NONE
from mechsim.simulation.mjcf.force_elements import (
    PLACEHOLDER,
    placeholder,
    principal,
    with_accepted_inertia,
)
from mechsim.simulation.mjcf.generator import DRIVE_INERTIA_RATIO
from mechsim.simulation.mjcf.joints import (
    CRANK,
    Branch,
    EndArrays,
    coincident_points,
    model_joints,
    model_names,
    seated_pose,
)
from mechsim.simulation.mjcf.loop_cuts import Tree, cut_loops
from mechsim.simulation.source import from_source, link_poses

Fields = dict[str, Array]
INERTIA_TURN = int(mujoco.mjtSameFrame.mjSAMEFRAME_INERTIAROT)
IDENTITY_QUATERNION = np.array([1.0, 0.0, 0.0, 0.0])


def assembled_fields(
    model: mujoco.MjModel, tree: Tree, arrays: DesignArrays, poses: Mapping[str, Pose]
) -> tuple[Fields, Array]:
    """Return the body and joint frames of designs in given link poses, and their configurations.

    Args:
        model: model of one of the designs; it defines the indices of bodies and joints.
        tree: spanning tree of its loops, with cut joints.
        arrays: the designs.
        poses: link -> positions (d, 3) and rotations (d, 3, 3).

    Returns:
        Fields of the model, (d, ...) each, whose reference configuration has these poses; and that
        configuration, (d, nq).
    """
    count = arrays.count
    names = ("body_pos", "body_quat", "jnt_pos", "jnt_axis")
    fields: Fields = {name: np.repeat(getattr(model, name)[None], count, 0) for name in names}
    qpos = np.repeat(model.qpos0[None], count, 0)
    placed_poses = {GROUND: IDENTITY}
    for tree_branch in tree.branches:
        branch, link = _branch(tree_branch, arrays), tree_branch.child.link
        parent = placed_poses[branch.parent.link]
        local, values = seated_pose(branch, parent, poses[link])
        body = model.body(link).id
        fields["body_pos"][:, body] = local.position
        fields["body_quat"][:, body] = quaternions(local.rotation)
        for made in model_joints(tree.mechanism, branch, local, values):
            joint = model.joint(made.name).id
            fields["jnt_pos"][:, joint], fields["jnt_axis"][:, joint] = made.position, made.axis
            if made.value is not None:
                qpos[:, model.jnt_qposadr[joint]] = made.value
        offset = (parent.rotation @ local.position[..., None])[..., 0]
        placed_poses[link] = Pose(parent.position + offset, parent.rotation @ local.rotation)
    return fields, qpos


def _branch(branch: Branch, arrays: DesignArrays) -> Branch:
    """Return a joint of the tree with the points and frames of all designs."""
    point_a, frame_a, point_b, frame_b = arrays.sides()[branch.joint.name]
    a = EndArrays(branch.joint.a.link, point_a, frame_a)
    b = EndArrays(branch.joint.b.link, point_b, frame_b)
    return Branch(branch.joint, *((a, b) if branch.direction > 0 else (b, a)), branch.direction)


def site_fields(model: mujoco.MjModel, tree: Tree, arrays: DesignArrays) -> Fields:
    """Return the local positions of the sites of designs, (d, nsite, 3): tracked and loop-closing points."""
    positions = np.repeat(model.site_pos[None], arrays.count, 0)
    for name, position in arrays.points.items():
        positions[:, model.site(name).id] = position.T
    site_names = {model.site(i).name for i in range(model.nsite)}
    for joint in tree.cuts:
        point_a, frame_a, point_b, frame_b = arrays.ends[joint.name]
        heights = coincident_points(KINDS[joint.kind]) or ()
        for suffix, height in zip(("", "+"), heights, strict=False):
            for end, point, frame in ((joint.a, point_a, frame_a), (joint.b, point_b, frame_b)):
                name = f"{joint.name}@{end.link}{suffix}"
                if name in site_names:
                    positions[:, model.site(name).id] = (
                        point + height * arrays.characteristic_length * frame[:, 2]
                    ).T
    return {"site_pos": positions}


def placeholder_fields(model: mujoco.MjModel, arrays: DesignArrays) -> Fields:
    """Return the placeholder inertias of designs and virtual drive inertias, equal to the generator's."""
    names = ("body_mass", "body_ipos", "body_inertia", "dof_armature")
    fields: Fields = {name: np.repeat(getattr(model, name)[None], arrays.count, 0) for name in names}
    length = arrays.characteristic_length
    for link in arrays.mechanism.links:
        body = model.body(link.name).id
        mass, centre, moment = placeholder(arrays.on(link.name), length)
        fields["body_mass"][:, body], fields["body_ipos"][:, body] = mass, centre.T
        fields["body_inertia"][:, body] = moment[:, None]
    crank = model.jnt_dofadr[model.joint(CRANK).id]
    fields["dof_armature"][:, crank] = DRIVE_INERTIA_RATIO * PLACEHOLDER * length
    return fields


def inertia_fields(model: mujoco.MjModel, designs: Sequence[Mechanism]) -> Fields:
    """Return the inertias of designs in which all links have inertias."""
    names = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
    fields: Fields = {name: np.repeat(getattr(model, name)[None], len(designs), 0) for name in names}
    for i, design in enumerate(designs):
        for link in design.links:
            body, inertia = model.body(link.name).id, link.inertia
            assert inertia is not None
            fields["body_mass"][i, body], fields["body_ipos"][i, body] = inertia.mass, inertia.centre
            fields["body_iquat"][i, body], fields["body_inertia"][i, body] = principal(inertia)
    return fields


# constants that MuJoCo's mj_setConst derives from these fields for stepping
CONSTANTS = (
    "body_invweight0",
    "body_subtreemass",
    "dof_M0",
    "dof_invweight0",
    "dof_length",
    "tendon_invweight0",
    "tendon_length0",
)


def with_constants(model: mujoco.MjModel, fields: Mapping[str, Array], qpos0: Array) -> Fields:
    """Return fields of designs and the constants that MuJoCo's compiler derives from them."""
    sims = batch.Batch(model, len(qpos0), 1)
    inputs = {**fields, "qpos0": qpos0, "qpos_spring": qpos0}
    for name, values in inputs.items():
        sims.expand(name)[:] = values
    sims.set_const()
    return {name: np.array(sims.expand(name)) for name in (*inputs, *CONSTANTS)}


def clear_same_frame(model: mujoco.MjModel, fields: Mapping[str, Array]) -> None:
    """Clear the compiler's flags of coincident frames that not all designs share."""
    for kind, local in (("site", fields["site_pos"]), ("body", fields["body_ipos"])):
        same = getattr(model, f"{kind}_sameframe")
        displaced = (local != 0.0).any((0, 2))
        same[displaced & (same == BODY) | (same == INERTIA)] = NONE
    if "body_iquat" in fields:
        rotated = (fields["body_iquat"] != IDENTITY_QUATERNION).any((0, 2))
        model.body_sameframe[rotated] = NONE
        model.site_sameframe[model.site_sameframe == INERTIA_TURN] = NONE


def quaternions(rotation: Array) -> Array:
    """Return the unit quaternions (w, x, y, z) of rotation matrices, (d, 3, 3) -> (d, 4)."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rotation).as_quat(scalar_first=True), dtype=np.float64)


Bools = NDArray[np.bool_]
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class SharedModel:
    """The model of one of the designs, with the properties that all designs share.

    Attributes:
        closed: the model.
        tree: spanning tree of its loops, with cut joints.
        gravity: acceleration of gravity in [m/s2] with real inertias; None for placeholder inertias.
    """

    closed: ClosedModel
    tree: Tree
    gravity: Vector | None = None

    @property
    def joints(self) -> dict[str, int]:
        """Coordinate of a tree joint -> index of the model's joint."""
        model = self.closed.model
        joint_ids = {model.joint(i).name: i for i in range(model.njnt)}
        return {
            name: joint_ids[made]
            for name, made in model_names(self.tree.mechanism).items()
            if made in joint_ids
        }


@dataclass(frozen=True)
class DesignModels:
    """Models of d designs, each with closed loops at its initial crank angle.

    Attributes:
        shared: common properties.
        fields: fields of the compiled models, (d, ...) each.
        qpos: closed states, (d, nq).
        valid: whether the loops of each design close, (d,).
    """

    shared: SharedModel
    fields: Fields
    qpos: Array
    valid: Bools


def shared_model(mechanism: Mechanism, gravity: Vector | None = None) -> SharedModel | None:
    """Return the model of a mechanism whose designs can be stepped together; None if they cannot.

    This requires a crank that determines all motion, loops closed by points, and no coupled or locked joints.

    Args:
        mechanism: one of the designs.
        gravity: acceleration of gravity in [m/s2] with real inertias; None for placeholder inertias.

    Raises:
        AssemblyError: if the loops of the mechanism do not close.
    """
    if not mechanism.has_crank or mechanism.laws or mechanism.locked:
        return None
    tree = cut_loops(mechanism, splits=True)
    if gravity is None:
        closed: ClosedModel = from_source(mechanism, Scene(level="motion"))
    else:
        closed = loaded_model(mechanism, Forces(gravity=gravity))
    loops = closed.loops
    if (
        tree.mechanism is not mechanism
        or loops.rods
        or loops.frames
        or loops.couplings
        or closed.undetermined_points.any()
    ):
        return None
    # the independent constraints are determined once, in a model with closed loops
    loop_jacobian.tangent(loops, loops.linearise(closed.qpos[None])[1])
    if gravity is not None and loop_jacobian.has_undetermined_dofs(loops):
        # forces determine the initial rate of passive DOFs; kinematics does not
        return None
    return SharedModel(closed, tree, gravity)


def design_models(
    shared: SharedModel, started: StartedDesigns, designs: Sequence[Mechanism] = ()
) -> DesignModels:
    """Return the models of designs, with the results of generator and compiler computed on arrays.

    Args:
        shared: common properties.
        started: dimensions and initial poses.
        designs: the mechanisms, if their inertias are real.
    """
    model, tree, arrays = shared.closed.model, shared.tree, started.arrays
    sites = site_fields(model, tree, arrays)
    fields, qpos = assembled_fields(model, tree, arrays, started.guess)
    address = shared.closed.loops.crank_address
    start = started.coordinates[tree.mechanism.crank.name]
    turns = REVOLUTION * np.round((start - qpos[:, address]) / REVOLUTION)
    fields |= {**sites, "qpos0": qpos.copy()}
    fields["qpos0"][:, address] += turns
    qpos[:, address] = start
    loops = shared.closed.loops.with_fields(fields)
    qpos, first_error = loop_jacobian.close_each(loops, qpos)
    # in the reference configuration the links have the poses of the closed loops
    seated, rest = assembled_fields(model, tree, arrays, link_poses(tree.mechanism, loops, qpos))
    rest[:, address] += REVOLUTION * np.round((start - rest[:, address]) / REVOLUTION)
    real = [with_accepted_inertia(design) for design in designs]
    weights = inertia_fields(model, real) if shared.gravity is not None else placeholder_fields(model, arrays)
    fields = {**seated, **sites, **weights}
    loops = shared.closed.loops.with_fields({**seated, **sites, "qpos0": rest})
    qpos, error = loop_jacobian.close_each(loops, rest)
    fields = with_constants(model, fields, rest)
    return DesignModels(
        shared,
        fields,
        qpos,
        (np.maximum(first_error, error) < NEWTON.rounding) & _simple_inertia(model, fields),
    )


def _simple_inertia(model: mujoco.MjModel, fields: Fields) -> Bools:
    """Return a mask of designs for which the compiled simplification of body inertias is valid, (d,)."""
    bodies = np.flatnonzero(model.body_simple)
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, bodies))
    valid = (fields["body_ipos"][:, bodies] == model.body_ipos[bodies]).all((1, 2))
    for name in ("jnt_pos", "jnt_axis"):
        valid &= (fields[name][:, joints] == getattr(model, name)[joints]).all((1, 2))
    return valid
