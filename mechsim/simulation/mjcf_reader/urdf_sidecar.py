"""Loop closures of a URDF file in a YAML sidecar file of Gepetto's parallel robots or of scikit-robot."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from mechsim.errors import InputError, needs
from mechsim.simulation.mjcf_reader.coordinates import did_you_mean
from mechsim.simulation.mjcf_reader.urdf_tree import (
    KINDS,
    Frame,
    LoopClosure,
    UrdfTree,
    named_frame,
    numbers_of,
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


def read_sidecar(tree: UrdfTree, path: str) -> tuple[list[LoopClosure], JointChanges]:
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
            numbers_of(tree, name, re.sub(r"[\[\],]", " ", str(entry[key]))) for key in ("point", "axis")
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
        a, b = (named_frame(tree, str(frame), name) for frame in pair)
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
