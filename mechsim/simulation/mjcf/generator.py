"""Generates a MuJoCo model specification from a mechanism and a scene."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Coupling, Joint
from mechsim.mechanism.link_poses import initial_coordinates, with_virtual_bodies
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import plane_normals
from mechsim.mechanism.moved_links import with_rods
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import REVOLUTION
from mechsim.simulation.mjcf import link_inertias
from mechsim.simulation.mjcf.equalities import add_equality, add_rod, lock_joint
from mechsim.simulation.mjcf.joints import (
    CRANK,
    add_joint,
    coincident_points,
    model_names,
    seated_pose,
)
from mechsim.simulation.mjcf.link_inertias import PLACEHOLDER
from mechsim.simulation.mjcf.loop_cuts import Tree, cut_loops
from mechsim.simulation.state import quaternion

# tolerance of the constraint solver: with a virtual drive inertia the relative gradient is always small, and
# with a tolerance of 0 it makes all iterations unless nothing at all changes
SOLVER_TOLERANCE = 1e-24
# ratio of the virtual drive inertia to the inertia of the links: reactions change the speed by 1e-12 per
# revolution
DRIVE_INERTIA_RATIO = 1e12


def generate(mechanism: Mechanism, scene: Scene, poses: Mapping[str, Pose] | None = None) -> mujoco.MjSpec:
    """Return the model of a mechanism, from its dimensions only.

    Args:
        mechanism: the mechanism.
        scene: contents of the model.
        poses: link -> approximate pose from which each tree joint takes its coordinate in the model's
            reference configuration; other links have zero coordinates. The loops are in general open in
            this configuration: `assembled` closes them.

    Returns:
        The specification. Bodies and joints are named like links and joints, the driven joint
        "crank", and each tracked point is a site of its name. A universal joint is two hinges NAME.1
        and NAME.2, a cylindrical one NAME.way and NAME.turn. At level "picture",
        `pictures.render.scenery` adds the picture later.
    """
    forces = scene.acting if scene.holds("dynamics") else None
    rubbing = {friction.joint for friction in forces.friction if friction.dry} if forces else ()
    acting = forces.uncut if forces else ()
    if forces is not None:
        mechanism = link_inertias.with_accepted_inertia(mechanism)
    elif scene.holds("motion"):
        # without masses; MuJoCo steps a link without spin to a higher order than a tendon
        mechanism, poses = with_rods(mechanism, poses or {}, "universal")
    tree = cut_loops(mechanism, scene.cut, keep=rubbing, acting=acting, welds=forces is not None)
    mechanism = tree.mechanism
    poses = with_virtual_bodies(tree.mechanism, poses or {})
    spec = mujoco.MjSpec()
    spec.modelname = mechanism.name
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    # set the options of a scene; constraint settings from validation/choices/constraint_settings.py
    option = spec.option
    option.gravity = scene.acting.gravity if scene.holds("dynamics") else (0.0, 0.0, 0.0)
    option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    option.timestep = 1e-4
    option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    option.tolerance = SOLVER_TOLERANCE
    disable = mujoco.mjtDisableBit
    option.disableflags = int(disable.mjDSBL_CONTACT | disable.mjDSBL_ISLAND | disable.mjDSBL_REFSAFE)
    with _repeated_names(mechanism):
        bodies, frames = _add_links(spec, mechanism, tree, poses, real_inertia=forces is not None)
        # at level dynamics the crank is free, or driven by its motor
        if scene.holds("motion") and scene.level != "dynamics" and mechanism.has_crank:
            spec.joint(CRANK).armature = DRIVE_INERTIA_RATIO * PLACEHOLDER * mechanism.characteristic_length
        for name, (link, point) in mechanism.points.items():
            bodies[link].add_site(name=name, pos=point)
        _close(spec, mechanism, tree, bodies)
        for joint in tree.cuts:
            if KINDS[joint.kind].rod:
                add_rod(spec, joint, bodies, frames)
        _couple(spec, mechanism)
        if forces is not None:
            from mechsim.simulation.mjcf.force_elements import add_forces

            add_forces(spec, mechanism, tree, bodies, forces)
    return spec


@contextmanager
def _repeated_names(mechanism: Mechanism) -> Generator[None]:
    """Reject names that a MuJoCo model reserves, such as "world"."""
    try:
        yield
    except ValueError as error:
        if "repeated name" not in str(error):
            raise
        repeated = " ".join(str(error).split()).removeprefix("Error: ")
        raise InputError(
            f"{mechanism.name}: no MuJoCo model can be made ({repeated}); rename this part of the mechanism"
        ) from None


def _add_links(
    spec: mujoco.MjSpec, mechanism: Mechanism, tree: Tree, poses: Mapping[str, Pose], *, real_inertia: bool
) -> tuple[dict[str, mujoco.MjsBody], dict[str, Pose]]:
    """Add a body with its joint for each link to the body of its parent, with real or placeholder inertia.

    Returns:
        Link -> its body, and its pose in the reference configuration.
    """
    inertias = {link_.name: link_.inertia if real_inertia else None for link_ in mechanism.links}
    bodies, frames = {GROUND: spec.worldbody}, {GROUND: IDENTITY}
    for branch in tree.branches:
        link, parent = branch.child.link, frames[branch.parent.link]
        local, values = seated_pose(branch, parent, poses.get(link))
        if link in poses:
            values = with_revolutions(mechanism, branch.joint, values)
        body = bodies[branch.parent.link].add_body(
            name=link, pos=local.position, quat=quaternion(local.rotation)
        )
        inertia = inertias[link]
        if inertia is None:
            link_inertias.set_placeholder(body, mechanism, link)
        else:
            link_inertias.set_inertia(body, inertia)
        add_joint(body, mechanism, branch, local, values)
        bodies[link] = body
        frames[link] = Pose(parent.point(tuple(local.position)), parent.rotation @ local.rotation)
    return bodies, frames


def with_revolutions(mechanism: Mechanism, joint: Joint, values: tuple[float, ...]) -> tuple[float, ...]:
    """Return joint coordinates of a pose with the revolutions of the mechanism's start."""
    stated, slides = initial_coordinates(mechanism), len(KINDS[joint.kind].slides)
    return tuple(
        value + REVOLUTION * float(np.round((stated[name] - value) / REVOLUTION))
        if i >= slides and name in stated
        else value
        for i, (name, value) in enumerate(zip(joint.coordinates, values, strict=True))
    )


