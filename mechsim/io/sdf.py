"""SDF files: links, joints, frames and inertias of one model; a joint that closes a loop is one of them.

Joints are at zero where the poses of the file put the links. A file that mechsim wrote also states the
drivers, positions and names of its mechanism, which other programs ignore.

Source: SDFormat 1.11, "Specifying pose: semantics", sdformat.org.

A mechanism is written with its links at their poses at the start, and all joints, also those that close
loops.
"""

from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial.transform import Rotation

from mechsim.errors import InputError, several
from mechsim.files import read_text
from mechsim.io.plain_joints import BETWEEN, FileContents, leaders, left_out, split_joints, unique_name
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import JointSpring, forces_of
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Inertia, Link, Pose, vector
from mechsim.mechanism.masses import with_inertia
from mechsim.numerics.arrays import Array

# elements and attribute of mechsim: drivers, positions of joints at the poses of the file, names
NAMESPACE = "mechsim"
DRIVER, POSITION, NAME = (f"{{{NAMESPACE}}}{name}" for name in ("driver", "position", "name"))
# type of a joint in SDF -> kind
KIND_OF: dict[str, Any] = {
    "ball": "spherical",
    "continuous": "revolute",
    **{kind: kind for kind in ("revolute", "prismatic", "universal", "fixed")},
}
# gravity without any, and the frame of the model
GRAVITY, MODEL = "0 0 -9.8", "__model__"
# versions in which directions of axes are in the frame of the model, not in that of the joint
IN_MODEL = ("1.0", "1.2", "1.3", "1.4")
# elements that are read: element -> those in it; "axis2" also stands for the
# axes of joints without a single coordinate
READ = {
    "sdf": "world model",
    "world": "gravity model",
    "model": f"link joint frame pose {DRIVER}",
    "link": "pose inertial",
    "inertial": "pose mass inertia",
    "joint": f"parent child pose axis axis2 {POSITION}",
    "axis": "xyz limit dynamics mimic use_parent_model_frame",
    "axis2": "xyz use_parent_model_frame",
    "pose": "",
    "limit": "lower upper",
    "dynamics": "damping friction spring_reference spring_stiffness",
    "mimic": "multiplier offset reference",
}
LIMITS = (("lower", -1.0), ("upper", 1.0))
MOMENTS = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
# largest file in bytes
MAX_BYTES = 20_000_000


def read_sdf(path: str) -> KinematicSolver:
    """Return the mechanism of a file with one model, its forces and limits, and what is not read."""
    try:
        root = ElementTree.fromstring(read_text(path, "an SDF file", MAX_BYTES))
    except ElementTree.ParseError as error:
        raise InputError(f"{path} is no XML ({error}); correct it") from None
    models = root.findall(".//model")
    if root.tag != "sdf" or len(models) != 1 or root.findall(".//include"):
        raise InputError(
            f"<{root.tag}> with {len(models)} models is not read; give one <sdf> with one <model>, without "
            "includes (gz sdf -p writes it)"
        )
    (model,) = models
    frames = {each.get("name", ""): each for each in model if each.tag in ("link", "joint", "frame")}
    frames[MODEL] = model
    bodies = {_label(link): _placed(frames, link.get("name", ""))[1] for link in model.findall("link")}
    gravity = root.findtext("world/gravity") or root.findtext("world/physics/gravity", GRAVITY)
    contents = FileContents(_label(model), _floats(gravity, 3, "gravity"), poses=bodies)
    contents.links += [Link(_label(link), inertia=_inertia(link)) for link in model.findall("link")]
    for axis in (*model.iter("axis"), *model.iter("axis2")):
        in_model = axis.findtext("use_parent_model_frame", "").strip().lower() in ("1", "true")
        if in_model or root.get("version") in IN_MODEL:
            axis.attrib["expressed_in"] = MODEL
    for element in model.findall("joint"):
        _add_joint(contents, element, frames)
    for element in model.findall("joint"):
        mimic = element.find("axis/mimic")
        if mimic is not None:
            _add_mimic(contents, _label(element), mimic, frames)
    for frame in model.findall("frame"):
        link, pose = _placed(frames, frame.get("name", ""))
        contents.points[_label(frame)] = link, vector(bodies.get(link, IDENTITY).local(pose.position))
    contents.drivers = tuple((each.text or "").strip() for each in model.findall(DRIVER))
    return contents.solver(_unread(root))


