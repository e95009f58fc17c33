"""Mechanisms as SDF text: links at their poses at the start, and all joints, also those that close loops."""

from collections.abc import Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from mechsim.errors import InputError
from mechsim.io.plain_joints import BETWEEN, leaders, left_out, split_joints, unique_name
from mechsim.io.sdf_reader import KIND_OF, MOMENTS, NAMESPACE
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import forces_of
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Inertia, Pose
from mechsim.mechanism.masses import with_inertia

# version of the format, the first with joints that follow others
VERSION = "1.11"
TYPE_OF = {kind: name for name, kind in KIND_OF.items() if name != "continuous"}


def to_sdf(solver: KinematicSolver) -> tuple[str, str]:
    """Return a mechanism as SDF text, and a sentence on what is left out.

    Raises:
        InputError: for joints and couplings that SDF does not have.
        AssemblyError: if the loops do not close.
    """
    mechanism = with_inertia(solver.mechanism)
    assembled, values = start_poses(mechanism)
    links, joints, poses = split_joints(mechanism, {GROUND: IDENTITY, **assembled}, ("cylindrical",))
    root = Element("sdf", {"version": VERSION, "xmlns:mechsim": NAMESPACE})
    world = SubElement(root, "world", name="default")
    _add(world, "gravity", *forces_of(solver).gravity)
    model = SubElement(world, "model", name=mechanism.name)
    for name in mechanism.drivers:
        _add(model, "mechsim:driver", name)
    unique = {"world": "world", **{link.name: link.name for link in links}}
    for link in links:
        element = SubElement(model, "link", name=link.name)
        _add_pose(element, poses[link.name])
        _add_inertia(element, link.inertia or BETWEEN)
    followed = leaders(mechanism, "SDF")
    names = {joint.name: unique_name(joint.name, "joint", unique) for joint in joints}
    for joint in joints:
        element = _add_joint(model, joint, names[joint.name], poses)
        if KINDS[joint.kind].single:
            _add(element, "mechsim:position", values[joint.name])
            (axis,) = element.findall("axis")
            _add_axis_data(axis, joint.name, solver, values[joint.name])
            if joint.name in followed:
                leader, ratio = followed[joint.name]
                _add(SubElement(axis, "mimic", joint=names[leader]), "multiplier", ratio)
    for name, (link, point) in mechanism.points.items():
        frame = SubElement(
            model, "frame", name=unique_name(name, "frame", unique), attached_to=_in_world(link)
        )
        frame.set("mechsim:name", name)
        _add_pose(frame, Pose(np.array(point), np.eye(3)))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n", left_out(solver, "SDF")


def _in_world(link: str) -> str:
    return "world" if link == GROUND else link


def _add(parent: Element, tag: str, *values: float | str) -> None:
    """Add an element with a text, or with numbers to the last bit."""
    texts = (value if isinstance(value, str) else f"{float(value):.17g}" for value in values)
    SubElement(parent, tag).text = " ".join(texts)


def _add_pose(parent: Element, pose: Pose) -> None:
    _add(parent, "pose", *pose.position, *Rotation.from_matrix(pose.rotation).as_quat())
    parent[-1].set("rotation_format", "quat_xyzw")


def _add_inertia(parent: Element, inertia: Inertia) -> None:
    element = SubElement(parent, "inertial")
    _add_pose(element, Pose(np.array(inertia.centre), np.eye(3)))
    _add(element, "mass", inertia.mass)
    tensor = SubElement(element, "inertia")
    for key, (i, j) in MOMENTS.items():
        _add(tensor, key, inertia.moments[i][j])


def _add_joint(model: Element, joint: Joint, name: str, poses: Mapping[str, Pose]) -> Element:
    """Add a joint with its axes, in the joint frame of side b."""
    if joint.kind not in TYPE_OF:
        raise InputError(f"joint {joint.name} is {joint.kind}, which SDF does not have; export it to TOML")
    element = SubElement(
        model, "joint", {"name": name, "type": TYPE_OF[joint.kind], "mechsim:name": joint.name}
    )
    for tag, link in zip(("parent", "child"), joint.links, strict=True):
        _add(element, tag, _in_world(link))
    _add_pose(element, Pose(np.array(joint.b.point), joint.b.frame))
    frame = poses[joint.b.link].rotation @ joint.b.frame
    first = frame.T @ poses[joint.a.link].rotation @ np.array(joint.a.axis)
    axes = [first, (0.0, 0.0, 1.0)] if KINDS[joint.kind].crossed else [(0.0, 0.0, 1.0)]
    if KINDS[joint.kind].single or KINDS[joint.kind].crossed:
        for tag, direction in zip(("axis", "axis2"), axes, strict=False):
            _add(SubElement(element, tag), "xyz", *direction)
    return element


def _add_axis_data(axis: Element, name: str, solver: KinematicSolver, value: float) -> None:
    """Add limits, friction and spring of a joint, whose position is zero at a value of its coordinate."""
    forces = forces_of(solver)
    limit, dynamics = SubElement(axis, "limit"), SubElement(axis, "dynamics")
    for tag, end in zip(("lower", "upper"), solver.ranges.get(name, (-np.inf, np.inf)), strict=True):
        _add(limit, tag, end - value)
    for friction in (friction for friction in forces.friction if friction.joint == name):
        _add(dynamics, "damping", friction.viscous)
        _add(dynamics, "friction", friction.coulomb)
    for spring in (spring for spring in forces.joint_springs if spring.joint == name):
        _add(dynamics, "spring_reference", spring.rest - value)
        _add(dynamics, "spring_stiffness", spring.stiffness)
