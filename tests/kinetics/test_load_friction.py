"""Coulomb friction by the load of joints: closed forms, and equations solved by scipy."""

import json
from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text
from scipy.optimize import root

import mechsim as ms
from mechsim import dynamics
from mechsim.errors import FrictionError
from mechsim.mechanism.joint_friction import Friction
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven

SLIDER_CRANK = model_text("load_friction_slider_crank.toml")
LOADED = "\n[forces.loads.press]\nat = { link = 'slider' }\nforce = ['-300 N', 0, 0]\n"


def loaded(text, tmp_path, **options):
    path = tmp_path / "friction.toml"
    path.write_text(text)
    return ms.load(str(path), **options)


def slider_crank_by_hand(angle, w, press):
    """Return the drive torque by the Newton-Euler equations of three links, solved for nine unknowns."""
    a, b, h, g = 0.06, 0.2, 0.01, 9.81
    s = (h - a * np.sin(angle)) / b
    phi = np.arcsin(s)
    dphi = -a * np.cos(angle) * w / (b * np.cos(phi))
    ddphi = (a * np.sin(angle) * w**2 + b * np.sin(phi) * dphi**2) / (b * np.cos(phi))

    def e(t):
        return np.array([np.cos(t), np.sin(t)])

    def n(t):
        return np.array([-np.sin(t), np.cos(t)])

    def cross(p, f):
        return p[0] * f[1] - p[1] * f[0]

    acc_crank = -0.02 * w**2 * e(angle)
    acc_a = -a * w**2 * e(angle)
    acc_rod = acc_a + 0.09 * (ddphi * n(phi) - dphi**2 * e(phi))
    acc_b = acc_a + b * (ddphi * n(phi) - dphi**2 * e(phi))
    speed_b = a * w * n(angle)[0] + b * dphi * n(phi)[0]
    weight = np.array([0.0, -g])

    def equations(x):
        o, pin_a, pin_b, normal, torque = x[:2], x[2:4], x[4:6], x[6], x[7]
        # friction torques on the outer link of each pin, against its relative rotation
        t_o = -np.sign(w) * 0.15 * 0.008 * np.hypot(*o)
        t_a = -np.sign(dphi - w) * (0.2 * 0.006 * np.hypot(*pin_a) + 0.01)
        t_b = -np.sign(-dphi) * 0.25 * 0.005 * np.hypot(*pin_b)
        f_s = -np.sign(speed_b) * 0.1 * abs(normal)
        crank = o - pin_a + 0.4 * (weight - acc_crank)
        rod = pin_a - pin_b + 0.5 * (weight - acc_rod)
        slider = pin_b + np.array([f_s + press, normal]) + 0.8 * (weight - acc_b)
        turn_crank = torque + t_o - t_a + cross(0.02 * e(angle), 0.4 * weight) - cross(a * e(angle), pin_a)
        turn_rod = (
            t_a
            - t_b
            + cross(0.09 * e(phi), 0.5 * (weight - acc_rod))
            - cross(b * e(phi), pin_b)
            - 2e-3 * ddphi
        )
        return np.concatenate([crank, rod, slider, [turn_crank, turn_rod]])

    solution = root(equations, np.zeros(8), tol=1e-14)
    assert np.abs(equations(solution.x)).max() < 1e-10
    return solution.x[7]


def test_a_slider_crank_with_friction_at_pins_and_slide_needs_the_torque_by_hand(tmp_path):
    model = dynamics.dynamic_model(loaded(SLIDER_CRANK + LOADED, tmp_path))
    angle = np.array([0.3, 1.1, 2.0, 3.6, 4.4, 5.9])
    for speed in (25.0, -25.0):
        study = dynamics.prescribed(model, angle, speed)
        expected = [slider_crank_by_hand(value, speed, -300.0) for value in angle]
        assert study.forces.torque == pytest.approx(expected, rel=1e-11, abs=1e-11)
        assert study.second_torque == pytest.approx(expected, rel=1e-11, abs=1e-11)
    backwards = slider_crank_by_hand(1.1, -25.0, -300.0)
    assert abs(slider_crank_by_hand(1.1, 25.0, -300.0) - backwards) > 1.0


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
def test_mujoco_finds_the_same_friction_by_its_own_reactions(method, tmp_path):
    model = dynamics.dynamic_model(loaded(SLIDER_CRANK + LOADED, tmp_path))
    run = driven(model.mechanism, model.forces, speed=25.0, method=method, samples=12)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    other = [replace(item, coefficient=1.01 * item.coefficient) for item in model.forces.friction]
    wrong = model.with_forces(replace(model.forces, friction=tuple(other)))
    assert crosscheck_driven(run, wrong).outcome == "failed"


