"""Joints of kind cam in TOML files: motion against the law, forces against the pressure angle."""

import numpy as np
import pytest
from model_files import changed_model

import mechsim as ms
from mechsim.kinetics import dynamic_model, prescribed

SEGMENTS = """[
  { over = "120 deg", to = "10 mm", kind = "cycloidal" }, { over = "60 deg" },
  { over = "120 deg", to = 0.0, kind = "polynomial_345" }, { over = "60 deg" } ]"""
SLIDE = """kind = "prismatic"
a = {{ link = "ground", at = [{x}, {y}, 0], axis = [0, 1, 0] }}
b = {{ link = "follower", axis = [0, 1, 0] }}"""
HINGE = """kind = "revolute"
a = {{ link = "ground", at = [0.07, 0, 0], axis = [0, 0, -1], reference = [{x}, {y}, 0] }}
b = {{ link = "follower", axis = [0, 0, -1] }}"""


def hinged(angle):
    return HINGE.format(x=-np.cos(angle), y=np.sin(angle))


ROLLER = 'kind = "roller", radius = "6 mm"'
# angles at zero lift: cosine law of the triangle 70, 60, 31 mm, and 25 - 4 = 70 sin
ARM, FACE = np.arccos((0.07**2 + 0.06**2 - 0.031**2) / (2 * 0.07 * 0.06)), np.arcsin(0.021 / 0.07)
FOLLOWERS = {
    "knife": (
        'kind = "knife", offset = "3 mm"',
        SLIDE.format(x=0.003, y=np.sqrt(0.025**2 - 0.003**2)),
        [0, 0, 0],
    ),
    "roller": (
        f'{ROLLER}, offset = "3 mm"',
        SLIDE.format(x=0.003, y=np.sqrt(0.031**2 - 0.003**2)),
        [0, 0, 0],
    ),
    "flat": ('kind = "flat"', SLIDE.format(x=0, y=0.025), [0.05, 0, 0]),
    "swinging roller": (
        f'{ROLLER}, motion = "swinging", arm = "60 mm", centre_distance = "70 mm"',
        hinged(ARM),
        [0.06, 0, 0],
    ),
    "swinging flat": (
        'kind = "flat", motion = "swinging", offset = "4 mm", centre_distance = "70 mm"',
        hinged(FACE),
        [0.03, -0.004, 0],
    ),
}


def written(kind, law=None):
    follower, guide, centre = FOLLOWERS[kind]
    law = law or ('"0.1*(1 - cos(q))"' if "swinging" in kind else '"0.005*(1 - cos(q))"')
    return changed_model("toml_cams_model.toml", follower=follower, guide=guide, at=centre, law=law)


@pytest.mark.parametrize("kind", FOLLOWERS)
def test_a_follower_moves_by_its_law_with_the_force_that_its_pressure_angle_implies(kind):
    model, angles, speed = ms.load(written(kind)), np.linspace(0.0, 2 * np.pi, 25), 20.0
    lift = 0.1 if "swinging" in kind else 0.005
    follower = model.solve(angles, speed=speed).joints["guide"]
    assert np.abs(follower.value - lift * (1 - np.cos(angles))).max() < 1e-14
    assert np.abs(follower.rate - lift * np.sin(angles) * speed).max() < 1e-12
    assert np.abs(follower.acceleration - lift * np.cos(angles) * speed**2).max() < 1e-10
    result = prescribed(dynamic_model(model), angles, speed)
    force = result.forces.reactions["contact.face" if "flat" in kind else "contact.point"].force
    acceleration = lift * np.cos(angles) * speed**2
    if "swinging" not in kind:
        # along the slide: N cos(a) = m (a + g); across it N sin(a), from the shaft's side
        along = 0.3 * (acceleration + 9.81)
        offset = 0.0 if kind == "flat" else 0.003
        start = np.sqrt((0.031 if kind == "roller" else 0.025) ** 2 - offset**2)
        rise = lift * np.sin(angles)
        tangent = 0.0 * angles if kind == "flat" else (rise - offset) / (start + lift * (1 - np.cos(angles)))
        assert np.abs(force[:, 1] - along).max() < 1e-11
        assert np.abs(force[:, 0] + along * tangent).max() < 1e-11
        torque = along * rise
    else:
        torque = 1e-4 * acceleration * lift * np.sin(angles)
    # the work on the shaft is that on the follower
    assert np.abs(result.forces.torque - torque).max() < 1e-12 + 1e-11 * np.abs(torque).max()


def test_both_methods_agree_on_a_law_of_segments():
    model = ms.load(written("roller", SEGMENTS))
    assert ms.validate(model).passed
    lift = model.solve(np.deg2rad([0, 60, 150, 240, 330])).joints["guide"].value
    assert np.abs(lift - [0, 0.005, 0.01, 0.005, 0]).max() < 1e-15


@pytest.mark.long
def test_a_cam_falls_from_its_top_as_in_mujoco_and_returns_after_a_turn():
    model = ms.load(written("roller"))
    # V = m g h (1 - cos q) is largest at q = pi, where a disturbance grows at the rate sqrt(m g h / J)
    highest = max(ms.dynamics.equilibria(model), key=lambda equilibrium: equilibrium.potential)
    assert abs(abs(highest.q["shaft"]) - np.pi) < 1e-9
    rate = max(mode.eigenvalue.real for mode in highest.modes)
    assert abs(rate / np.sqrt(0.3 * 9.81 * 0.005 / 1e-4) - 1) < 1e-9
    assert {curve.turns for curve in ms.trace(model).curves} == {1}


def test_a_cam_in_millimetres_is_that_in_metres():
    # the distance of the roller from the cam is that of the base circle, whatever the units of the file
    height = ms.load("cam_follower").positions([0.0, 2.5])["roller"][:, 1]
    start = np.sqrt(0.038**2 - 0.005**2)
    assert np.abs(height - [start, start + 0.012]).max() < 1e-15


@pytest.mark.parametrize("name", ["cam_follower", "window_regulator", "wankel"])
def test_laws_of_contacts_are_named_without_virtual_bodies(name):
    assert not [law for law in ms.load(name).mechanism.named_laws if "~" in law]


@pytest.mark.long
def test_a_driven_cam_is_stepped_with_the_fourth_order():
    model, errors = ms.load("cam_follower"), []
    for steps in (100, 200):
        run = ms.simulate(model, speed="60rpm", turns=1, method="step", timestep=1.0 / steps)
        exact = model.solve(run.motion.angle, speed=run.motion.speed)
        own = run.motion.points["roller"]
        errors.append(np.abs(own.position - exact.points["roller"].position).max())
        assert np.abs(own.velocity - exact.points["roller"].velocity).max() < 1e-3
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] > 10.0


@pytest.mark.long
def test_validation_steps_a_cam_from_one_whole_degree_to_the_next():
    case = ms.validate("needle_drive")
    assert case.passed
    assert case.run.method == "step"
    # the segments of its law end at 130, 180 and 330 deg: within a step they would reduce the order
    assert case.run.steps % 360 == 0
