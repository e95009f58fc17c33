"""Loops of URDF files: read from dialects of URDF, which has no loops, and closed by equalities of sites.

Dialects in the file: a link with two parents, `<loop>` and `<coupling>` of URDF+, `<loop_joint>` of Isaac
Sim, `<drake:ball_constraint>` and `<drake:linear_bushing_rpy>` of Drake, and `<gazebo><joint>` of Gazebo. A
YAML sidecar file has the form of Gepetto's collection of parallel robots, or of scikit-robot.
"""

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import mujoco
import numpy as np

from mechsim.errors import InputError, needs
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean

Element = ElementTree.Element
Kind = Literal["point", "hinge", "weld"]
# joint types of all dialects -> kind of the closure
KINDS: dict[str, Kind] = {
    "spherical": "point",
    "ball": "point",
    "3d": "point",
    "revolute": "hinge",
    "continuous": "hinge",
    "hinge": "hinge",
    "fixed": "weld",
    "6d": "weld",
}
# distance in [m] between the two points of a hinge closure along its axis
HINGE_LENGTH = 0.1
ROOT = "world"


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame on a link: origin (3,) in [m] and rotation (3, 3)."""

    link: str
    position: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))

    def then(self, position: Array, rotation: Array) -> "Frame":
        """Return the frame at a position and rotation within this one."""
        return Frame(self.link, self.position + self.rotation @ position, self.rotation @ rotation)


@dataclass(frozen=True, eq=False)
class LoopClosure:
    """Two frames that a loop joint connects.

    Attributes:
        name: name of the joint.
        kind: "point" (spherical), "hinge" (revolute about `axis`) or "weld".
        a, b: the frames.
        axis: axis of a hinge, in both frames.
    """

    name: str
    kind: Kind
    a: Frame
    b: Frame
    axis: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))


@dataclass(frozen=True, eq=False)
class UrdfCoupling:
    """Coupled joints: `ratio` times the sum of the positions of `a` is the sum of the positions of `b`.

    Attributes:
        name: name of the coupling.
        ratio: transmission ratio.
        a, b: names of the joints from the common ancestor to the predecessor and to the successor.
    """

    name: str
    ratio: float
    a: tuple[str, ...]
    b: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """The tree of a URDF file.

    Attributes:
        path: path of the file.
        root: root element of the file.
        parents: link -> joint element, parent link and pose in it, for the first joint that names the link.
        second: joints to links that already have a parent.
    """

    path: str
    root: Element
    parents: Mapping[str, tuple[Element, Frame]]
    second: tuple[Element, ...]

    def error(self, message: str) -> InputError:
        return InputError(f"{self.path}: {message}")

    def require_link(self, name: str, joint: str) -> str:
        """Return the name of a link; raise InputError if the file has no such link."""
        links = [link.get("name", "") for link in self.root.findall("link")]
        if name not in links:
            raise self.error(
                f"loop joint {joint!r} names link {name!r}{did_you_mean(name, links)}; name a link"
            )
        return name

    def joints_to(self, link: str) -> list[str]:
        """Return the names of the movable joints from the root to a link, the last joint first."""
        names: list[str] = []
        while link in self.parents:
            joint, parent = self.parents[link]
            names += [joint.get("name", "")] if joint.get("type") != "fixed" else []
            link = parent.link
        return names

    def moving(self, frame: Frame) -> Frame:
        """Return a frame on the link to which fixed joints attach it; the root is the world."""
        while frame.link in self.parents:
            joint, pose = self.parents[frame.link]
            if joint.get("type") != "fixed":
                return frame
            frame = pose.then(frame.position, frame.rotation)
        return Frame(ROOT, frame.position, frame.rotation)

    def fixed_to(self, link: str, placed: Frame) -> Frame:
        """Return the frame on a link that coincides with a frame in the root link at zero joint values."""
        own = self.in_root(Frame(link))
        return Frame(
            link, own.rotation.T @ (placed.position - own.position), own.rotation.T @ placed.rotation
        )

    def in_root(self, frame: Frame) -> Frame:
        """Return a frame in the root link at zero joint values."""
        while frame.link in self.parents:
            frame = self.parents[frame.link][1].then(frame.position, frame.rotation)
        return frame


def urdf_specification(path: str, loops: str | None = None) -> mujoco.MjSpec | None:
    """Return the specification of a URDF file with closed loops; None for MJCF or a file without loops.

    Args:
        path: path of the file.
        loops: path of a sidecar file with loop closures.

    Raises:
        InputError: if a loop joint cannot be read, with file, joint and remedy.
    """
    tree = _read(path)
    if tree is None:
        if loops is not None:
            raise InputError(
                f"{path} is no URDF file, whose loops {loops} could close; write them as equalities"
            )
        return None
    closures = [closure for reader in DIALECTS for closure in reader(tree)]
    changes = JointChanges()
    if loops is not None:
        more, changes = _sidecar(tree, loops)
        closures += more
    couplings = list(_couplings(tree))
    if not closures and not couplings:
        return None
    for joint in tree.second:
        tree.root.remove(joint)
    spec = _specification(tree)
    changes.apply(spec, tree)
    for closure in closures:
        _close(spec, tree, closure)
    for coupling in couplings:
        _couple(spec, coupling)
    return spec


def _read(path: str) -> UrdfTree | None:
    """Return the tree of a URDF file; None for other files, for which MuJoCo reports errors."""
    try:
        with open(path, encoding="utf-8-sig") as file:
            text = file.read()
    except (OSError, UnicodeDecodeError):
        return None
    if "<robot" not in text:
        return None
    # few files declare the prefix of Drake's elements
    text = re.sub(r"(</?)drake:", r"\1drake_", text)
    try:
        root = ElementTree.fromstring(re.sub(r"\bxmlns(:\w+)?=\"[^\"]*\"", "", text))
    except ElementTree.ParseError:
        return None
    if root.tag != "robot":
        return None
    parents: dict[str, tuple[Element, Frame]] = {}
    second: list[Element] = []
    tree = UrdfTree(path, root, parents, ())
    for joint in root.findall("joint"):
        child = _child(joint, "child").get("link", "")
        if child in parents:
            second.append(joint)
        else:
            parents[child] = joint, _pose(tree, _child(joint, "parent").get("link", ""), joint.find("origin"))
    return UrdfTree(path, root, parents, tuple(second))


def _second_parents(tree: UrdfTree) -> Iterator[LoopClosure]:
    for joint in tree.second:
        name = joint.get("name", "")
        if joint.get("type") == "floating":
            continue
        parent = tree.require_link(_child(joint, "parent").get("link", ""), name)
        child = tree.require_link(_child(joint, "child").get("link", ""), name)
        yield _closure(tree, joint, _pose(tree, parent, joint.find("origin")), Frame(child))


def _urdf_plus(tree: UrdfTree) -> Iterator[LoopClosure]:
    for loop in tree.root.findall("loop"):
        sides = [loop.find(side) for side in ("predecessor", "successor")]
        a, b = (_side(tree, loop, side, "predecessor and successor") for side in sides)
        yield _closure(tree, loop, a, b)


def _couplings(tree: UrdfTree) -> Iterator[UrdfCoupling]:
    """Yield the transmissions of URDF+.

    Source: Chignoli, Adrian, Kim, Wensing (2024), URDF+: an enhanced URDF for robots with kinematic loops,
    arXiv 2411.19753; signs as its authors' program generalized_rbda reads them.
    """
    for element in tree.root.findall("coupling"):
        name = element.get("name", "")
        a, b = (
            tree.joints_to(tree.require_link(_child(element, side).get("link", ""), name))
            for side in ("predecessor", "successor")
        )
        shared = set(a) & set(b)
        a, b = (tuple(joint for joint in side if joint not in shared) for side in (a, b))
        if not a or not b:
            raise tree.error(
                f"coupling {name!r} has no joint between its predecessor or successor and their common "
                "ancestor; name links on two branches"
            )
        (ratio,) = _numbers(tree, name, _child(element, "ratio").get("value", "1"), 1)
        yield UrdfCoupling(name, float(ratio), a, b)


def _isaac(tree: UrdfTree) -> Iterator[LoopClosure]:
    for loop in tree.root.findall("loop_joint"):
        # its manual calls both elements link1
        sides = [element for element in loop if element.tag in ("link1", "link2")]
        if len(sides) != 2:
            raise tree.error(f"loop_joint {loop.get('name')!r} has {len(sides)} links; give link1 and link2")
        a, b = (
            _pose(tree, tree.require_link(side.get("link", ""), loop.get("name", "")), side) for side in sides
        )
        yield _closure(tree, loop, a, b)


def _drake_balls(tree: UrdfTree) -> Iterator[LoopClosure]:
    for number, ball in enumerate(tree.root.findall("drake_ball_constraint"), 1):
        name = f"ball_constraint{number}"
        frames = [
            Frame(
                tree.require_link(_child(ball, f"drake_ball_constraint_body_{body}").get("name", ""), name),
                _numbers(tree, name, _child(ball, f"drake_ball_constraint_p_{point}").get("value", "")),
            )
            for body, point in (("A", "AP"), ("B", "BQ"))
        ]
        yield LoopClosure(name, "point", frames[0], frames[1])


def _drake_bushings(tree: UrdfTree) -> Iterator[LoopClosure]:
    """Yield the joints equivalent to bushings: stiff against displacement and about their stiff axes."""
    for number, bushing in enumerate(tree.root.findall("drake_linear_bushing_rpy"), 1):
        name = f"bushing{number}"
        frames = [
            _named_frame(tree, _child(bushing, f"drake_bushing_frame{side}").get("name", ""), name)
            for side in "AC"
        ]
        stiff = _numbers(tree, name, _child(bushing, "drake_bushing_torque_stiffness").get("value", "")) > 0.0
        if stiff.sum() == 1:
            raise tree.error(
                f"bushing {number} is stiff about one axis; no closure of two free axes is known"
            )
        kind: Kind = {0: "point", 2: "hinge", 3: "weld"}[int(stiff.sum())]  # type: ignore[assignment]
        axis = np.eye(3)[int(np.argmin(stiff))]
        yield LoopClosure(name, kind, frames[0], frames[1], axis)


def _gazebo(tree: UrdfTree) -> Iterator[LoopClosure]:
    """Yield the SDFormat joints in URDF; their pose is in the child's frame at the initial configuration."""
    for joint in tree.root.findall("gazebo/joint"):
        name = joint.get("name", "")
        parent, child = (
            tree.require_link((joint.findtext(side) or "").strip(), name) for side in ("parent", "child")
        )
        numbers = _numbers(tree, name, joint.findtext("pose") or "0 0 0 0 0 0", 6)
        relative = joint.find("pose")
        base = relative.get("relative_to") if relative is not None else None
        b = Frame(child if base in (None, "") else tree.require_link(str(base), name))
        b = b.then(numbers[:3], _rotation(numbers[3:]))
        placed = tree.in_root(b)
        frames = [tree.fixed_to(link, placed) for link in (parent, child)]
        axis = joint.findtext("axis/xyz")
        yield _closure(tree, joint, frames[0], frames[1], axis)


