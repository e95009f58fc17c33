"""Friction in joints of every kind, couples and geared motors: both methods agree, and wrong models fail."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import rscr, rsup

from mechsim import catalog, dynamics, load_profile
from mechsim.kinetics.initial_state import InitialValues
from mechsim.mechanism.forces import Couple, Forces, Friction
from mechsim.mechanism.motors import DCMotor, Geared, TorqueSpeedLine
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_forward

GRAVITY = (0.3, -9.81, 0.5)
SLEEVE = Friction("sleeve", 0.2, 0.5, 1e-3, 4e-3)
ALL = {
    "cylindrical": (rscr(), SLEEVE),
    "universal": (rsup(), Friction("cross", 1e-3, 3e-3)),
    "spatial cut joint": (catalog.make("bennett").mechanism, None),
    "spherical cut joint": (catalog.make("rrsrr").mechanism, Friction("S", 1e-5, 4e-4)),
}


def model_of(kind):
    mechanism, friction = ALL[kind]
    # Coulomb friction in every joint includes the cut joint
    frictions = (friction,) if friction else tuple(Friction(j.name, 0.0, 2e-3) for j in mechanism.joints)
    source = mechanism
    for linkage in map(catalog.make, ("bennett", "rrsrr")):
        source = linkage if linkage.name == mechanism.name else source
    return dynamics.dynamic_model(source, Forces(gravity=GRAVITY, friction=frictions))


def with_changed_friction(model, **coefficients):
    friction = tuple(replace(item, **coefficients) for item in model.forces.friction)
    return model.with_forces(replace(model.forces, friction=friction))


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
@pytest.mark.parametrize("kind", ALL)
def test_torques_and_reactions_agree_under_friction(kind, method):
    model = model_of(kind)
    run = driven(model.mechanism, model.forces, speed=30.0, turns=0.1, method=method, samples=12)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    coefficients = ("viscous", "coulomb", "viscous_turn", "coulomb_turn")
    for name in [each for each in coefficients if getattr(model.forces.friction[0], each)]:
        assert crosscheck_driven(run, with_changed_friction(model, **{name: 0.0})).outcome == "failed", name


@pytest.mark.parametrize("opposed", [(), ("A",), ("B",), ("crank", "A")])
def test_friction_in_a_cut_joint_opposes_its_motion(opposed):
    mechanism = catalog.make("four_bar").mechanism
    down = {"axis": (0.0, 0.0, -1.0)}
    rotated = tuple(
        replace(item, a=replace(item.a, **down), b=replace(item.b, **down)) if item.name in opposed else item
        for item in mechanism.joints
    )
    friction = tuple(Friction(item.name, 1e-4, 2e-3) for item in rotated)
    model = dynamics.dynamic_model(replace(mechanism, joints=rotated), Forces(friction=friction))
    run = driven(model.mechanism, model.forces, speed=30.0, turns=0.1, samples=12)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict


def test_friction_power_follows_from_joint_rates():
    model = model_of("cylindrical")
    study = dynamics.prescribed(model, angles := np.linspace(0.7, 1.4, 9), 30.0)
    result = study.forces
    bare, bare_turn = (
        dynamics.prescribed(with_changed_friction(model, **dict.fromkeys(names, 0.0)), angles, 30.0).forces
        for names in (("viscous", "coulomb"), ("viscous_turn", "coulomb_turn"))
    )
    assert (result.power_lost > bare.power_lost).all()
    assert result.power_lost == pytest.approx(bare.power_lost + bare_turn.power_lost, rel=1e-12)
    assert study.second_torque == pytest.approx(result.torque, rel=1e-10)


def test_coulomb_friction_of_a_ball_opposes_its_angular_velocity():
    model = model_of("spherical cut joint")
    ball = model.mechanism.joint("S")
    study = dynamics.prescribed(model, np.linspace(0.0, 6.0, 13), 30.0)
    links = model.solver.solve(study.forces.angle, 30.0).links
    still = np.zeros((13, 3))
    spins = [links[end.link].angular_velocity if end.link in links else still for end in (ball.a, ball.b)]
    spin = np.sqrt(((spins[1] - spins[0]) ** 2).sum(1))
    assert study.forces.power_lost == pytest.approx(4e-4 * spin + 1e-5 * spin**2, rel=1e-12)


@pytest.mark.parametrize(
    "kind", ["spherical cut joint", pytest.param("spatial cut joint", marks=pytest.mark.slow)]
)
def test_a_free_run_loses_the_energy_of_the_reduced_equation(kind):
    model = model_of(kind)
    model = model.with_forces(replace(model.forces, flywheel=1e-3))
    run = dynamics.run(model, initial={"crank.v": 60.0}, duration=0.01, samples=20)
    initial = InitialValues({}, {"crank": 60.0})
    verdict = crosscheck_forward(run, model, initial)
    assert verdict.passed, verdict
    assert crosscheck_forward(run, with_changed_friction(model, coulomb=0.0), initial).outcome == "failed"


def test_a_couple_on_another_link_fails():
    moment = load_profile.function(
        lambda angle: np.stack([np.cos(angle), 0.3 + 0.0 * angle, np.sin(2.0 * angle)], 1), width=3
    )
    model = dynamics.dynamic_model(catalog.make("rrsrr"), Forces(couples=(Couple("link", moment),)))
    run = driven(model.mechanism, model.forces, speed=30.0, samples=24)
    assert crosscheck_driven(run, model).passed
    other = model.with_forces(Forces(couples=(Couple("coupler", moment),)))
    assert crosscheck_driven(run, other).outcome == "failed"
    spin = model.solver.solve(run.motion.angle, 30.0).links["link"].angular_velocity
    result = dynamics.prescribed(model, run.motion.angle, 30.0).forces
    assert result.power_loads == pytest.approx((moment.evaluate(result.angle) * spin).sum(1), abs=1e-12)


@pytest.mark.parametrize("motor", [TorqueSpeedLine(0.02, 900.0), DCMotor(12.0, 4.0, 0.012)])
def test_a_geared_motor_with_a_wrong_ratio_fails(motor):
    model = dynamics.dynamic_model(
        catalog.make("four_bar"), Forces(gravity=GRAVITY, motor=Geared(motor, 9.0))
    )
    run = dynamics.run(model, duration=0.02, samples=20)
    verdict = crosscheck_forward(run, model, InitialValues({}, {}))
    assert verdict.passed, verdict
    wrong = model.with_forces(replace(model.forces, motor=Geared(motor, 9.01)))
    assert crosscheck_forward(run, wrong, InitialValues({}, {})).outcome == "failed"
    geared = Geared(motor, 9.0)
    assert geared.torque(geared.no_load) == pytest.approx(0.0, abs=1e-12)
    assert geared.derivative == pytest.approx((geared.torque(2.0) - geared.torque(1.0)).item())