def _placed(frames: Mapping[str, Element], name: str, behind: tuple[str, ...] = ()) -> tuple[str, Pose]:
    """Return the link to which a link, joint or frame is fixed, and its pose in the world."""
    if name == "world":
        return GROUND, IDENTITY
    if name in ("", MODEL):
        model = frames[MODEL]
        links = {link.get("name"): _label(link) for link in model.findall("link")}
        first = next(iter(links.values()), GROUND)
        return links.get(model.get("canonical_link"), first), _pose(model)
    if name not in frames or name in behind:
        problem = "is given relative to itself" if name in behind else "is named, but there is none"
        raise InputError(f"frame {name!r} {problem}; correct relative_to, attached_to, parent or child")
    element, behind = frames[name], (*behind, name)
    own = element.find("pose")
    fixed = element.findtext("child", "").strip() or element.get("attached_to", MODEL)
    link = _label(element) if element.tag == "link" else _placed(frames, fixed, behind)[0]
    stated = None if own is None else own.get("relative_to")
    base, pose = _placed(frames, stated or fixed, behind)[1], _pose(element)
    return link, Pose(base.position + base.rotation @ pose.position, base.rotation @ pose.rotation)


def _add_joint(contents: FileContents, element: Element, frames: Mapping[str, Element]) -> None:
    """Add a joint, and what its axis states."""
    name, kind = _label(element), KIND_OF.get(element.get("type", ""))
    if kind is None:
        raise InputError(
            f"joint {name} is of type {element.get('type')!r}; types that are read are {', '.join(KIND_OF)}"
        )
    _, own = _placed(frames, element.get("name", ""))
    sides = [_placed(frames, element.findtext(side, "").strip())[0] for side in ("parent", "child")]
    crossed, single = KINDS[kind].crossed, KINDS[kind].single
    axes = [_axis(element.find(tag), own, frames) for tag in ("axis", "axis2" if crossed else "axis")]
    position = _number(element, POSITION) if single else 0.0
    x = np.eye(3)[int(np.argmin(np.abs(axes[0])))]
    x = x - axes[0] * (axes[0] @ x)
    rotated = Rotation.from_rotvec(axes[0] * position).apply(x) if KINDS[kind].hinge else x
    # at the poses of the file the coordinate is the position that mechsim wrote, else zero
    starts = own.position - (0.0 if KINDS[kind].hinge else position) * axes[0], own.position
    bodies, ends = {GROUND: IDENTITY, **contents.poses}, list[End]()
    for link, start, axis, reference in zip(sides, starts, axes, (x, rotated), strict=True):
        body, own_axes = bodies[link], bodies[link].rotation.T
        toward = None if crossed else vector(own_axes @ reference)
        ends.append(End(link, vector(body.local(start)), vector(own_axes @ axis), toward))
    cross_angle = float(np.arccos(axes[0] @ axes[1])) if crossed else np.pi / 2
    contents.joints.append(Joint(name, kind, *ends, cross_angle=cross_angle))
    axis = element.find("axis")
    if not single or axis is None:
        return
    contents.positions[name] = position
    low, high = (position + _number(axis, f"limit/{side}", sign * np.inf) for side, sign in LIMITS)
    contents.ranges[name] = low, high
    friction = Friction(name, _number(axis, "dynamics/damping"), _number(axis, "dynamics/friction"))
    contents.friction += [friction] if friction.viscous or friction.coulomb else []
    rest = position + _number(axis, "dynamics/spring_reference")
    spring = JointSpring(name, _number(axis, "dynamics/spring_stiffness"), rest)
    contents.springs += [spring] if spring.stiffness else []


