"""A scene that may lack parts of the full one, put through the same motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.scenes.user_scene import UserScene, as_exact


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


def lean_scene(
    full: UserScene, spec: mujoco.MjSpec, tracked: Mapping[str, tuple[str, Array]], like: mujoco.MjModel
) -> LeanScene:
    """Return a scene of which parts are left out, put through the motion of the full one.

    Args:
        full: the full scene; what is left of it starts as it does, joint by joint.
        spec: of what is left; not changed.
        tracked: point -> name of its body, place in its frame in [m].
        like: the full scene's model, its parts named as in `spec`.

    Raises:
        ValueError: where MuJoCo refuses what is left, or a part that the motion needs is left out.
    """
    spec = spec.copy()
    plain = plainly_compiled(spec)
    wheels: dict[str, tuple[float, float]] = {}
    for name in full.drive:
        joint = spec.joint(name)
        if joint is None:
            raise ValueError(f"joint {name} is prescribed and cannot be left out")
        wheels[name] = full.wheels[name][0], float(joint.armature)
        joint.armature = full.wheels[name][0]
    model = as_exact(plain, plainly_compiled(spec), spec) if wheels else plain
    known = {model.actuator(i).name for i in range(model.nu)}
    if missing := [name for name in full.ctrl if name not in known]:
        raise ValueError(f"actuator {missing[0]} is fed and cannot be left out")
    places = {name: (_body(model, body), place) for name, (body, place) in tracked.items()}
    start = started(model, like, full.start)
    if full.key is not None:
        add_start(spec, full, like, start, full.key)
        model = plainly_compiled(spec)
    return LeanScene(
        full.path,
        model,
        start,
        full.duration,
        full.closure,
        places,
        full.drive,
        full.ctrl,
        wheels,
        full.key,
    )


def started(model: mujoco.MjModel, like: mujoco.MjModel, start: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the state and rates of a model whose joints start as those of the same names of another."""
    qpos, qvel = model.qpos0.copy(), np.zeros(model.nv)
    for j in range(model.njnt):
        own, its = model.joint(j), like.joint(model.joint(j).name)
        here, there = own.qposadr[0], its.qposadr[0]
        places, freedoms = _WIDTHS.get(int(model.jnt_type[j]), (1, 1))
        qpos[here : here + places] = start[0][there : there + places]
        here, there = own.dofadr[0], its.dofadr[0]
        qvel[here : here + freedoms] = start[1][there : there + freedoms]
    return qpos, qvel


def add_start(
    spec: mujoco.MjSpec, full: UserScene, like: mujoco.MjModel, start: tuple[Array, Array], name: str
) -> None:
    """Add the keyframe from which a scene starts, with the controls of the full one's."""
    data = mujoco.MjData(full.model)
    if full.key is not None:
        mujoco.mj_resetDataKeyframe(full.model, data, full.model.key(full.key).id)
    controls = [data.ctrl[like.actuator(actuator.name).id] for actuator in spec.actuators]
    act = {"act": data.act} if len(spec.actuators) == full.model.nu and full.model.na else {}
    spec.add_key(name=name, qpos=start[0], qvel=start[1], ctrl=controls, **act)


_WIDTHS = {int(mujoco.mjtJoint.mjJNT_FREE): (7, 6), int(mujoco.mjtJoint.mjJNT_BALL): (4, 3)}


def _body(model: mujoco.MjModel, name: str) -> int:
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if found < 0:
        raise ValueError(f"body {name} carries what is tracked and cannot be left out")
    return found
