"""Loops of URDF files: read from dialects of URDF, which has no loops, and closed by equalities of sites.

Dialects in the file: a link with two parents, `<loop>` and `<coupling>` of URDF+, `<loop_joint>` of Isaac
Sim, `<drake:ball_constraint>` and `<drake:linear_bushing_rpy>` of Drake, `<gazebo><joint>` of Gazebo, and the
links `closing_NAME_1`, `closing_NAME_2` that onshape-to-robot writes for a mate `closing_NAME`.

A sidecar file in YAML is one of Gepetto's parallel robots or of scikit-robot.
"""

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError, cut, needs
from mechsim.files import read_text
from mechsim.mechanism.finding import Finding
from mechsim.simulation.mjcf_reader import urdf_tree
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean
from mechsim.simulation.mjcf_reader.file_text import UrdfFile
from mechsim.simulation.mjcf_reader.urdf_tree import KINDS, Frame, LoopClosure, UrdfTree, child_of
from mechsim.simulation.mjcf_reader.urdf_unread import unread_elements
from mechsim.simulation.state import quaternion

# largest sidecar file in bytes: a robot has a few loops
MAX_BYTES = 100_000
# largest number of characters of a value in a message
MAX_SHOWN = 60


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
                choice = "it can be SPHERICAL, FIXED or UJOINT_XY"
                raise tree.error(f"joint_type of {name!r} is {kind!r}; {choice}")


@dataclass(frozen=True)
class Sidecar:
    """A sidecar file. Aliases can make its values much longer than its text: none is quoted whole.

    Attributes:
        path: its path.
        content: its first level; all scalars are text.
        lines: key -> its line.
    """

    path: str
    content: Mapping[str, Any]
    lines: Mapping[str, int]

    def error(self, key: str, message: str) -> InputError:
        """Return the error about a key."""
        return InputError(f"{self.path}, line {self.lines.get(key, 1)}: {message}")

    def list_of(self, key: str) -> list[Any]:
        """Return a list; empty if the file has none."""
        value = self.content.get(key, "")
        if value in ("", "null", "~"):
            return []
        if not isinstance(value, list):
            raise self.error(key, f"{key} is {_shown(value)}; write a list, as {key}: [NAME]")
        return value

    def texts(self, key: str) -> list[str]:
        """Return a list of names or numbers."""
        return [self.text(key, value) for value in self.list_of(key)]

    def text(self, key: str, value: object) -> str:
        """Return a name or number of a list."""
        if not isinstance(value, str):
            message = f"{key} contains {_shown(value)} where a name or a number belongs; correct it"
            raise self.error(key, message)
        return value


def _shown(value: object) -> str:
    return cut(value, MAX_SHOWN) if isinstance(value, str) else f"a {type(value).__name__}"


def read_sidecar(tree: UrdfTree, path: str) -> tuple[list[LoopClosure], JointChanges, list[Finding]]:
    """Read a sidecar file with the list `closed_loop` of Gepetto or `closures` of scikit-robot.

    Returns:
        The closures, the changes of joints, and findings on keys that are not read.
    """
    with needs("robots"):
        import yaml
    text = read_text(path, "a file with loop closures", MAX_BYTES)
    try:
        # without constructors of types, which raise errors of their own
        loader = yaml.BaseLoader(text)
        root: Any = loader.get_single_node()
        content: Any = loader.construct_document(root) if isinstance(root, yaml.MappingNode) else {}
    except (yaml.YAMLError, RecursionError) as error:
        line = getattr(getattr(error, "problem_mark", None), "line", None)
        where = "" if line is None else f", line {line + 1}"
        raise InputError(f"{path}{where} is no YAML; write closed_loop: [[FRAME, FRAME]]") from None
    lines = {key.value: key.start_mark.line + 1 for key, _ in (root.value if content else ())}
    file = Sidecar(path, content, lines)
    for (name, *more), reader in SIDECARS.items():
        if isinstance(file.content.get(name), list):
            closures, changes = reader(tree, file)
            unread = [
                Finding(
                    kind="unread",
                    object=cut(key, MAX_SHOWN),
                    value=1.0,
                    message=f"{cut(key, MAX_SHOWN)} is not read",
                    remedy=f"take it out, or write {', '.join([name, *more])}",
                    file=path,
                    line=file.lines.get(key),
                )
                for key in file.content
                if key not in (name, *more)
            ]
            return closures, changes, unread
    first = [names[0] for names in SIDECARS]
    key = next((name for name in first if name in file.content), "")
    raise file.error(key, f"it has no list {' or '.join(first)}; write closed_loop: [[FRAME, FRAME]]")


