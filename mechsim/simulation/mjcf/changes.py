"""Changes to a specification before it is run: joints held, a flywheel."""

from collections.abc import Iterable, Mapping

import mujoco

from mechsim.errors import InputError
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf.generator import lock_joint
from mechsim.simulation.mjcf.joints import CRANK

SINGLE_AXIS = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


def lock_joints(spec: mujoco.MjSpec, locks: Mapping[str, float]) -> None:
    """Hold hinges and slides at values in [m] or [rad].

    Raises:
        InputError: for a joint that the model has not, or one of another kind.
    """
    require_single(spec, locks)
    model = compiled(spec)
    for name, value in locks.items():
        lock_joint(spec, name, value - float(model.qpos0[model.joint(name).qposadr[0]]))


def require_single(spec: mujoco.MjSpec, joint_names: Iterable[str]) -> None:
    """Refuse names of what is no hinge or slide of a model.

    Raises:
        InputError: naming those there are.
    """
    single = [joint.name for joint in spec.joints if joint.name and joint.type in SINGLE_AXIS]
    for name in joint_names:
        if name not in single:
            available = ", ".join(single) or "none"
            raise InputError(f"the model has no hinge or slide called {name!r} to hold (it has {available})")


def set_drive_inertia(spec: mujoco.MjSpec, inertia: float) -> None:
    """Put an inertia in [kg m2] on the crank of a model that the generator made.

    Raises:
        InputError: where nothing is called crank.
    """
    crank = next((joint for joint in spec.joints if joint.name == CRANK), None)
    if crank is None:
        raise InputError(
            "a drive inertia is on a crank, and no joint of the model is called crank; leave it out"
        )
    crank.armature = inertia