DIALECTS: tuple[Callable[[UrdfTree], Iterator[LoopClosure]], ...] = (
    _second_parents,
    _urdf_plus,
    _isaac,
    _drake_balls,
    _drake_bushings,
    _gazebo,
)


@dataclass(frozen=True)
class JointChanges:
    """Joints that a sidecar file changes to spherical, universal or fixed, and joints with a motor."""

    kinds: Mapping[str, str] = field(default_factory=dict[str, str])
    motors: tuple[str, ...] = ()

    def apply(self, spec: mujoco.MjSpec, tree: UrdfTree) -> None:
        names = [joint.name for joint in spec.joints]
        for name in (*self.kinds, *self.motors):
            if name not in names:
                raise tree.error(
                    f"the sidecar file has joint {name!r}{did_you_mean(name, names)}; name a joint"
                )
        for name in dict.fromkeys(self.motors):
            spec.add_actuator(name=f"{name}_motor", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        for name, kind in self.kinds.items():
            joint = spec.joint(name)
            if kind == "SPHERICAL":
                joint.type = mujoco.mjtJoint.mjJNT_BALL
                joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
            elif kind == "FIXED":
                spec.delete(joint)
            elif match := re.fullmatch(r"UJOINT_([XYZ])([XYZ])", str(kind)):
                first, second = (np.eye(3)["XYZ".index(axis)] for axis in match.groups())
                joint.axis, body = first, joint.parent
                joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
                body.add_joint(name=f"{name}_second", type=mujoco.mjtJoint.mjJNT_HINGE, axis=second)
            else:
                raise tree.error(
                    f"joint_type of {name!r} is {kind!r}; it can be SPHERICAL, FIXED or UJOINT_XY"
                )


def _sidecar(tree: UrdfTree, path: str) -> tuple[list[LoopClosure], JointChanges]:
    """Read a sidecar file with the list `closed_loop` of Gepetto or `closures` of scikit-robot."""
    with needs("robots"):
        import yaml
    try:
        with open(path, encoding="utf-8") as file:
            content: Any = yaml.safe_load(file)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; name a file with loop closures") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        line = getattr(getattr(error, "problem_mark", None), "line", None)
        where = "" if line is None else f", line {line + 1}"
        raise InputError(f"{path}{where} is no YAML; write closed_loop: [[FRAME, FRAME]]") from None
    lists = content if isinstance(content, dict) else {}
    for name, reader in SIDECARS.items():
        if isinstance(lists.get(name), list):
            return reader(tree, path, lists)
    raise InputError(f"{path} has no list {' or '.join(SIDECARS)}; write closed_loop: [[FRAME, FRAME]]")


def _scikit_robot(
    tree: UrdfTree, path: str, content: Mapping[str, Any]
) -> tuple[list[LoopClosure], JointChanges]:
    """Read hinges between two links; their point and axis are in the root frame at zero joint values."""
    closures: list[LoopClosure] = []
    for number, entry in enumerate(content["closures"], 1):
        name = f"closure{number}"
        if not isinstance(entry, dict) or {"link_a", "link_b", "point", "axis"} - entry.keys():
            raise InputError(f"{path}: {name} needs link_a, link_b, point and axis; give all four")
        point, axis = (
            _numbers(tree, name, re.sub(r"[\[\],]", " ", str(entry[key]))) for key in ("point", "axis")
        )
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise InputError(f"{path}: the axis of {name} has length 0; give a direction")
        sides = [
            tree.fixed_to(tree.require_link(str(entry[key]), name), Frame("", point))
            for key in ("link_a", "link_b")
        ]
        # both frames are parallel to the root frame at zero joint values
        closures.append(LoopClosure(name, "hinge", sides[0], sides[1], axis / length))
    motors = tuple(map(str, _list_of(content, "independent", path)))
    return closures, JointChanges(motors=motors)


def _gepetto(tree: UrdfTree, path: str, content: Mapping[str, Any]) -> tuple[list[LoopClosure], JointChanges]:
    """Read pairs of frames in `closed_loop`, each with a `type` of 3d or 6d."""
    pairs: list[Any] = content["closed_loop"]
    types = _list_of(content, "type", path) or ["6d"] * len(pairs)
    if len(types) != len(pairs) or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        raise InputError(
            f"{path}: closed_loop needs two frames a loop, and type one entry a loop; correct them"
        )
    closures: list[LoopClosure] = []
    for number, (pair, kind) in enumerate(zip(pairs, types, strict=True), 1):
        name = f"closed_loop{number}"
        if str(kind).lower() not in KINDS:
            raise InputError(f"{path}: type of loop {number} is {kind!r}; it can be 3d or 6d")
        a, b = (_named_frame(tree, str(frame), name) for frame in pair)
        closures.append(LoopClosure(name, KINDS[str(kind).lower()], a, b))
    names, kinds = (_list_of(content, key, path) for key in ("joint_name", "joint_type"))
    if len(names) != len(kinds):
        raise InputError(
            f"{path}: joint_name has {len(names)} entries, joint_type {len(kinds)}; give as many"
        )
    motors = tuple(map(str, _list_of(content, "name_mot", path)))
    return closures, JointChanges(dict(zip(map(str, names), map(str, kinds), strict=True)), motors)


def _list_of(content: Mapping[str, Any], key: str, path: str) -> list[Any]:
    """Return a list of a sidecar file; empty if it has none."""
    value = content.get(key) or []
    if not isinstance(value, list):
        raise InputError(f"{path}: {key} is {value!r}; write a list, as {key}: [NAME]")
    return value


# first list of a sidecar file -> its reader
SIDECARS: dict[str, Callable[..., tuple[list[LoopClosure], JointChanges]]] = {
    "closed_loop": _gepetto,
    "closures": _scikit_robot,
}


def _named_frame(tree: UrdfTree, name: str, joint: str) -> Frame:
    """Return a frame by its name: a `<frame>` of Drake, a link, or the fixed joint that places a link."""
    for frame in tree.root.findall("frame"):
        if frame.get("name") == name:
            return _pose(tree, tree.require_link(frame.get("link", ""), joint), frame)
    for link, (element, _) in tree.parents.items():
        if element.get("name") == name:
            return Frame(link)
    return Frame(tree.require_link(name, joint))


def _closure(tree: UrdfTree, element: Element, a: Frame, b: Frame, axis: str | None = None) -> LoopClosure:
    name, kind = element.get("name", ""), element.get("type", "")
    if kind not in KINDS:
        accepted = "revolute, continuous, spherical, ball or fixed"
        raise tree.error(f"loop joint {name!r} is of type {kind!r}; a loop is closed by {accepted}")
    own = element.find("axis")
    text = axis or (own.get("xyz") if own is not None else None)
    default = "1 0 0" if element.tag == "joint" and axis is None else "0 0 1"
    direction = _numbers(tree, name, text or default)
    length = float(np.linalg.norm(direction))
    if KINDS[kind] == "hinge" and not length > 0.0:
        raise tree.error(f"the axis of loop joint {name!r} has length 0; give a direction")
    return LoopClosure(name, KINDS[kind], a, b, direction / (length or 1.0))


def _side(tree: UrdfTree, loop: Element, side: Element | None, names: str) -> Frame:
    if side is None:
        raise tree.error(f"loop {loop.get('name')!r} lacks one of {names}; give both")
    link = tree.require_link(side.get("link", ""), loop.get("name", ""))
    return _pose(tree, link, side.find("origin"))


def _child(element: Element, tag: str) -> Element:
    child = element.find(tag)
    return Element(tag) if child is None else child


def _pose(tree: UrdfTree, link: str, origin: Element | None) -> Frame:
    """Return the frame on a link at the attributes xyz and rpy of an element."""
    if origin is None:
        return Frame(link)
    position, angles = (_numbers(tree, link, origin.get(key) or "0 0 0") for key in ("xyz", "rpy"))
    return Frame(link, position, _rotation(angles))


def _numbers(tree: UrdfTree, name: str, text: str, count: int = 3) -> Array:
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.zeros(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise tree.error(f"{name!r} has {text!r} where {count} finite numbers belong; correct them")
    return values


def _rotation(angles: Array) -> Array:
    """Return the rotation matrix of roll, pitch and yaw in [rad] about fixed axes x, y, z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("xyz", angles).as_matrix(), dtype=np.float64)


def _specification(tree: UrdfTree) -> mujoco.MjSpec:
    """Return the specification of the tree without the joints that close loops."""
    if not tree.second:
        return mujoco.MjSpec.from_file(tree.path)
    text = re.sub(r"(</?)drake_", r"\1drake:", ElementTree.tostring(tree.root, encoding="unicode"))
    spec = mujoco.MjSpec.from_string(text)
    spec.modelfiledir = os.path.dirname(os.path.abspath(tree.path))
    return spec


def _close(spec: mujoco.MjSpec, tree: UrdfTree, closure: LoopClosure) -> None:
    """Add the sites of a closure and the equalities between them."""
    offsets = (np.zeros(3), HINGE_LENGTH * closure.axis) if closure.kind == "hinge" else (np.zeros(3),)
    for number, offset in enumerate(offsets):
        name = closure.name if not number else f"{closure.name}_axis"
        sites: list[str] = []
        for side, frame in (("a", closure.a), ("b", closure.b)):
            placed = tree.moving(frame)
            body = spec.worldbody if placed.link == ROOT else spec.body(placed.link)
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, placed.rotation.ravel())
            position = placed.position + placed.rotation @ offset
            body.add_site(name=f"{name}_{side}", pos=position, quat=quaternion)
            sites.append(f"{name}_{side}")
        kind = mujoco.mjtEq.mjEQ_WELD if closure.kind == "weld" else mujoco.mjtEq.mjEQ_CONNECT
        spec.add_equality(
            name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=sites[0], name2=sites[1]
        )


def _couple(spec: mujoco.MjSpec, coupling: UrdfCoupling) -> None:
    """Add the equality of two joints, or of a fixed tendon over more."""
    if len(coupling.a) == len(coupling.b) == 1:
        equality = spec.add_equality(
            name=coupling.name,
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=coupling.b[0],
            name2=coupling.a[0],
        )
        equality.data[:2] = 0.0, coupling.ratio
        return
    tendon = spec.add_tendon(name=coupling.name)
    for joint in coupling.a:
        tendon.wrap_joint(joint, coupling.ratio)
    for joint in coupling.b:
        tendon.wrap_joint(joint, -1.0)
    equality = spec.add_equality(
        name=coupling.name,
        type=mujoco.mjtEq.mjEQ_TENDON,
        objtype=mujoco.mjtObj.mjOBJ_TENDON,
        name1=coupling.name,
    )
    equality.data[:2] = 0.0, 0.0