def _axis(axis: Element | None, own: Pose, frames: Mapping[str, Element]) -> Array:
    """Return the direction of an axis in the world, (3,)."""
    xyz = None if axis is None else axis.find("xyz")
    if axis is None or xyz is None:
        return own.rotation[:, 2]
    direction = _floats(xyz.text, 3, "an axis")
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise InputError("an axis is zero; give its direction")
    frame = axis.get("expressed_in") or xyz.get("expressed_in")
    rotation = _placed(frames, frame)[1].rotation if frame else own.rotation
    return rotation @ direction / length


def _add_mimic(contents: FileContents, name: str, mimic: Element, frames: Mapping[str, Element]) -> None:
    """Add the coupling of a joint that follows another: p = multiplier (p' - reference) + offset."""
    leader = mimic.get("joint", "")
    leader = _label(frames[leader]) if leader in frames else leader
    zeros = _number(mimic, "offset"), _number(mimic, "reference")
    zeros = contents.positions.get(name, 0.0) + zeros[0], contents.positions.get(leader, 0.0) + zeros[1]
    contents.follow(name, leader, _number(mimic, "multiplier", 1.0), zeros)


def _inertia(link: Element) -> Inertia | None:
    """Return the inertia of a link; None without any."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    pose, matrix = _pose(inertial), np.zeros((3, 3))
    for key, (i, j) in MOMENTS.items():
        matrix[i, j] = matrix[j, i] = _number(inertial, f"inertia/{key}", float(i == j))
    moments: Any = pose.rotation @ matrix @ pose.rotation.T
    return Inertia(_number(inertial, "mass", 1.0), vector(pose.position), moments)


def _unread(element: Element, key: str = "") -> Iterator[str]:
    """Yield the elements and attributes that are not read, with the element that contains them."""
    for name in ("placement_frame", "frame", "auto"):
        if element.get(name, "false") not in ("", "0", "false"):
            yield f"{element.tag}/{name}"
    for child in element:
        if child.tag not in READ[key or element.tag].split():
            yield f"{element.tag}/{child.tag}"
        elif child.tag in READ:
            single = child.tag != "axis" or KINDS[KIND_OF[element.get("type", "")]].single
            yield from _unread(child, "" if single else "axis2")


def _label(element: Element) -> str:
    """Return the name of an element, that of its mechanism if mechsim wrote it."""
    return element.get(NAME) or element.get("name", "")


def _pose(element: Element) -> Pose:
    """Return the <pose> of an element: a position, and roll, pitch and yaw or a quaternion."""
    pose = element.find("pose")
    if pose is None or not (pose.text or "").strip():
        return IDENTITY
    if pose.get("rotation_format") == "quat_xyzw":
        numbers = _floats(pose.text, 7, "a pose")
        return Pose(numbers[:3], Rotation.from_quat(numbers[3:]).as_matrix())
    numbers, degrees = _floats(pose.text, 6, "a pose"), pose.get("degrees") in ("true", "1")
    return Pose(numbers[:3], Rotation.from_euler("xyz", numbers[3:], degrees=degrees).as_matrix())


def _number(element: Element, path: str, default: float = 0.0) -> float:
    """Return the number in an element; `default` without the element."""
    text = element.findtext(path)
    return default if text is None else float(_floats(text, 1, path)[0])


def _floats(text: str | None, count: int, what: str) -> Array:
    """Return the numbers in a text, (count,)."""
    words = (text or "").split()
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.zeros(0)
    if len(numbers) != count or np.isnan(numbers).any():
        raise InputError(f"{what} is {' '.join(words)[:40]!r}; give {several(count, 'number')}")
    return numbers


# version of the format, the first with joints that follow others
VERSION = "1.11"
TYPE_OF = {own: name for name, own in KIND_OF.items() if name != "continuous"}


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
        element = _write_joint(model, joint, names[joint.name], poses)
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


def _write_joint(model: Element, joint: Joint, name: str, poses: Mapping[str, Pose]) -> Element:
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
