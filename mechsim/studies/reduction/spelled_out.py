"""A scene spelled out, so that parts of it can be left out: all named, loops closed between sites."""

from collections.abc import Sequence
from itertools import count
from typing import Any

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf_reader.named_parts import name_parts

CONNECT, WELD = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD
BODY, SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE


def spelled_out(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy in which every part has a name and connects and welds join sites.

    Joined bodies would be told anew where they meet by the compiler, from where they stand in a scene that
    lacks parts. What MuJoCo computes of the copy is the same.
    """
    copy = spec.copy()
    for key in list(copy.keys):  # they fit no scene that lacks a joint
        copy.delete(key)
    name_parts(copy)
    for parts, what in (
        (copy.geoms, "geom"),
        (copy.sites, "site"),
        (copy.actuators, "actuator"),
        (copy.tendons, "tendon"),
        (copy.sensors, "sensor"),
    ):
        _name(parts, what)
    _close_between_sites(copy)
    return copy


def _name(parts: Sequence[Any], what: str) -> None:
    """Name what has none by its number, as MuJoCo's own programs call it."""
    taken = {part.name for part in parts}
    for number, part in enumerate(parts, 1):
        if not part.name:
            names = (f"{what}{number}" if i == 1 else f"{what}{number}_{i}" for i in count(1))
            part.name = next(name for name in names if name not in taken)
            taken.add(part.name)


def _close_between_sites(spec: mujoco.MjSpec) -> None:
    model = plainly_compiled(spec)
    bodies = {body.name: body for body in spec.bodies}
    for number, equality in enumerate(list(spec.equalities)):
        if equality.type not in (CONNECT, WELD) or equality.objtype != BODY:
            continue
        data, weld = model.eq_data[number], equality.type == WELD
        # of a weld the anchor comes first, in body 2; then where body 2 is in body 1
        places = (data[3:6], data[0:3]) if weld else (data[0:3], data[3:6])
        turns = (data[6:10] if weld else _straight(), _straight())
        ends = (model.eq_obj1id[number], max(int(model.eq_obj2id[number]), 0))
        names: list[str] = []
        for end, place, turn in zip(ends, places, turns, strict=True):
            body = bodies[model.body(int(end)).name]
            name = f"{equality.name}@{body.name}"
            while spec.site(name) is not None:
                name += "'"
            body.add_site(name=name, pos=place, quat=turn, group=5)
            names.append(name)
        equality.name1, equality.name2 = names
        equality.objtype = SITE
        equality.data = np.concatenate([np.zeros(10), data[10:]]) if weld else np.zeros(len(data))


def _straight() -> Array:
    return np.array([1.0, 0.0, 0.0, 0.0])
