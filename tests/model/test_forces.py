from functools import partial

import numpy as np
import pytest

from mechsim import catalog, load_profile, motors
from mechsim.errors import InputError
from mechsim.model.forces import Forces, Friction, JointSpring, Load, Spring

RSSR = catalog.make("rssr").mechanism
PUSH = load_profile.constant((0.0, 0.0, 1.0))
POINT = (0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("make", "output"),
    [
        (partial(Friction, "crank", -1.0), "viscous friction in joint 'crank' is -1.0"),
        (partial(Friction, "crank", 0.0, np.nan), "Coulomb friction"),
        (partial(Spring, "P2", "P3", -1.0), "stiffness of the spring"),
        (partial(Spring, "P2", "P2", 1.0), "joins P2 to itself"),
        (partial(JointSpring, "crank", 1.0, np.inf), "rest of the spring"),
        (partial(Forces, flywheel=-1e-3), "moment of inertia of the flywheel"),
        (partial(Forces, gravity=(0.0, np.nan, 0.0)), "gravity is"),
        (partial(Forces, crank_torque=PUSH), "three components"),
        (partial(Load, "P3", load_profile.constant(1.0)), "has one component"),
        (partial(motors.DCMotor, 12.0, 0.0, 0.01), "motor resistance is 0.0 ohm"),
        (partial(motors.DCMotor, np.nan, 1.0, 0.01), "motor voltage"),
        (partial(motors.TorqueSpeedLine, 1.0, -100.0), "drives nothing"),
    ],
)
def test_invalid_parameters_of_forces_are_rejected(make, output):
    with pytest.raises(InputError, match=output):
        make()


@pytest.mark.parametrize(
    ("forces", "output"),
    [
        (Forces(friction=(Friction("elbow", 1.0),)), "'elbow', but there are only crank, P2, P3, rocker"),
        (Forces(friction=(Friction("P2", 0.0, 1.0, 0.0, 1.0),)), "given in spherical joint 'P2'; only a cyl"),
        (Forces(joint_springs=(JointSpring("P3", 1.0),)), "a spring in spherical joint 'P3'"),
        (Forces(loads=(Load("P9", PUSH),)), "no point 'P9' .*P2, P3"),
        (Forces(loads=(Load(("arm", POINT), PUSH),)), "no link 'arm', only ground, crank"),
        (Forces(loads=(Load(("ground", POINT), PUSH),)), "acts on the frame"),
        (Forces(springs=(Spring("P2", ("crank", POINT), 1.0),)), "both ends of a spring are on link 'crank'"),
    ],
)
def test_forces_on_unknown_or_unsuitable_elements_are_rejected(forces, output):
    with pytest.raises(InputError, match=output):
        forces.check(RSSR)


def test_motors_have_their_stall_torque_and_no_load_speed():
    line, dc = motors.TorqueSpeedLine(2.0, 50.0), motors.DCMotor(12.0, 2.0, 0.1)
    assert line.torque([0.0, 25.0, 50.0, 100.0]) == pytest.approx([2.0, 1.0, 0.0, -2.0])
    assert dc.torque([0.0, 120.0]) == pytest.approx([0.6, 0.0], abs=1e-15)
    for motor in (line, dc, motors.ConstantTorque(3.0)):
        assert motor.torque(1.0) - motor.torque(0.0) == pytest.approx(motor.derivative)