def _scikit_robot(tree: UrdfTree, file: Sidecar) -> tuple[list[LoopClosure], JointChanges]:
    """Read hinges between two links; their point and axis are in the root frame at zero joint values."""
    closures: list[LoopClosure] = []
    for number, entry in enumerate(file.list_of("closures"), 1):
        name = f"closure{number}"
        if not isinstance(entry, dict) or {"link_a", "link_b", "point", "axis"} - entry.keys():
            raise file.error("closures", f"{name} needs link_a, link_b, point and axis; give all four")
        point, axis = (
            tree.numbers_of(name, " ".join(file.text("closures", number) for number in _items(entry[key])))
            for key in ("point", "axis")
        )
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise file.error("closures", f"the axis of {name} has length 0; give a direction")
        links = [tree.require_link(file.text("closures", entry[key]), name) for key in ("link_a", "link_b")]
        # both frames are parallel to the root frame at zero joint values
        a, b = (tree.fixed_to(link, Frame("", point)) for link in links)
        closures.append(LoopClosure(name, "hinge", a, b, axis / length))
    return closures, JointChanges(motors=tuple(file.texts("independent")))


def _items(value: object) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _gepetto(tree: UrdfTree, file: Sidecar) -> tuple[list[LoopClosure], JointChanges]:
    """Read pairs of frames in `closed_loop`, each with a `type` of 3d or 6d."""
    pairs = file.list_of("closed_loop")
    types = file.texts("type") or ["6d"] * len(pairs)
    if len(types) != len(pairs) or not all(isinstance(pair, list) and len(pair) == 2 for pair in pairs):
        message = "closed_loop needs two frames a loop, and type one entry a loop; correct them"
        raise file.error("closed_loop", message)
    closures: list[LoopClosure] = []
    for number, (pair, kind) in enumerate(zip(pairs, types, strict=True), 1):
        name = f"closed_loop{number}"
        if kind.lower() not in KINDS:
            raise file.error("type", f"type of loop {number} is {_shown(kind)}; it can be 3d or 6d")
        a, b = (tree.named_frame(file.text("closed_loop", frame), name) for frame in pair)
        closures.append(LoopClosure(name, KINDS[kind.lower()], a, b))
    names, kinds = file.texts("joint_name"), file.texts("joint_type")
    if len(names) != len(kinds):
        message = f"joint_name has {len(names)} entries, joint_type {len(kinds)}; give as many"
        raise file.error("joint_name", message)
    return closures, JointChanges(dict(zip(names, kinds, strict=True)), tuple(file.texts("name_mot")))


# first list of a sidecar file and its other keys -> its reader
SIDECARS: dict[tuple[str, ...], Callable[..., tuple[list[LoopClosure], JointChanges]]] = {
    ("closed_loop", "type", "joint_name", "joint_type", "name_mot"): _gepetto,
    ("closures", "independent", "dependent"): _scikit_robot,
}


# distance in [m] between the two points of a hinge closure along its axis
HINGE_LENGTH = 0.1


def urdf_specification(file: UrdfFile) -> tuple[mujoco.MjSpec, list[Finding]]:
    """Return the specification of a URDF file with closed loops, and findings on what is not read.

    Raises:
        InputError: if the file or a loop joint cannot be read, with file, joint and remedy.
    """
    tree = urdf_tree.read_urdf(file.path)
    unread = list(unread_elements(tree))
    closures = [closure for reader in DIALECTS for closure in reader(tree)]
    changes = JointChanges()
    if file.loops is not None:
        more, changes, ignored = read_sidecar(tree, file.loops)
        closures += more
        unread += ignored
    if tree.second:
        for joint in tree.second:
            tree.root.remove(joint)
        text = re.sub(r"(</?)drake_", r"\1drake:", ElementTree.tostring(tree.root, encoding="unicode"))
        spec = mujoco.MjSpec.from_string(text)
        spec.modelfiledir = os.path.dirname(os.path.abspath(tree.path))
    else:
        spec = mujoco.MjSpec.from_file(tree.path)
    changes.apply(spec, tree)
    for closure in closures:
        _close(spec, tree, closure)
    _add_couplings(spec, tree)
    return spec, unread


