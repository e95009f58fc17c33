"""A reduced scene, which lacks elements of the full one, over the same motion."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.scenes.user_scene import UserScene, as_exact


@dataclass(frozen=True)
class ReducedScene(UserScene):
    """A scene from which elements may be removed; its joints are found by their names in the model."""

    @cached_property
    def driven_joints(self) -> dict[str, int]:
        """Prescribed joint -> its index in the model."""
        return {name: int(self.model.joint(name).id) for name in self.drive}

    @cached_property
    def driven_dofs(self) -> NDArray[np.intp]:
        """Degrees of freedom of the prescribed joints, in the order of `drive`."""
        return self.model.jnt_dofadr[[*self.driven_joints.values()]].astype(np.intp)


def reduced_scene(
    full: UserScene, spec: mujoco.MjSpec, tracked: Mapping[str, tuple[str, Array]], like: mujoco.MjModel
) -> ReducedScene:
    """Return a reduced scene over the motion of the full one.

    Args:
        full: the full scene; the remaining joints start as its joints do.
        spec: of the reduced scene; not changed.
        tracked: point -> name of its body, position in its frame in [m].
        like: the full scene's model, its elements named as in `spec`.

    Raises:
        ValueError: if MuJoCo rejects the reduced scene, or it lacks an element that the motion needs.
    """
    spec = spec.copy()
    plain = plainly_compiled(spec)
    inertias: dict[str, tuple[float, float]] = {}
    for name in full.drive:
        joint = spec.joint(name)
        if joint is None:
            raise ValueError(f"joint {name} is prescribed and cannot be removed")
        inertias[name] = full.wheels[name][0], float(joint.armature)
        joint.armature = full.wheels[name][0]
    model = as_exact(plain, plainly_compiled(spec), spec) if inertias else plain
    actuators = {model.actuator(i).name for i in range(model.nu)}
    if missing := [name for name in full.ctrl if name not in actuators]:
        raise ValueError(f"actuator {missing[0]} has a motion law and cannot be removed")
    positions = {name: (_body(model, body), position) for name, (body, position) in tracked.items()}
    start = initial_state(model, like, full.start)
    if full.key is not None:
        add_start(spec, full, like, start, full.key)
        model = plainly_compiled(spec)
    return ReducedScene(
        full.path,
        model,
        start,
        full.duration,
        full.closure,
        positions,
        full.drive,
        full.ctrl,
        inertias,
        full.key,
    )


def initial_state(
    model: mujoco.MjModel, like: mujoco.MjModel, start: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return position and velocity of a model whose joints start as those of the same names in another."""
    qpos, qvel = model.qpos0.copy(), np.zeros(model.nv)
    for j in range(model.njnt):
        own, its = model.joint(j), like.joint(model.joint(j).name)
        address, source = own.qposadr[0], its.qposadr[0]
        width, dofs = _WIDTHS.get(int(model.jnt_type[j]), (1, 1))
        qpos[address : address + width] = start[0][source : source + width]
        address, source = own.dofadr[0], its.dofadr[0]
        qvel[address : address + dofs] = start[1][source : source + dofs]
    return qpos, qvel


def add_start(
    spec: mujoco.MjSpec, full: UserScene, like: mujoco.MjModel, start: tuple[Array, Array], name: str
) -> None:
    """Add the initial keyframe of a scene, with the controls of the full scene's keyframe."""
    data = mujoco.MjData(full.model)
    if full.key is not None:
        mujoco.mj_resetDataKeyframe(full.model, data, full.model.key(full.key).id)
    controls = [data.ctrl[like.actuator(actuator.name).id] for actuator in spec.actuators]
    act = {"act": data.act} if len(spec.actuators) == full.model.nu and full.model.na else {}
    spec.add_key(name=name, qpos=start[0], qvel=start[1], ctrl=controls, **act)


_WIDTHS = {int(mujoco.mjtJoint.mjJNT_FREE): (7, 6), int(mujoco.mjtJoint.mjJNT_BALL): (4, 3)}


def _body(model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        raise ValueError(f"body {name} carries a tracked point and cannot be removed")
    return index
