"""Equality constraints of a MuJoCo model: their stiffness, rods and locked joints."""

from collections.abc import Mapping

import mujoco
import numpy as np

from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import Pose
from mechsim.simulation.mjcf.compiling import compiled

# time constant of the loops in steps
TIME_CONSTANT_STEPS = 20.0


# kind of equality -> kind of its objects
OBJECTS = {
    mujoco.mjtEq.mjEQ_CONNECT: mujoco.mjtObj.mjOBJ_SITE,
    mujoco.mjtEq.mjEQ_WELD: mujoco.mjtObj.mjOBJ_SITE,
    mujoco.mjtEq.mjEQ_JOINT: mujoco.mjtObj.mjOBJ_JOINT,
    mujoco.mjtEq.mjEQ_TENDON: mujoco.mjtObj.mjOBJ_TENDON,
}


def add_equality(spec: mujoco.MjSpec, name: str, kind: mujoco.mjtEq, *ends: str) -> mujoco.MjsEquality:
    """Add an equality; its stiffness was chosen by validation/choices/constraint_settings.py."""
    return spec.add_equality(
        name=name,
        type=kind,
        objtype=OBJECTS[kind],
        name1=ends[0],
        name2=ends[1] if len(ends) > 1 else "",
        solref=(TIME_CONSTANT_STEPS * spec.option.timestep, 1.0),
        solimp=(0.9999, 0.9999, 0.001, 0.5, 2.0),
    )


def add_rod(
    spec: mujoco.MjSpec, rod: Joint, bodies: Mapping[str, mujoco.MjsBody], frames: Mapping[str, Pose]
) -> None:
    """Keep the distance of the points of a rod by a tendon, whose length counts from the reference."""
    tendon, ends = spec.add_tendon(name=rod.name), (rod.a, rod.b)
    for end in ends:
        name = f"{rod.name}@{end.link}"
        bodies[end.link].add_site(name=name, pos=end.point)
        tendon.wrap_site(name)
    gap = np.subtract(*(frames[end.link].point(end.point) for end in ends))
    made = add_equality(spec, rod.name, mujoco.mjtEq.mjEQ_TENDON, rod.name)
    made.data[:5] = [rod.length - float(np.linalg.norm(gap)), 0.0, 0.0, 0.0, 0.0]


def lock_joint(spec: mujoco.MjSpec, joint: str, value: float) -> None:
    """Lock a hinge or slide at a value in [m] or [rad] relative to the reference configuration."""
    add_equality(spec, f"hold {joint}", mujoco.mjtEq.mjEQ_JOINT, joint).data[:5] = [value, 0.0, 0.0, 0.0, 0.0]


def lock_joints(spec: mujoco.MjSpec, locks: Mapping[str, float]) -> None:
    """Lock hinges and slides at values in [m] or [rad]."""
    model = compiled(spec)
    for name, value in locks.items():
        lock_joint(spec, name, value - float(model.qpos0[model.joint(name).qposadr[0]]))
