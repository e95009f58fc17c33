"""Reactions that rigid links leave undetermined are those of minimum norm, and determined sums are stated."""

import json

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.report.facts import study_facts

# a door of 20 kg that turns about the vertical axis at 1 rad/s, its centre 0.4 m from the axis and 1 m high
DOOR = model_text("undetermined_reactions_door.toml")
# a crank shaft with a bearing on either side, without weight, and a force on the slider
CRANK, ROD, FORCE = 0.1, 0.4, 50.0
SHAFT = model_text("undetermined_reactions_shaft.toml")


@pytest.fixture
def facts_of(file):
    def facts(text, **options):
        path = file(text)
        model = ms.dynamics.dynamic_model(ms.load(path), **options)
        study = ms.dynamics.prescribed(model, t=[0.0, 0.1])
        return study, study_facts(study)

    return facts


@pytest.mark.parametrize("heights", [(0.0, 2.0), (0.0, 1.0, 2.0)])
def test_hinges_share_the_weight_of_a_door(facts_of, heights):
    text = DOOR + "".join(
        model_text("undetermined_reactions_hinge.toml", i=i, z=z) for i, z in enumerate(heights)
    )
    study, facts = facts_of(text)
    weight, inertial = 20.0 * 9.81, 20.0 * 0.4
    names = [f"hinge{i}" for i in range(len(heights))]
    for name in names:
        reaction = study.forces.reactions[name]
        assert reaction.force[:, 2] == pytest.approx(weight / len(heights), rel=1e-12)
        own = facts["reactions"][name]
        assert own["force"]["largest"] == pytest.approx(np.linalg.norm(reaction.force, axis=1).max())
        assert not own["force"]["determined"]
        assert not own["moment"]["determined"]
        assert own["not_determined"] == ["fx", "fy", "fz", "mx", "my"]
    own = facts["sums"][" + ".join(names)]
    assert own["force"]["largest"] == pytest.approx(np.hypot(weight, inertial))
    # about the first hinge: the weight at 0.4 m and the centripetal force at a height of 1 m
    assert own["moment"]["largest"] == pytest.approx(0.4 * weight + 1.0 * inertial)
    assert own["force"]["determined"]
    assert own["moment"]["determined"]
    assert own["not_determined"] == []


def test_bearings_of_a_shaft_share_the_force_of_the_rod(facts_of):
    study, facts = facts_of(SHAFT)
    tilt = np.arcsin(CRANK * np.sin(np.deg2rad(30.0)) / ROD)
    rod = FORCE / np.cos(tilt)
    for name in ("front", "back"):
        own = facts["reactions"][name]["force"]
        assert own["largest"] == pytest.approx(rod / 2.0, rel=1e-3)
        assert not own["determined"]
    own = facts["sums"]["front + back"]
    assert own["force"]["largest"] == pytest.approx(rod, rel=1e-3)
    assert own["on"] == "crank"
    # the loop leaves forces across its plane undetermined, and so their sum
    assert own["not_determined"] == ["fz", "mx", "my"]
    # in the plane the pin is determined
    assert facts["reactions"]["A"]["force"]["largest"] == pytest.approx(rod, rel=1e-3)
    assert facts["reactions"]["A"]["force"]["determined"]
    total = study.forces.reactions["front"].force - study.forces.reactions["back"].force
    assert study.forces.sums["front + back"].force == pytest.approx(total, abs=1e-12)


def test_determined_reactions_have_no_mark_and_no_sum(facts_of):
    text = DOOR + model_text("undetermined_reactions_hinge.toml", i=0, z=0)
    _, facts = facts_of(text)
    assert facts["sums"] == {}
    own = facts["reactions"]["hinge0"]
    assert own["force"]["determined"]
    assert own["force"]["largest"] == pytest.approx(np.hypot(20.0 * 9.81, 8.0))


def test_the_command_states_undetermined_reactions_and_their_sum(mechsim, file):
    path = file(
        DOOR
        + model_text("undetermined_reactions_hinge.toml", i=0, z=0)
        + model_text("undetermined_reactions_hinge.toml", i=1, z=2)
    )
    out = mechsim("dynamics", "inverse", path, "--method", "none").out
    (row,) = (line for line in out.splitlines() if line.strip().startswith("force sum of"))
    assert "196.4" in row
    assert "of minimum norm" in out
    reported = json.loads(mechsim("dynamics", "inverse", path, "--method", "none", "--json").out)
    assert reported["sums"]["hinge0 + hinge1"]["force"]["largest"] == pytest.approx(np.hypot(196.2, 8.0))
    assert reported["reactions"]["hinge1"]["force"]["largest"] > 98.1


def test_the_table_has_the_torques_of_actuators(mechsim, tmp_path):
    table = tmp_path / "table.csv"
    options = ("--method", "none", "--samples", "8", "-o", str(table))
    out = mechsim("dynamics", "inverse", "four_bar", "--actuators", "crank,rocker=2", *options).out
    assert "drive torque alone" in out
    header = table.read_text().splitlines()[0]
    assert "actuator crank" in header
    assert "actuator rocker" in header


def test_a_sweep_prints_the_forces_of_dynamics(mechsim, tmp_path):
    path = tmp_path / "door.toml"
    text = (
        DOOR
        + model_text("undetermined_reactions_hinge.toml", i=0, z=0)
        + model_text("undetermined_reactions_hinge.toml", i=1, z=2)
    ).replace("mass = 20.0", 'mass = "m"')
    path.write_text(text.replace("[links.door]", '[parameters]\nm = "20kg"\n[links.door]'))
    reported = json.loads(mechsim("dynamics", "inverse", str(path), "--method", "none", "--json").out)
    table = tmp_path / "sweep.csv"
    mechsim("sweep", str(path), "--vary", "m=20kg:20kg:1", "--measure", "max:force:hinge1", "-o", str(table))
    swept = float(table.read_text().splitlines()[1].split(",")[1])
    assert swept == pytest.approx(reported["reactions"]["hinge1"]["force"]["largest"], rel=1e-12)