def _second_parents(tree: UrdfTree) -> Iterator[LoopClosure]:
    for joint in tree.second:
        name = joint.get("name", "")
        if joint.get("type") == "floating":
            continue
        parent, child = (tree.link_of(child_of(joint, side), name) for side in ("parent", "child"))
        yield _closure(tree, joint, tree.pose_of(parent, joint.find("origin")), Frame(child))


def _urdf_plus(tree: UrdfTree) -> Iterator[LoopClosure]:
    for loop in tree.root.findall("loop"):
        frames = list[Frame]()
        for tag in ("predecessor", "successor"):
            side = loop.find(tag)
            if side is None:
                raise tree.error(
                    f"loop {loop.get('name')!r} lacks one of predecessor and successor; give both"
                )
            frames.append(tree.pose_of(tree.link_of(side, loop.get("name", "")), side.find("origin")))
        yield _closure(tree, loop, frames[0], frames[1])


def _add_couplings(spec: mujoco.MjSpec, tree: UrdfTree) -> None:
    """Add the transmissions of URDF+: equalities of two joints, or of a fixed tendon over more.

    `ratio` times the sum of the positions of the joints `a`, from the common ancestor to the predecessor, is
    the sum of the positions of `b`, from there to the successor.
    Source: Chignoli, Adrian, Kim, Wensing (2024), URDF+: an enhanced URDF for robots with kinematic loops,
    arXiv 2411.19753; signs as its authors' program generalized_rbda reads them.
    """
    for element in tree.root.findall("coupling"):
        name = element.get("name", "")
        sides = [child_of(element, side) for side in ("predecessor", "successor")]
        joints_a, joints_b = (tree.joints_to(tree.link_of(side, name)) for side in sides)
        a = [joint for joint in joints_a if joint not in joints_b]
        b = [joint for joint in joints_b if joint not in joints_a]
        if not a or not b:
            raise tree.error(
                f"coupling {name!r} has no joint between its predecessor or successor and their common "
                "ancestor; name links on two branches"
            )
        (ratio,) = tree.numbers_of(name, child_of(element, "ratio").get("value", "1"), 1).tolist()
        kind, object_kind = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
        name1, name2, factor = b[0], a[0], ratio
        if len(a) > 1 or len(b) > 1:
            tendon = spec.add_tendon(name=name)
            for joint in a:
                tendon.wrap_joint(joint, ratio)
            for joint in b:
                tendon.wrap_joint(joint, -1.0)
            kind, object_kind = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtObj.mjOBJ_TENDON
            name1, name2, factor = name, "", 0.0
        equality = spec.add_equality(name=name, type=kind, objtype=object_kind, name1=name1, name2=name2)
        equality.data[:2] = 0.0, factor


def _isaac(tree: UrdfTree) -> Iterator[LoopClosure]:
    for loop in tree.root.findall("loop_joint"):
        # its manual calls both elements link1
        sides = [element for element in loop if element.tag in ("link1", "link2")]
        if len(sides) != 2:
            raise tree.error(f"loop_joint {loop.get('name')!r} has {len(sides)} links; give link1 and link2")
        a, b = (tree.pose_of(tree.link_of(side, loop.get("name", "")), side) for side in sides)
        yield _closure(tree, loop, a, b)


def _drake_balls(tree: UrdfTree) -> Iterator[LoopClosure]:
    for number, ball in enumerate(tree.root.findall("drake_ball_constraint"), 1):
        name = f"ball_constraint{number}"
        frames = [
            Frame(
                tree.require_link(child_of(ball, f"drake_ball_constraint_body_{body}").get("name", ""), name),
                tree.numbers_of(name, child_of(ball, f"drake_ball_constraint_p_{point}").get("value", "")),
            )
            for body, point in (("A", "AP"), ("B", "BQ"))
        ]
        yield LoopClosure(name, "point", frames[0], frames[1])


def _drake_bushings(tree: UrdfTree) -> Iterator[LoopClosure]:
    """Yield the joints equivalent to bushings: stiff against displacement and about their stiff axes."""
    for number, bushing in enumerate(tree.root.findall("drake_linear_bushing_rpy"), 1):
        name = f"bushing{number}"
        frames = [
            tree.named_frame(child_of(bushing, f"drake_bushing_frame{side}").get("name", ""), name)
            for side in "AC"
        ]
        stiffness = child_of(bushing, "drake_bushing_torque_stiffness").get("value", "")
        stiff = tree.numbers_of(name, stiffness) > 0.0
        kinds: dict[int, urdf_tree.Kind] = {0: "point", 2: "hinge", 3: "weld"}
        kind = kinds.get(int(stiff.sum()))
        if kind is None:
            raise tree.error(
                f"bushing {number} is stiff about one axis; no closure of two free axes is known"
            )
        axis = np.eye(3)[int(np.argmin(stiff))]
        yield LoopClosure(name, kind, frames[0], frames[1], axis)


