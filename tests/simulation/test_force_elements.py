"""Actuators of a loaded model and the index of their kinds."""

import numpy as np
import pytest

from mechsim import catalog, load_profile
from mechsim.mechanism.forces import Couple, Forces, Friction, JointSpring, Load
from mechsim.mechanism.motors import ConstantTorque
from mechsim.simulation.dynamics.loaded_model import loaded_model

PUSH = load_profile.constant((1.0, 2.0, 3.0))
STARTS = {
    "motor": ("motor",),
    "crank_torque": ("crank torque",),
    "loads": ("load ",),
    "couples": ("couple ",),
    "springs": ("spring in ",),
    "friction": ("friction in ",),
}


def every_force(name: str) -> Forces:
    """Return forces of every kind with an actuator, and friction and springs in every joint."""
    mechanism = catalog.make(name).mechanism
    single_dof = [joint.name for joint in mechanism.joints if joint.kind in ("revolute", "prismatic")]
    return Forces(
        motor=ConstantTorque(1.0),
        crank_torque=load_profile.constant(0.1),
        loads=tuple(Load(point, PUSH) for point in mechanism.points),
        couples=(Couple(mechanism.links[-1].name, PUSH),),
        joint_springs=tuple(JointSpring(joint, 0.3, 0.1) for joint in single_dof),
        friction=tuple(Friction(joint.name, 1e-4, 1e-3) for joint in mechanism.joints),
    )


@pytest.mark.parametrize("name", ["slider_crank", "bennett", "rrsrr", "warp_knitter"])
def test_the_actuator_index_matches_the_actuators_of_the_model(name):
    forces = every_force(name)
    loaded = loaded_model(catalog.make(name).mechanism, forces)
    names = np.array([loaded.model.actuator(i).name for i in range(loaded.model.nu)])
    for kind, starts in STARTS.items():
        result = names[getattr(loaded.actuators, kind)]
        assert all(item.startswith(starts) for item in result)
        assert len(result) == sum(item.startswith(starts) for item in names)
    controls = loaded.controls(np.zeros(2), np.zeros(2))
    assert controls[0, loaded.actuators.loads].tolist() == [1.0, 2.0, 3.0] * len(forces.loads)
    assert controls[1, loaded.actuators.crank_torque].tolist() == [0.1]


def test_a_model_without_forces_has_no_actuators():
    loaded = loaded_model(catalog.make("four_bar").mechanism, Forces())
    assert loaded.controls(np.zeros(3), None).shape == (3, 0)
    assert loaded.actuators.friction == loaded.actuators.loads == slice(0, 0)
