"""Lift-off of cam followers against closed forms."""

import json

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.contact_forces import contact_forces
from mechsim.studies.motions import profile_of

SPEED, LIFT, MASS = 20 * np.pi, 0.005, 0.3


def forces(folder, load, closure="force"):
    (folder / "cam.toml").write_text(model_text("contact_forces_cam.toml", load=load, closure=closure))
    model = dynamic_model(ms.load(str(folder / "cam.toml")))
    profile = profile_of(model.solver, SPEED, 1.0)
    return contact_forces(model, profile.state, np.linspace(0.0, profile.duration, 61))["contact"]


@pytest.mark.long
def test_a_follower_lifts_off_where_its_weight_is_too_small(tmp_path):
    contact = forces(tmp_path, 0.0)
    # m (h w**2 cos(q) + g) = 0
    q = np.arccos(-9.81 / (LIFT * SPEED**2))
    assert np.abs(np.array(contact.changes) - [q / SPEED, (2 * np.pi - q) / SPEED]).max() < 1e-14
    # on top, in the axis of the slide: the force that is missing there
    missing = MASS * (LIFT * SPEED**2 - 9.81)
    assert abs(contact.least + missing) < 1e-12
    assert abs(contact.preload - missing) < 1e-12
    assert "lifts off" in contact.sentence("contact")


@pytest.mark.long
def test_the_least_force_lies_between_the_instants(tmp_path):
    forces(tmp_path, 0.0)
    model = dynamic_model(ms.load(str(tmp_path / "cam.toml")))
    profile = profile_of(model.solver, SPEED, 1.0)
    contact = contact_forces(model, profile.state, np.linspace(0.0, profile.duration, 14))["contact"]
    # cam angle of pi, where no instant lies; 1e-7 of their distance changes the cosine by 1e-14
    missing = MASS * (LIFT * SPEED**2 - 9.81)
    assert [contact.least, contact.preload] == pytest.approx([-missing, missing], abs=1e-11)
    assert contact.least_at == pytest.approx(np.pi / SPEED, rel=1e-6)
    assert contact.largest == pytest.approx(MASS * (LIFT * SPEED**2 + 9.81), abs=1e-11)


@pytest.mark.long
def test_the_preload_that_is_named_keeps_the_contact_closed(tmp_path):
    preload = forces(tmp_path, 0.0).preload
    assert forces(tmp_path, -1.0001 * preload).changes == ()
    assert len(forces(tmp_path, -0.9999 * preload).changes) == 2


def test_a_groove_carries_with_its_other_flank(tmp_path):
    contact = forces(tmp_path, 0.0, "form")
    assert "other flank" in contact.sentence("contact")
    assert len(contact.changes) == 2


def test_a_follower_that_is_pulled_away_has_no_contact_at_all(tmp_path):
    contact = forces(tmp_path, 100.0)
    assert contact.changes == ()
    assert "have to pull" in contact.sentence("contact")
    assert contact.preload == pytest.approx(100.0 - MASS * 9.81 + MASS * LIFT * SPEED**2, rel=1e-12)


@pytest.mark.long
def test_inverse_dynamics_states_the_instants(tmp_path, mechsim):

    forces(tmp_path, 0.0)
    arguments = ["dynamics", "inverse", str(tmp_path / "cam.toml"), "--samples", "13", "--json"]
    answer = mechsim(*arguments)
    contact = json.loads(answer.out)["contacts"]["contact"]
    assert contact["one_sided"]
    assert abs(contact["changes"][0] - np.arccos(-9.81 / (LIFT * SPEED**2)) / SPEED) < 1e-14
