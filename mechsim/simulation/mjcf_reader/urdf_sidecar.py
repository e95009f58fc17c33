"""Loop closures of a URDF file in a YAML sidecar file of Gepetto's parallel robots or of scikit-robot."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError, cut, needs
from mechsim.files import read_text
from mechsim.mechanism.finding import Finding
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean
from mechsim.simulation.mjcf_reader.urdf_tree import KINDS, Frame, LoopClosure, UrdfTree

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
