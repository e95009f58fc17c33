"""The links and joints of a URDF file as a tree, frames on its links, and the closures of its loops."""

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal
from xml.parsers import expat

import numpy as np

from mechsim.errors import InputError, several
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean
from mechsim.simulation.mjcf_reader.file_errors import ill_formed

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
class UrdfTree:
    """The tree of a URDF file.

    Attributes:
        path: path of the file.
        root: root element of the file, with drake_ for the prefix drake: of tags.
        lines: element -> its line.
        parents: link -> joint element, parent link and pose in it, for the first joint that names the link.
        second: joints to links that already have a parent.
    """

    path: str
    root: Element
    lines: Mapping[Element, int]
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

    def link_of(self, element: Element, joint: str) -> str:
        """Return the link that an element names; raise InputError if the file has no such link."""
        return self.require_link(element.get("link", ""), joint)

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
        position = own.rotation.T @ (placed.position - own.position)
        return Frame(link, position, own.rotation.T @ placed.rotation)

    def in_root(self, frame: Frame) -> Frame:
        """Return a frame in the root link at zero joint values."""
        while frame.link in self.parents:
            frame = self.parents[frame.link][1].then(frame.position, frame.rotation)
        return frame

    def named_frame(self, name: str, joint: str) -> Frame:
        """Return a frame by its name: a `<frame>` of Drake, a link, or the fixed joint that places a link."""
        for frame in self.root.findall("frame"):
            if frame.get("name") == name:
                return self.pose_of(self.require_link(frame.get("link", ""), joint), frame)
        for link, (element, _) in self.parents.items():
            if element.get("name") == name:
                return Frame(link)
        return Frame(self.require_link(name, joint))

    def pose_of(self, link: str, origin: Element | None) -> Frame:
        """Return the frame on a link at the attributes xyz and rpy of an element."""
        if origin is None:
            return Frame(link)
        position, angles = (self.numbers_of(link, origin.get(key) or "0 0 0") for key in ("xyz", "rpy"))
        return Frame(link, position, rotation_of(angles))

    def numbers_of(self, name: str, text: str, count: int = 3) -> Array:
        """Return a number of finite numbers, (count,), from text; raise InputError for any other text."""
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.zeros(0)
        if values.shape != (count,) or not np.isfinite(values).all():
            raise self.error(f"{name!r} has {text!r} where {count} finite numbers belong; correct them")
        return values


def read_urdf(path: str) -> UrdfTree:
    """Return the tree of a URDF file.

    Raises:
        InputError: for a file that is not well-formed, of which MuJoCo's tolerant parser reads a part.
    """
    with open(path, encoding="utf-8-sig") as file:
        root, lines = _parsed(path, file.read())
    parents: dict[str, tuple[Element, Frame]] = {}
    second: list[Element] = []
    tree = UrdfTree(path, root, lines, parents, ())
    for name, count in Counter(joint.get("name", "") for joint in root.findall("joint")).items():
        if not name or count > 1:
            raise tree.error(f"{several(count, 'joint')} with the name {name!r}; give each its own")
    for joint in root.findall("joint"):
        child = child_of(joint, "child").get("link", "")
        if child in parents:
            second.append(joint)
        else:
            parent = child_of(joint, "parent").get("link", "")
            parents[child] = joint, tree.pose_of(parent, joint.find("origin"))
    return UrdfTree(path, root, lines, parents, tuple(second))


def _parsed(path: str, text: str) -> tuple[Element, dict[Element, int]]:
    """Return the root of an XML text, whose prefixes need no declaration, and the line of each element."""
    parser, builder, lines = expat.ParserCreate(), ElementTree.TreeBuilder(), dict[Element, int]()

    def start(tag: str, attributes: dict[str, str]) -> None:
        lines[builder.start(tag.replace("drake:", "drake_"), attributes)] = parser.CurrentLineNumber

    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise ill_formed(path, error) from None
    return builder.close(), lines


def child_of(element: Element, tag: str) -> Element:
    """Return the first child with a tag; an empty element if there is none."""
    child = element.find(tag)
    return Element(tag) if child is None else child


def rotation_of(angles: Array) -> Array:
    """Return the rotation matrix of roll, pitch and yaw in [rad] about fixed axes x, y, z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("xyz", angles).as_matrix(), dtype=np.float64)