def _close(
    spec: mujoco.MjSpec, mechanism: Mechanism, tree: Tree, bodies: Mapping[str, mujoco.MjsBody]
) -> None:
    """Close each cut: point on point, and for a revolute joint in space a second point along its axis."""
    planar = plane_normals(mechanism) is not None
    for joint in tree.cuts:
        points = coincident_points(KINDS[joint.kind])
        # a fixed joint closes frame on frame
        kind, heights = mujoco.mjtEq.mjEQ_CONNECT, points
        if heights is None:
            kind, heights = mujoco.mjtEq.mjEQ_WELD, [0.0]
        # in a planar mechanism one point is sufficient: no link can leave the plane
        for suffix, height in zip(("", "+"), heights[:1] if planar else heights, strict=False):
            offset, names = height * mechanism.characteristic_length, list[str]()
            for end in (joint.a, joint.b):
                names.append(f"{joint.name}@{end.link}{suffix}")
                position = np.asarray(end.point) + offset * np.asarray(end.axis)
                site = bodies[end.link].add_site(name=names[-1], pos=position)
                if points is None:
                    site.quat = quaternion(end.frame)
            add_equality(spec, joint.name + suffix, kind, *names)


def _couple(spec: mujoco.MjSpec, mechanism: Mechanism) -> None:
    """Couple and lock coordinates; in MuJoCo both sides are relative to the reference configuration.

    If a side is not a single coordinate, both sides are fixed tendons.
    """
    name_of = model_names(mechanism)
    for equality_name, law in mechanism.named_laws.items():
        terms = [law.left_terms, law.right_terms] if law.right_terms else [law.left_terms]
        sides = [{name_of[name]: weight for name, weight in side.items()} for side in terms]
        zeros = [
            zero - sum(weight * float(spec.joint(name).ref) for name, weight in side.items())
            for side, zero in zip(sides, law.zeros, strict=False)
        ]
        # p(right - zero) about the reference configuration
        curve = np.polynomial.Polynomial(law.coefficients or _taylor(law, -zeros[1]))
        if len(zeros) == 2 and law.coefficients:
            curve = curve(np.polynomial.Polynomial([-zeros[1], 1.0]))
        shifted = np.zeros(5)
        shifted[: len(curve.coef)] = curve.coef
        shifted[0] += zeros[0]
        if law.turns:
            shifted[0] -= REVOLUTION * np.round(shifted[0] / REVOLUTION)
        kind, names = mujoco.mjtEq.mjEQ_JOINT, [name for side in sides for name in side]
        if any(list(side.values()) != [1.0] for side in sides):
            kind, names = mujoco.mjtEq.mjEQ_TENDON, list[str]()
            for i, side in enumerate(sides):
                names.append(f"{law.name} {i}")
                tendon = spec.add_tendon(name=names[-1])
                for name, weight in side.items():
                    tendon.wrap_joint(name, weight)
        add_equality(spec, equality_name, kind, *names).data[:5] = shifted
    for name, value in mechanism.locked.items():
        lock_joint(spec, name_of[name], value - float(spec.joint(name_of[name]).ref))


def _taylor(law: Coupling, argument: float) -> tuple[float, ...]:
    """Return the Taylor polynomial of the function of a coupling about an argument, constant first."""
    value, rate, second = (float(entry[0]) for entry in law.polynomial(np.array([argument + law.zeros[1]])))
    return value, rate, 0.5 * second


def set_drive_inertia(spec: mujoco.MjSpec, inertia: float) -> None:
    """Set the armature of the crank of a generated model, in [kg m2].

    Raises:
        InputError: if the model has no joint named crank.
    """
    crank = next((joint for joint in spec.joints if joint.name == CRANK), None)
    if crank is None:
        raise InputError(
            "a drive inertia needs a crank, but no joint of the model is called crank; leave it out"
        )
    crank.armature = inertia
