"""Ropes over pulleys against the equation of motion of a hoist."""

import numpy as np
from model_files import model_text

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.contact_forces import contact_forces
from mechsim.studies.motions import profile_of
from mechsim.studies.robots.serial_twin import serial_twin


def hoist(folder, swing=1.5, path="3 m", start=""):
    (folder / "hoist.toml").write_text(model_text("ropes_hoist.toml", swing=swing, path=path, start=start))
    return ms.load(str(folder / "hoist.toml"))


def tension(model):
    profile = profile_of(model.solver, 1.0, 1.0)
    return contact_forces(model, profile.state, np.linspace(0.0, profile.duration, 81))["rope"]


def test_two_falls_carry_the_hook_with_half_its_weight(tmp_path):
    model = hoist(tmp_path)
    t = np.linspace(0.0, 1.0, 21)
    hook = model.solve(t=t).joints["hook"].value
    assert np.abs(hook - 0.025 * (2 * np.pi * t + 1.5 * np.sin(2 * np.pi * t))).max() < 1e-15
    rope, swing = tension(dynamic_model(model)), 0.025 * 1.5 * 4 * np.pi**2
    assert rope.changes == ()
    assert abs(rope.least - 5 * (9.81 - swing)) < 1e-11
    assert abs(rope.largest - 5 * (9.81 + swing)) < 1e-11
    assert "taut" in rope.sentence("rope")
    assert ms.validate(model).passed


def test_a_rope_goes_slack_where_the_hook_would_fall_faster_than_free(tmp_path):
    rope = tension(dynamic_model(hoist(tmp_path, swing=15)))
    first = np.arcsin(9.81 / (0.025 * 15 * 4 * np.pi**2)) / (2 * np.pi)
    assert np.abs(np.array(rope.changes) - [first, 0.5 - first]).max() < 1e-13
    assert "goes slack" in rope.sentence("rope")


def test_a_hoist_without_loops_couples_the_hook_to_the_drum_by_its_name():
    # in models of MuJoCo the crank has another name, which the terms of the rope must not keep
    twin = serial_twin("hoist", "urdf", independent={"drum": (-1.0, 1.0)})
    assert abs(float(twin.text.split('multiplier="')[1].split('"')[0]) - 0.025) < 1e-15
    states = ms.sample("hoist", 4)
    assert np.abs(states.qpos[:, 1] - 0.025 * states.qpos[:, 0]).max() < 1e-15
