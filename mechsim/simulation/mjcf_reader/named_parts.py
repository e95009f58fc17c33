"""Names for what has none in a specification, so that both roads call it the same."""

from collections.abc import Iterable
from typing import Any

import mujoco

from mechsim.model.links import GROUND


def name_parts(spec: mujoco.MjSpec) -> None:
    """Name the bodies, joints and equalities that have no name; a body called as the frame is renamed."""
    bodies = list(spec.bodies)[1:]
    taken = {GROUND, "world", *(body.name for body in bodies)}
    for number, body in enumerate(bodies, 1):
        if not body.name:
            body.name = _free(f"body{number}", taken)
    joints = [joint for body in bodies for joint in body.joints]
    _name(joints, [f"{joint.parent.name}_joint" for joint in joints])
    equalities = list(spec.equalities)
    kinds = [str(mujoco.mjtEq(one.type).name).removeprefix("mjEQ_").lower() for one in equalities]
    _name(equalities, [f"{kind}{number}" for number, kind in enumerate(kinds, 1)])


def _name(parts: Iterable[Any], wanted: Iterable[str]) -> None:
    parts = list(parts)
    taken = {part.name for part in parts}
    for part, name in zip(parts, wanted, strict=True):
        if not part.name:
            part.name = _free(name, taken)


def _free(name: str, taken: set[str]) -> str:
    """Return a name that is not taken yet, and take it."""
    free, count = name, 1
    while free in taken:
        count += 1
        free = f"{name}{count}"
    taken.add(free)
    return free
