"""Efficiency of couplings against the closed forms of a geared hoist; MuJoCo against both."""

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.io import gallery
from mechsim.kinetics import dynamic_model, prescribed
from mechsim.kinetics.initial_state import InitialValues
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_forward

PINION, WHEEL, RATIO, LOAD = 2e-4, 3e-2, -0.2, 5.0


def hoist(folder, efficiency):
    (folder / "hoist.toml").write_text(model_text("efficiency_hoist.toml", efficiency=efficiency))
    return ms.load(folder / "hoist.toml")


def driver_share(efficiency, forward):
    """Return the torque on the pinion per torque with which it drives the wheel without losses."""
    return 1.0 / efficiency if forward else 2.0 - 1.0 / efficiency


@pytest.mark.parametrize("speed", [3.0, -3.0])
def test_the_power_of_a_prescribed_motion_flows_with_losses(tmp_path, speed):
    """A pinion that turns forward drives the wheel backward, against its load of 5 N m."""
    source = hoist(tmp_path, 0.8)
    model = ms.dynamics.dynamic_model(source)
    angle = np.linspace(0.0, speed, 5)
    study = ms.dynamics.prescribed(model, angle, speed=speed, acceleration=7.0)
    # the force on the wheel moves its inertia and resists its load
    force = WHEEL * RATIO * 7.0 - LOAD
    forward = force * RATIO * speed > 0.0
    expected = PINION * 7.0 + RATIO * force * driver_share(0.8, forward)
    np.testing.assert_allclose(study.forces.torque, expected, rtol=1e-12)
    (coupled,) = study.forces.gears.values()
    np.testing.assert_allclose(coupled, force, rtol=1e-12)
    assert study.forces.power_lost.min() > 0.0


def test_drive_torques_agree_with_mujoco(tmp_path):
    source = hoist(tmp_path, 0.8)
    run = driven(source.mechanism, source.forces, speed=5.0, turns=1)
    verdict = crosscheck_driven(run, ms.dynamics.dynamic_model(source))
    assert verdict.passed, verdict
    ideal = ms.dynamics.dynamic_model(hoist(tmp_path, 1.0))
    assert not crosscheck_driven(run, ideal).passed


def test_a_gear_that_carries_nothing_loses_nothing_by_mujoco_too(tmp_path):
    text = gallery.machines()["wankel"].read_text()
    text = text.replace('ratio = "-2/3"', 'ratio = "-2/3"\nefficiency = 0.8')
    # a rotor that is balanced on its eccentric, at constant rates and without weight
    balanced = "[links.rotor]\ninertia = { mass = 1, centre = [0, 0, 0], moments = [1e-3, 1e-3, 2e-3] }"
    text = text.replace("[links.rotor]", balanced)
    (tmp_path / "wankel.toml").write_text(f"{text}[forces]\ngravity = [0, 0, 0]\n")
    source = ms.load(str(tmp_path / "wankel.toml"))
    run = driven(source.mechanism, source.forces, speed=5.0, samples=12)
    verdict = crosscheck_driven(run, ms.dynamics.dynamic_model(source))
    assert verdict.passed, verdict
    assert run.forces.power_lost.max() < 1e-12 * run.forces.kinetic.max()


@pytest.mark.long
@pytest.mark.parametrize("rate", [40.0, -40.0])
def test_a_released_hoist_accelerates_as_by_its_closed_form(tmp_path, rate):
    run = ms.dynamics.run(hoist(tmp_path, 0.8), initial={"pinion.v": rate}, duration=0.02)
    # the load turns the wheel forward, and the pinion backward
    share = driver_share(0.8, forward=rate > 0.0)
    acceleration = RATIO * LOAD * share / (PINION + RATIO**2 * WHEEL * share)
    time = run.time
    np.testing.assert_allclose(
        run.motion.joints["pinion"].rate, rate + acceleration * time, rtol=0, atol=1e-9 * abs(rate)
    )
    assert run.energy_error < 1e-10


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
def test_a_self_locking_hoist_in_motion_is_driven_or_jams_as_with_elastic_teeth(tmp_path, efficiency):
    source = hoist(tmp_path, efficiency)
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


@pytest.mark.parametrize("efficiency", [0.8, 0.5, 0.4])
def test_a_hoist_has_a_range_of_holding_torques_and_locks_itself(tmp_path, efficiency):
    low, high = ms.dynamics.holding_range(hoist(tmp_path, efficiency), initial={"pinion.q": 0.3})["pinion"]
    ideal = -RATIO * LOAD
    np.testing.assert_allclose(high, ideal / efficiency, rtol=1e-12)
    np.testing.assert_allclose(low, ideal * (2.0 - 1.0 / efficiency), rtol=1e-12, atol=1e-12)
    assert (low <= 1e-12) == (efficiency <= 0.5)


@pytest.mark.long
def test_a_self_locking_hoist_stays_at_rest(tmp_path):
    run = ms.dynamics.run(hoist(tmp_path, 0.45), initial={"pinion.v": 0.0}, duration=0.1)
    assert run.outcome == "stopped"
    assert np.abs(run.motion.joints["pinion"].value).max() == 0.0
    moving = ms.dynamics.run(hoist(tmp_path, 0.55), initial={"pinion.v": 0.0}, duration=0.1)
    assert moving.motion.joints["pinion"].value[-1] < -0.1


@pytest.mark.long
def test_a_released_hoist_agrees_with_mujoco(tmp_path):
    source, start = hoist(tmp_path, 0.8), {"pinion.v": 40.0}
    run = ms.dynamics.run(source, initial=start, duration=0.02)
    initial = InitialValues({"pinion": 0.0}, {"pinion": 40.0})
    model = ms.dynamics.dynamic_model(source)
    assert crosscheck_forward(run, model, initial).passed
    other = ms.dynamics.dynamic_model(hoist(tmp_path, 0.9))
    assert not crosscheck_forward(run, other, initial).passed


def test_an_efficiency_is_written_and_read_back(tmp_path):
    source = hoist(tmp_path, 0.8)
    ms.export(source, tmp_path / "written.toml", format="toml")
    (again,) = ms.load(tmp_path / "written.toml", still=True).forces.friction
    assert again.coupling == "pinion-wheel"
    assert again.coefficient == pytest.approx(0.05, rel=1e-14)


def test_an_efficiency_acts_in_a_file_without_other_forces(tmp_path):
    # it was read only where the file has forces, friction or teeth
    text = model_text("efficiency_hoist.toml", efficiency=0.8)
    (tmp_path / "hoist.toml").write_text(text[: text.index("[forces]")])
    model = ms.load(str(tmp_path / "hoist.toml"), drive={"pinion": "t**2"})
    torque = prescribed(dynamic_model(model), t=np.array([1.0])).forces.drives["pinion"]
    assert torque[0] == pytest.approx(2.0 * (PINION + RATIO**2 * WHEEL / 0.8), rel=1e-12)
