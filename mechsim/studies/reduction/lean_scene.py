"""A scene that may lack parts of the full one, put through the same motion."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.maths.arrays import Array
from mechsim.studies.scenes.user_scene import UserScene


@dataclass(frozen=True)
class LeanScene(UserScene):
    """A scene of which parts may be left out; its joints are known by their names in the model."""

    @cached_property
    def driven_joints(self) -> dict[str, int]:
        """Prescribed joint -> its index in the model."""
        return {name: int(self.model.joint(name).id) for name in self.drive}

    @cached_property
    def driven_dofs(self) -> NDArray[np.intp]:
        """Freedoms of the prescribed joints, in the order of `drive`."""
        return self.model.jnt_dofadr[[*self.driven_joints.values()]].astype(np.intp)


def lean_scene(full: UserScene, spec: mujoco.MjSpec, tracked: Mapping[str, tuple[str, Array]]) -> LeanScene:
    """Return a scene of which parts are left out, put through the motion of the full one.

    Args:
        full: the full scene.
        spec: of what is left of it; not changed.
        tracked: point -> name of its body, place in its frame in [m].

    Raises:
        ValueError: where MuJoCo refuses what is left, or a part that the motion needs is left out.
    """
    spec = spec.copy()
    plain = spec.compile()
    wheels: dict[str, tuple[float, float]] = {}
    for name in full.drive:
        joint = spec.joint(name)
        if joint is None:
            raise ValueError(f"joint {name} is prescribed and cannot be left out")
        wheels[name] = full.wheels[name][0], float(joint.armature)
        joint.armature = full.wheels[name][0]
    model = spec.compile() if wheels else plain
    known = {model.actuator(i).name for i in range(model.nu)}
    if missing := [name for name in full.ctrl if name not in known]:
        raise ValueError(f"actuator {missing[0]} is fed and cannot be left out")
    places = {name: (_body(model, body), place) for name, (body, place) in tracked.items()}
    return LeanScene(
        full.path,
        model,
        full.start,
        full.duration,
        full.closure,
        places,
        full.drive,
        full.ctrl,
        wheels,
    )


def started_as(scene: LeanScene, full: LeanScene) -> LeanScene:
    """Return a scene that starts as the full one does, joint by joint."""
    qpos, qvel = scene.model.qpos0.copy(), np.zeros(scene.model.nv)
    for j in range(scene.model.njnt):
        name = scene.model.joint(j).name
        own, its = scene.model.joint(name), full.model.joint(name)
        for values, start, places, there in (
            (qpos, full.start[0], own.qposadr, its.qposadr),
            (qvel, full.start[1], own.dofadr, its.dofadr),
        ):
            count = _width(scene.model, j, places is own.qposadr)
            values[int(places[0]) : int(places[0]) + count] = start[int(there[0]) : int(there[0]) + count]
    return replace(scene, start=(qpos, qvel))


def _width(model: mujoco.MjModel, joint: int, places: bool) -> int:
    """Return how many coordinates or freedoms a joint has."""
    kind = int(model.jnt_type[joint])
    if kind == int(mujoco.mjtJoint.mjJNT_FREE):
        return 7 if places else 6
    if kind == int(mujoco.mjtJoint.mjJNT_BALL):
        return 4 if places else 3
    return 1


def _body(model: mujoco.MjModel, name: str) -> int:
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if found < 0:
        raise ValueError(f"body {name} carries what is tracked and cannot be left out")
    return found
