"""The verdict on dynamics: correct models pass by both methods, and every wrong one fails."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from every_force import every_force
from grids import grid
from mechanisms import rscr

import mechsim as ms
from mechsim import catalog, dynamics, load_profile
from mechsim.mechanism.forces import Forces, Friction
from mechsim.mechanism.motors import ConstantTorque, DCMotor
from mechsim.mechanism.scene import Scene
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled
from mechsim.studies.dynamics_check import crosscheck_driven

SPEED = 20.0 * np.pi
GRAVITY = (0.3, -9.81, 0.5)


def forces_of(name: str) -> Forces:
    """Return forces of every kind, dry friction only in planar mechanisms."""
    dry = None if name in ("four_bar", "slider_crank", "warp_knitter") else ()
    forces = every_force(catalog.make(name).mechanism, dry=dry)
    crank_torque = load_profile.function(lambda x: 0.1 + 0.2 * np.cos(x))
    return replace(forces, crank_torque=crank_torque, flywheel=1.2e-3)


def model_of(name: str, forces: Forces) -> dynamics.DynamicModel:
    return dynamics.dynamic_model(catalog.make(name), forces)


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
@pytest.mark.parametrize("name", grid(catalog.MECHANISMS))
def test_torque_reactions_and_energies_agree_under_every_kind_of_force(name, method):
    model = model_of(name, forces_of(name))
    run = driven(model.mechanism, model.forces, speed=SPEED, method=method, samples=36)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict


def test_a_motor_that_is_too_weak_cannot_start():
    locked = Forces(motor=ConstantTorque(0.01), friction=(Friction("crank", 0.0, 0.02),))
    assert dynamics.run(model_of("four_bar", locked), turns=1.0).outcome == "cannot start"
    weak = Forces(gravity=(0.0, -9.81, 0.0), motor=ConstantTorque(1e-3))
    run = dynamics.run(model_of("four_bar", weak), turns=1.0)
    assert run.outcome == "cannot start"
    assert "turns back" in run.reason


def test_forces_of_a_slow_crank_under_gravity_are_correct():
    """The residual of accelerations was relative to those of the motion, which are almost zero."""
    model = dynamics.dynamic_model(catalog.make("four_bar"), Forces(gravity=GRAVITY))
    run = driven(model.mechanism, model.forces, speed=1e-4, method="pose", samples=12)
    assert crosscheck_driven(run, model).passed
    assert run.forces.residual.max() < 1e-12


@pytest.mark.parametrize("name", grid(catalog.MECHANISMS))
def test_a_model_with_all_forces_is_read_back_exactly(name):
    forces = replace(forces_of(name), motor=DCMotor(12.0, 1.3, 0.0123))
    spec = assembled(catalog.make(name).mechanism, Scene(level="dynamics", forces=forces))
    model = spec.compile()
    back = mujoco.MjModel.from_xml_string(to_xml(spec))
    for field in dir(model):
        made = getattr(model, field)
        if isinstance(made, np.ndarray) and made.dtype == np.float64:
            np.testing.assert_array_equal(getattr(back, field), made, err_msg=field)


FOUR = ("viscous", "coulomb", "viscous_turn", "coulomb_turn")


def lost(friction, angles):
    """Return the forces of the R-S-C-R under friction in its cylindrical joint, at 30 rad/s."""
    forces = ms.Forces(gravity=(0.3, -9.81, 0.5), friction=(friction,))
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(rscr(), forces), angles, 30.0)


def test_friction_power_follows_from_joint_rates():
    sleeve, angles = ms.Friction("sleeve", 0.2, 0.5, 1e-3, 4e-3), np.linspace(0.7, 1.4, 9)
    study = lost(sleeve, angles)
    bare, bare_turn = (
        lost(replace(sleeve, **dict.fromkeys(names, 0.0)), angles).forces.power_lost
        for names in (FOUR[:2], FOUR[2:])
    )
    assert (study.forces.power_lost > bare).all()
    assert study.forces.power_lost == pytest.approx(bare + bare_turn, rel=1e-12)
    assert study.second_torque == pytest.approx(study.forces.torque, rel=1e-10)


def test_coulomb_friction_of_a_ball_opposes_its_angular_velocity():
    forces = ms.Forces(friction=(ms.Friction("S", 1e-5, 4e-4),))
    model = ms.dynamics.dynamic_model(ms.catalog.make("rrsrr"), forces)
    ball = model.mechanism.joint("S")
    study = ms.dynamics.prescribed(model, np.linspace(0.0, 6.0, 13), 30.0)
    links = model.solver.solve(study.forces.angle, 30.0).links
    spins = [links[end.link].angular_velocity for end in (ball.a, ball.b)]
    spin = np.sqrt(((spins[1] - spins[0]) ** 2).sum(1))
    assert study.forces.power_lost == pytest.approx(4e-4 * spin + 1e-5 * spin**2, rel=1e-12)
