"""A normalised scene from which elements can be removed: all named, loops closed between sites."""

from collections.abc import Sequence
from itertools import count
from typing import Any

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf_reader.element_names import name_elements

CONNECT, WELD = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD
BODY, SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE


def normalised(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy in which every element has a name and connects and welds join sites.

    Between bodies the compiler would compute the anchors anew from the pose of the reduced scene. The
    simulation of the copy is the same.
    """
    copy = spec.copy()
    for key in list(copy.keys):  # they do not fit a scene without all joints
        copy.delete(key)
    name_elements(copy)
    for elements, what in (
        (copy.geoms, "geom"),
        (copy.sites, "site"),
        (copy.actuators, "actuator"),
        (copy.tendons, "tendon"),
        (copy.sensors, "sensor"),
    ):
        _name_elements(elements, what)
    _close_between_sites(copy)
    return copy


def _name_elements(elements: Sequence[Any], what: str) -> None:
    """Name unnamed elements by their numbers, as MuJoCo's own programs do."""
    used = {element.name for element in elements}
    for number, element in enumerate(elements, 1):
        if not element.name:
            names = (f"{what}{number}" if i == 1 else f"{what}{number}_{i}" for i in count(1))
            element.name = next(name for name in names if name not in used)
            used.add(element.name)


def _close_between_sites(spec: mujoco.MjSpec) -> None:
    model = plainly_compiled(spec)
    bodies = {body.name: body for body in spec.bodies}
    for number, equality in enumerate(list(spec.equalities)):
        if equality.type not in (CONNECT, WELD) or equality.objtype != BODY:
            continue
        data, weld = model.eq_data[number], equality.type == WELD
        # of a weld the anchor comes first, in body 2; then where body 2 is in body 1
        positions = (data[3:6], data[0:3]) if weld else (data[0:3], data[3:6])
        rotations = (data[6:10] if weld else _identity(), _identity())
        ends = (model.eq_obj1id[number], max(int(model.eq_obj2id[number]), 0))
        names: list[str] = []
        for end, position, rotation in zip(ends, positions, rotations, strict=True):
            body = bodies[model.body(int(end)).name]
            name = f"{equality.name}@{body.name}"
            while spec.site(name) is not None:
                name += "'"
            body.add_site(name=name, pos=position, quat=rotation, group=5)
            names.append(name)
        equality.name1, equality.name2 = names
        equality.objtype = SITE
        equality.data = np.concatenate([np.zeros(10), data[10:]]) if weld else np.zeros(len(data))


def _identity() -> Array:
    return np.array([1.0, 0.0, 0.0, 0.0])
