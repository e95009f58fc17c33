"""Backlash of couplings and joints, against closed forms; what cannot have it is rejected."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.io import gallery
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.gaps import with_gaps
from mechsim.studies.dynamics_check import crosscheck_forward

MOTOR, WHEEL, RATIO, PLAY = 0.02, 0.05, -0.5, np.deg2rad(2.0)
PAIR = model_text("backlash_pair.toml")
KNEE = model_text("backlash_knee.toml")


def written(folder, text):
    (folder / "model.toml").write_text(text)
    return str(folder / "model.toml")


def test_flanks_collide_at_the_instants_of_geometric_series(tmp_path):
    e, speed = 0.5, 1.0
    path, initial = written(tmp_path, PAIR), {"crank.v": 2.0, "output.v": 0.0}
    run = ms.dynamics.run(path, initial=initial, duration=0.5, samples=50, restitution=e)
    # half the play, then the whole of it, at rates that fall by e: wheel - ratio * motor moves at 1 rad/s
    times = PLAY / 2 / speed + PLAY / speed * np.concatenate([[0.0], np.cumsum(e ** -np.arange(1.0, 4.0))])
    assert run.events == pytest.approx(times[times < 0.5], rel=1e-12)
    # momentum of the pair, and energy of the relative motion
    reduced = 1.0 / (1.0 / WHEEL + RATIO**2 / MOTOR)
    count = len(run.events)
    assert run.lost[-1] == pytest.approx(0.5 * reduced * speed**2 * (1.0 - e ** (2 * count)), rel=1e-12)
    wheel, motor = (run.motion.joints[name].rate for name in ("output", "crank"))
    # the impulse on the motor is -ratio times that on the wheel
    assert RATIO * WHEEL * wheel + MOTOR * motor == pytest.approx(np.full(len(run), MOTOR * 2.0), rel=1e-12)


def test_a_flank_carries_under_torque_and_mujoco_agrees_in_both_phases(tmp_path):
    torque = 0.3
    model = dynamic_model(ms.load(written(tmp_path, PAIR + f"crank_torque = {torque}\n"), still=True))
    model = replace(model, mechanism=with_gaps(model.mechanism))
    run = ms.dynamics.run(model, duration=0.4, samples=40)
    first = np.sqrt(PLAY / -RATIO / (torque / MOTOR))
    assert run.events == pytest.approx([first], rel=1e-9)
    together = MOTOR + RATIO**2 * WHEEL
    rate = torque / MOTOR * first * MOTOR / together
    t = 0.4 - first
    angle = torque / MOTOR * first**2 / 2 + rate * t + torque / together * t**2 / 2
    motor, wheel = (run.motion.joints[name].value[-1] for name in ("crank", "output"))
    assert motor == pytest.approx(angle, rel=1e-9)
    assert wheel - RATIO * motor == pytest.approx(PLAY / 2, rel=1e-12)
    values = initial_values(model, {})
    verdict = crosscheck_forward(run, model, values)
    assert verdict.passed, verdict
    assert len({check.variant for check in verdict.checks}) == 2
    weaker = model.with_forces(replace(model.forces, flywheel=0.001))
    assert not crosscheck_forward(run, weaker, values).passed


@pytest.mark.parametrize(
    ("text", "laws", "torque"),
    [
        (PAIR, {"crank": "0.3*sin(2*pi*t)"}, WHEEL * RATIO * 0.3),
        (KNEE, {}, (0.05 + 1 * 0.1**2) * 0.3),
    ],
)
def test_the_flank_changes_where_the_force_does(tmp_path, text, laws, torque, mechsim):
    import json

    driven = [argument for name, law in laws.items() for argument in ("--drive", f"{name}={law}")]
    arguments = ["dynamics", "inverse", written(tmp_path, text), *driven, "--json"]
    answer = mechsim(*arguments, *(["--duration", "1s"] if laws else []))
    assert answer.code == 0
    (force,) = json.loads(answer.out)["contacts"].values()
    assert force["changes"] == pytest.approx([0.5], abs=1e-12)
    assert force["backlash"] == pytest.approx(PLAY)
    assert force["largest"] == pytest.approx(abs(torque) * (2 * np.pi) ** 2, rel=1e-4)


def test_flanks_that_meet_after_half_a_turn_of_a_planet_carry_in_mujoco_too(tmp_path):
    text = gallery.files()["planetary_gear"].read_text().split("[formula]")[0]
    ratio = 'ratio = "-teeth_planet/teeth_sun"'
    model = dynamic_model(
        ms.load(written(tmp_path, text.replace(ratio, f'{ratio}\nbacklash = "0.5 deg"')), still=True)
    )
    initial = {"carrier.q": -1.7, "carrier.v": -6.0}
    run = ms.dynamics.run(model, initial=initial, duration=0.2, samples=40)
    # a flank presses from the first impact on, after the planet has passed 180 degrees
    assert abs(run.motion.joints["planet"].value).max() > np.pi
    verdict = crosscheck_forward(run, model, initial_values(model, initial))
    assert verdict.passed, verdict


def test_the_motor_of_a_joint_crosses_its_backlash(tmp_path):
    run = ms.dynamics.run(written(tmp_path, KNEE), duration=0.3, samples=10, restitution=0.3)
    assert run.events[0] == pytest.approx(np.sqrt(PLAY / (0.1 / 0.02)), rel=1e-9)
    assert run.energy_error <= 1e-12


def test_backlash_is_written_again(tmp_path):
    source = ms.load(written(tmp_path, PAIR), still=True)
    assert "backlash = 0.0349" in to_toml(source.mechanism)
