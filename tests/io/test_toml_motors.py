"""Motors of a TOML file, on joints and between points, against an integration by scipy."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import copied, load_model
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.studies.dynamics_check import crosscheck_forward

# moment of inertia about the hip in [kg m2], and moment of the weight at q = 0 in [N m]
INERTIA, WEIGHT = 1e-2 + 1.0 * 0.2**2, 9.81 * 0.2
DC = 'kind = "dc"\nresistance = "0.8 ohm"\nconstant = "0.05 N m/A"\ngear = 20\nrotor = "1e-5 kg m2"\n'
ROTOR = 20**2 * 1e-5


# a cylinder between two points, besides a motor without torque
CYLINDER = """kind = "constant"
torque = 0
[forces.motors.cylinder]
a = { link = "ground", at = ["0.1 m", "-0.2 m", 0] }
b = { link = "arm", at = ["0.15 m", 0, 0] }
"""


def volts(t):
    return 12.0 * np.sin(6.0 * t)


def length(q):
    """Return the length of the cylinder, and its derivative by the angle."""
    gap = 0.15 * np.array([np.cos(q), np.sin(q)]) - [0.1, -0.2]
    distance = np.linalg.norm(gap)
    return distance, 0.15 * (gap @ [-np.sin(q), np.cos(q)]) / distance


def cylinder(effort):
    """Return the moment at the hip of a force by length, rate and state."""

    def moment(t, q, v, w):
        distance, arm = length(q)
        return arm * effort(distance, arm * v, w)

    return moment


# motor in TOML; torque (t, q, v, w); rate of the state w, if it has one, and added inertia
CASES = {
    "constant": ('kind = "constant"\ntorque = "1 N m"', lambda t, q, v, w: 1.0),
    "line": (
        'kind = "line"\nstall = "1.5 N m"\nno_load = "60 rpm"',
        lambda t, q, v, w: 1.5 * (1.0 - v / (2.0 * np.pi)),
    ),
    "dc": (
        DC + 'voltage = "12 V*sin(6*t)"',
        lambda t, q, v, w: 20.0 * 0.05 * (volts(t) - 0.05 * 20.0 * v) / 0.8,
        None,
        ROTOR,
    ),
    "dc with inductance": (
        DC + 'voltage = "12*sin(6*t)"\ninductance = "20 mH"',
        lambda t, q, v, w: 20.0 * 0.05 * w,
        lambda t, q, v, w: (volts(t) - 0.8 * w - 0.05 * 20.0 * v) / 0.02,
        ROTOR,
    ),
    "pd": (
        'kind = "pd"\ntarget = "30 deg*sin(3*t)"\nproportional = 20\nderivative = 1',
        lambda t, q, v, w: 20.0 * (np.pi / 6 * np.sin(3 * t) - q) + np.pi / 2 * np.cos(3 * t) - v,
    ),
    # at its limit until the error has become small
    "saturated pd": (
        'kind = "pd"\ntarget = "100 rad"\nproportional = 20\nlimit = "3 N m"',
        lambda t, q, v, w: 3.0,
    ),
    "pid": (
        'kind = "pid"\ntarget = "0.5 rad"\nproportional = 20\nintegral = 30\nderivative = 1',
        lambda t, q, v, w: 20.0 * (0.5 - q) - v + 30.0 * w,
        lambda t, q, v, w: 0.5 - q,
    ),
    "constant between points": (
        CYLINDER + 'kind = "constant"\ntorque = "20 N"',
        cylinder(lambda distance, rate, w: 20.0),
    ),
    "pid between points": (
        CYLINDER + 'kind = "pid"\ntarget = "0.25 m"\nproportional = 900\nintegral = 700\nderivative = 20',
        cylinder(lambda distance, rate, w: 900.0 * (0.25 - distance) - 20.0 * rate + 700.0 * w),
        lambda t, q, v, w: 0.25 - length(q)[0],
    ),
    "general between points": (
        CYLINDER + 'kind = "general"\ngear = 3\nbias = [4.0, -50.0, -2.0]',
        cylinder(lambda distance, rate, w: 3.0 * (4.0 - 50.0 * 3.0 * distance - 2.0 * 3.0 * rate)),
    ),
    "expression": ('kind = "expression"\ntorque = "2 - 3*hip.q"', lambda t, q, v, w: 2.0 - 3.0 * q),
}


def model_of(motor):
    return ms.dynamics.dynamic_model(load_model("toml_motors_arm.toml", motor=motor, still=True))


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_a_motor_against_scipy(case):
    motor, torque, state_rate, added = (*CASES[case], *(None, 0.0)[len(CASES[case]) - 2 :])
    model = model_of(motor)
    run = ms.dynamics.run(model, duration=0.5, samples=10)

    def equation(t, y):
        q, v, w = y
        acceleration = (torque(t, q, v, w) - WEIGHT * np.cos(q)) / (INERTIA + added)
        return v, acceleration, 0.0 if state_rate is None else state_rate(t, q, v, w)

    exact = solve_ivp(equation, (0.0, 0.5), [0.0, 0.0, 0.0], "DOP853", run.time, rtol=1e-13, atol=1e-14)
    assert np.abs(run.motion.joints["hip"].value - exact.y[0]).max() < 1e-10
    assert run.energy_error < 1e-10
    verdict = crosscheck_forward(run, model, initial_values(model, {}))
    assert verdict.passed, str(verdict)


@pytest.mark.parametrize("case", ["pid", "pid between points", "general between points"])
def test_a_motor_is_written_and_read_back(case):
    model = model_of(CASES[case][0])
    again = ms.load(copied(to_toml(model.solver)), still=True)
    for own, read in zip(model.forces.actuators, again.forces.actuators, strict=True):
        assert replace(read, control=own.control) == own


@pytest.mark.parametrize("case", ["dc with inductance", "pid"])
def test_the_holding_torque_of_a_motor(case):
    model = model_of(CASES[case][0])
    holding = ms.dynamics.holding(model, initial={"hip.q": 0.0})["hip"]
    # at rest the motor has its steady current of zero volts, and the integral of the servo is its start
    assert holding == pytest.approx(WEIGHT - (0.0 if case != "pid" else 10.0), abs=1e-12)
