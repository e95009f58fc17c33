import pytest

from mechsim import motors


def test_motors_have_their_stall_torque_and_no_load_speed():
    line, dc = motors.TorqueSpeedLine(2.0, 50.0), motors.DCMotor(12.0, 2.0, 0.1)
    assert line.torque([0.0, 25.0, 50.0, 100.0]) == pytest.approx([2.0, 1.0, 0.0, -2.0])
    assert dc.torque([0.0, 120.0]) == pytest.approx([0.6, 0.0], abs=1e-15)
    for motor in (line, dc, motors.ConstantTorque(3.0)):
        assert motor.torque(1.0) - motor.torque(0.0) == pytest.approx(motor.derivative)
