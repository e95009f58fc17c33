"""Reactions that rigid links leave undetermined are those of minimum norm, and determined sums are stated."""

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