def _gazebo(tree: UrdfTree) -> Iterator[LoopClosure]:
    """Yield the SDFormat joints in URDF; their pose is in the child's frame at the initial configuration."""
    for joint in tree.root.findall("gazebo/joint"):
        name = joint.get("name", "")
        parent, child = (
            tree.require_link((joint.findtext(side) or "").strip(), name) for side in ("parent", "child")
        )
        numbers = tree.numbers_of(name, joint.findtext("pose") or "0 0 0 0 0 0", 6)
        relative = joint.find("pose")
        base = relative.get("relative_to") if relative is not None else None
        b = Frame(child if base in (None, "") else tree.require_link(str(base), name))
        b = b.then(numbers[:3], urdf_tree.rotation_of(numbers[3:]))
        placed = tree.in_root(b)
        frames = [tree.fixed_to(link, placed) for link in (parent, child)]
        yield _closure(tree, joint, frames[0], frames[1], joint.findtext("axis/xyz"))


def _closing_links(tree: UrdfTree) -> Iterator[LoopClosure]:
    """Yield the mates that onshape-to-robot writes as two links; a revolute one has two more on its axis."""
    links = {link.get("name", "") for link in tree.root.findall("link")}
    for link in sorted(links):
        name, end, rest = link.rpartition("_1")
        if not (name.startswith("closing_") and end and not rest):
            continue
        kind: urdf_tree.Kind = "hinge" if f"{link}_z" in links else "point"
        yield LoopClosure(name, kind, Frame(link), Frame(tree.require_link(f"{name}_2", name)))


DIALECTS: tuple[Callable[[UrdfTree], Iterator[LoopClosure]], ...] = (
    _second_parents,
    _urdf_plus,
    _isaac,
    _drake_balls,
    _drake_bushings,
    _gazebo,
    _closing_links,
)


def _closure(
    tree: UrdfTree, element: urdf_tree.Element, a: Frame, b: Frame, axis: str | None = None
) -> LoopClosure:
    name, kind = element.get("name", ""), element.get("type", "")
    if kind not in urdf_tree.KINDS:
        accepted = "revolute, continuous, spherical, ball or fixed"
        raise tree.error(f"loop joint {name!r} is of type {kind!r}; a loop is closed by {accepted}")
    own = element.find("axis")
    text = axis or (own.get("xyz") if own is not None else None)
    default = "1 0 0" if element.tag == "joint" and axis is None else "0 0 1"
    direction = tree.numbers_of(name, text or default)
    length = float(np.linalg.norm(direction))
    if urdf_tree.KINDS[kind] == "hinge" and not length > 0.0:
        raise tree.error(f"the axis of loop joint {name!r} has length 0; give a direction")
    return LoopClosure(name, urdf_tree.KINDS[kind], a, b, direction / (length or 1.0))


def _close(spec: mujoco.MjSpec, tree: UrdfTree, closure: LoopClosure) -> None:
    """Add the sites of a closure and the equalities between them; its point on side a is tracked.

    Sites with @ in their name are not tracked.
    """
    offsets = (np.zeros(3), HINGE_LENGTH * closure.axis) if closure.kind == "hinge" else (np.zeros(3),)
    for number, offset in enumerate(offsets):
        name = closure.name if not number else f"{closure.name}_axis"
        sites: list[str] = []
        for side, frame in (("a", closure.a), ("b", closure.b)):
            placed = tree.moving(frame)
            body = spec.worldbody if placed.link == urdf_tree.ROOT else spec.body(placed.link)
            position = placed.position + placed.rotation @ offset
            sites.append(closure.name if side == "a" and not number else f"{name}@{side}")
            body.add_site(name=sites[-1], pos=position, quat=quaternion(placed.rotation))
        kind = mujoco.mjtEq.mjEQ_WELD if closure.kind == "weld" else mujoco.mjtEq.mjEQ_CONNECT
        spec.add_equality(
            name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=sites[0], name2=sites[1]
        )
