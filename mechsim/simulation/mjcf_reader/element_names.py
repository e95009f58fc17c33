"""Names for unnamed elements of a specification, so that both methods use the same names."""

from collections.abc import Iterable
from typing import Any

import mujoco

from mechsim.model.links import GROUND


def name_elements(spec: mujoco.MjSpec) -> None:
    """Name the bodies, joints and equalities that have no name; a body called as the frame is renamed."""
    bodies = list(spec.bodies)[1:]
    names = {GROUND, "world", *(body.name for body in bodies)}
    for number, body in enumerate(bodies, 1):
        if not body.name:
            body.name = _free(f"body{number}", names)
    joints = [joint for body in bodies for joint in body.joints]
    _name(joints, [f"{joint.parent.name}_joint" for joint in joints])
    equalities = list(spec.equalities)
    kinds = [str(mujoco.mjtEq(equality.type).name).removeprefix("mjEQ_").lower() for equality in equalities]
    _name(equalities, [f"{kind}{number}" for number, kind in enumerate(kinds, 1)])


def _name(elements: Iterable[Any], proposed: Iterable[str]) -> None:
    elements = list(elements)
    names = {element.name for element in elements}
    for element, name in zip(elements, proposed, strict=True):
        if not element.name:
            element.name = _free(name, names)


def _free(name: str, names: set[str]) -> str:
    """Return a name that is not taken yet, and take it."""
    free, count = name, 1
    while free in names:
        count += 1
        free = f"{name}{count}"
    names.add(free)
    return free