@pytest.mark.parametrize("lead", [6.0, 40.0, -6.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_screw_raises_and_lowers_a_load_by_the_formula_of_shigley(lead, sign, tmp_path):
    model = dynamics.dynamic_model(
        loaded(model_text("load_friction_screw.toml", lead=lead, sign=sign), tmp_path)
    )
    study = dynamics.prescribed(model, t=[0.1, 0.2])
    load, mu, r = 981.0, 0.12, 9e-3
    tangent = lead * 1e-3 / (2 * np.pi * r)
    # the torque against the load and the thread, and against the collar
    s = sign * np.sign(tangent)
    thread = load * r * (abs(tangent) + s * mu) / (1 - s * mu * abs(tangent)) * np.sign(tangent)
    expected = thread + sign * mu * 15e-3 * load
    assert study.forces.drives["thread.turn"] == pytest.approx(expected, rel=1e-12)


def wedge(angle, mu, speed, tmp_path):
    text = model_text("load_friction_wedge.toml", mu=mu, c=np.cos(angle), s=np.sin(angle), speed=speed)
    return dynamics.dynamic_model(loaded(text, tmp_path))


@pytest.mark.parametrize("speed", [0.1, -0.1])
def test_a_wedge_lifts_and_lowers_a_block_by_the_angles_of_friction(speed, tmp_path):
    angle, mu, weight = np.deg2rad(15.0), 0.2, 20.0 * 9.81
    study = dynamics.prescribed(wedge(angle, mu, speed, tmp_path), t=[0.1])
    friction = np.sign(speed) * np.arctan(mu)
    # reactions on the block at the face and the wall are inclined by the angle of friction
    side = np.sin(angle + friction)
    face = weight / (np.cos(angle + friction) - side * np.tan(np.arctan(mu) * np.sign(speed)))
    down = face * np.cos(angle + friction) + 1e-3 * 9.81
    expected = face * side + np.sign(speed) * mu * down
    assert study.forces.drives["floor"] == pytest.approx(expected, rel=1e-12)


def test_a_steep_wedge_jams(tmp_path):
    # the angle of the face and two angles of friction exceed 90 degrees
    model = wedge(np.deg2rad(60.0), 0.3, 0.1, tmp_path)
    with pytest.raises(FrictionError, match="jams") as caught:
        dynamics.prescribed(model, t=[0.1])
    assert caught.value.outcome == "jammed"


def test_a_jam_is_the_outcome_of_the_command(tmp_path, mechsim):
    path = tmp_path / "wedge.toml"
    angle = np.deg2rad(60.0)
    path.write_text(
        model_text("load_friction_wedge.toml", mu=0.3, c=np.cos(angle), s=np.sin(angle), speed=0.1)
    )
    with np.errstate(all="ignore"):
        answer = mechsim("dynamics", "inverse", str(path), "--json")
    assert answer.code == 1
    data = json.loads(answer.out)
    assert data["outcome"] == "jammed"
    assert data["passed"] is False


def test_two_slides_that_share_a_load_leave_friction_undetermined(tmp_path):
    second = model_text(
        "load_friction_wedge.toml", mu=0.1, c=np.cos(0.3), s=np.sin(0.3), speed=0.1
    ) + model_text("load_friction_two_slides_that_share_a_load_l.toml")
    with pytest.raises(FrictionError, match="redundant") as caught:
        dynamics.prescribed(dynamics.dynamic_model(loaded(second, tmp_path)), t=[0.1])
    assert caught.value.outcome == "undetermined"


def test_friction_in_the_pins_of_a_planar_loop_is_determined():
    pins = tuple(Friction(name, coefficient=0.1, pin_radius=4e-3) for name in ("crank", "A", "B", "rocker"))
    model = dynamics.dynamic_model(ms.catalog.make("four_bar"), ms.Forces(friction=pins))
    assert dynamics.prescribed(model, [0.5, 2.0], 5.0).forces.power_lost.min() > 0.0


def test_an_exported_mujoco_model_states_the_friction_it_lacks(tmp_path):
    model = loaded(SLIDER_CRANK, tmp_path)
    for scene in ("dynamics", "motion"):
        assert "friction by load and rate in crank, A, B, slide" in ms.export(model, scene=scene).left_out


def test_friction_by_rate_acts_in_a_prescribed_motion_by_both_methods(tmp_path):
    text = SLIDER_CRANK.replace(
        "coefficient = 0.1 }", 'coefficient = 0.1, static = 0.3, stribeck = "0.5 m/s" }'
    )
    model = dynamics.dynamic_model(loaded(text + LOADED, tmp_path))
    run = driven(model.mechanism, model.forces, speed=25.0, samples=12)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    study = dynamics.prescribed(model, run.motion.angle, 25.0)
    joints = model.solver.solve(run.motion.angle, 25.0).joints
    slide, normal = joints["slide"].rate, study.forces.reactions["slide"].force[:, 1]
    curve = 0.1 + 0.2 * np.exp(-((slide / 0.5) ** 2))
    # the power of all friction less that of the pins
    pins = np.zeros(13)
    for name, moment in (("crank", 0.15 * 8e-3), ("A", 0.2 * 6e-3), ("B", 0.25 * 5e-3)):
        load = np.linalg.norm(study.forces.reactions[name].force[:, :2], axis=1)
        pins += (moment * load + 0.01 * (name == "A")) * np.abs(joints[name].rate)
    expected = curve * np.abs(normal * slide)
    assert study.forces.power_lost - pins == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_spatial_chain_with_friction_in_every_kind_agrees_with_mujoco():
    model = dynamics.dynamic_model(ms.catalog.make("rrsrr"))
    radius = {"coefficient": 0.2, "pin_radius": 4e-3, "collar_radius": 3e-3, "bearing_length": 0.02}
    pins = [joint.name for joint in model.mechanism.joints if joint.kind == "revolute"]
    frictions = [Friction(name, **radius) for name in pins]
    frictions += [Friction("S", coefficient=0.1, pin_radius=5e-3)]
    model = model.with_forces(replace(model.forces, friction=tuple(frictions)))
    run = driven(model.mechanism, model.forces, speed=30.0, turns=0.2, samples=8)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    without = replace(model.forces, friction=tuple(frictions[:-1]))
    assert crosscheck_driven(run, model.with_forces(without)).outcome == "failed"
