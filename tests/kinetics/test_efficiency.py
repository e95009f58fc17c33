"""Efficiency of couplings against the closed forms of a geared hoist; MuJoCo against both."""

import numpy as np
import pytest
from model_files import changed_model, load_model
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.kinetics.initial_state import InitialValues
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_forward

PINION, WHEEL, RATIO, LOAD = 2e-4, 3e-2, -0.2, 5.0


def hoist(efficiency):
    return load_model("efficiency_hoist.toml", efficiency=efficiency)


def test_a_gear_that_carries_nothing_loses_nothing_by_mujoco_too():
    # a rotor that is balanced on its eccentric, at constant rates and without weight
    balanced = "[links.rotor]\ninertia = { mass = 1, centre = [0, 0, 0], moments = [1e-3, 1e-3, 2e-3] }"
    changes = ('ratio = "-2/3"', 'ratio = "-2/3"\nefficiency = 0.8'), ("[links.rotor]", balanced)
    source = load_model("wankel", *changes, more="[forces]\ngravity = [0, 0, 0]")
    run = driven(source.mechanism, source.forces, speed=5.0, samples=12)
    verdict = crosscheck_driven(run, ms.dynamics.dynamic_model(source))
    assert verdict.passed, verdict
    assert run.forces.power_lost.max() < 1e-12 * run.forces.kinetic.max()


def test_a_motor_that_balances_the_load_makes_no_hoist_self_locking(mechsim):
    """The range of holding torques is 1 N m (2 - 1/0.8) to 1 N m/0.8, less the 1 N m of the motor."""
    path = changed_model("efficiency_hoist.toml", efficiency=0.8)
    command = ["dynamics", "statics", path, "--initial", "pinion.q=0.3", "--motor", "constant:1"]
    out = " ".join(mechsim(*command, "--method", "none").out.split())
    assert "initial configuration, besides the motors and controllers at rest" in out
    assert "so do -0.25 to 0.25 N m masses" in out
    loose = changed_model("efficiency_hoist.toml", ('drivers = ["pinion"]', "drivers = []"), efficiency=0.8)
    assert "no driver can hold" in mechsim(*command[:2], loose, *command[3:5], "--method", "none").out


def with_elastic_teeth(efficiency, rate, times):
    """Return the rates of the pinion and the wheel with a spring and a damper between the teeth."""
    loss, stiffness, damping = 1.0 / efficiency - 1.0, 1e7, 2e3

    def rates(_, state):
        pinion, wheel, angle, other = state
        force = stiffness * (RATIO * angle - other) + damping * (RATIO * pinion - wheel)
        on_pinion = -RATIO * force - loss * abs(RATIO * force) * np.tanh(pinion / 1e-3)
        return on_pinion / PINION, (LOAD + force) / WHEEL, pinion, wheel

    start, span = (rate, RATIO * rate, 0.0, 0.0), (0.0, times[-1])
    return solve_ivp(rates, span, start, "Radau", times, rtol=1e-8, atol=1e-10).y[:2]


@pytest.mark.parametrize("efficiency", [0.45, 0.3])
def test_a_self_locking_hoist_in_motion_is_driven_or_jams_as_with_elastic_teeth(efficiency):
    source = hoist(efficiency)
    model, start = ms.dynamics.dynamic_model(source), {"pinion.v": 20.0}
    run = ms.dynamics.run(model, initial=start, duration=0.02, samples=21)
    pinion = run.motion.joints["pinion"].rate
    # a pinion that drives the load comes to rest and holds it
    assert pinion == pytest.approx(with_elastic_teeth(efficiency, 20.0, run.time)[0], abs=2e-3)
    short = ms.dynamics.run(model, initial=start, duration=1e-3, samples=11)
    assert crosscheck_forward(short, model, InitialValues({}, {"pinion": 20.0})).passed
    assert ms.dynamics.run(model, initial=start, duration=0.03).outcome == "stopped"
    # one that the load drives jams at once: the teeth stop both within the time that they yield
    assert np.abs(with_elastic_teeth(efficiency, -20.0, np.array([0.0, 3e-3]))[:, -1]).max() < 1e-2
    jammed = ms.dynamics.run(model, initial={"pinion.v": -20.0}, duration=0.02)
    assert (jammed.outcome, jammed.time[-1]) == ("jammed", 0.0)
