"""The verdict on dynamics: correct models pass by both methods, and every wrong one fails."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from grids import grid

from mechsim import catalog, dynamics, load_profile
from mechsim.kinetics.initial_state import InitialValues
from mechsim.mechanism.forces import Forces, Friction, JointSpring, Load, Spring
from mechsim.mechanism.motors import ConstantTorque, DCMotor, TorqueSpeedLine
from mechsim.mechanism.scene import Scene
from mechsim.simulation import Settings, swing
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_forward

SPEED = 20.0 * np.pi
AT_REST = InitialValues({}, {})
GRAVITY = (0.3, -9.81, 0.5)


def push(angle):
    return np.stack([np.sin(angle), np.cos(2.0 * angle), 1.0 + 0.0 * angle], 1)


def every_force(name: str) -> Forces:
    """Return forces of every kind that the mechanism's joints allow."""
    mechanism = catalog.make(name).mechanism
    tip = list(mechanism.points)[-1]
    straight = [joint.name for joint in mechanism.joints if joint.kind in ("revolute", "prismatic")]
    planar = name in ("four_bar", "slider_crank", "warp_knitter")
    return Forces(
        gravity=GRAVITY,
        friction=tuple(Friction(joint, 1e-3, 1e-2 if planar else 0.0) for joint in straight),
        springs=(Spring(tip, ("ground", (0.1, 0.2, 0.3)), 10.0, 0.01, 0.3),),
        joint_springs=tuple(JointSpring(joint, 0.3, 0.12) for joint in straight),
        loads=(Load(tip, load_profile.function(push, width=3)),),
        crank_torque=load_profile.function(lambda x: 0.1 + 0.2 * np.cos(x)),
        flywheel=1.2e-3,
    )


def model_of(name: str, forces: Forces) -> dynamics.DynamicModel:
    return dynamics.dynamic_model(catalog.make(name), forces)


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
@pytest.mark.parametrize("name", grid(catalog.MECHANISMS))
def test_torque_reactions_and_energies_agree_under_every_kind_of_force(name, method):
    model = model_of(name, every_force(name))
    run = driven(model.mechanism, model.forces, speed=SPEED, method=method, samples=36)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict


@pytest.mark.parametrize("name", ["rssr", "four_bar"])
def test_torques_of_a_swinging_crank_agree(name):
    model = model_of(name, Forces(gravity=GRAVITY, flywheel=2e-3))
    profile = swing(model.mechanism.start + 0.3, 0.5, 30.0)
    run = driven(model.mechanism, model.forces, profile=profile, samples=36)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict


def test_the_torque_of_a_stepped_run_converges_with_fourth_order():
    model = model_of("rssr", Forces(gravity=GRAVITY))
    errors = []
    for steps in (144, 288):
        settings = Settings(steps_per_turn=steps, constant_steps=steps / 10.0)
        run = driven(model.mechanism, model.forces, speed=SPEED, method="step", settings=settings)
        exact = dynamics.prescribed(model, run.motion.angle, run.motion.speed, run.motion.acceleration)
        errors.append(np.sqrt(np.mean((run.forces.torque - exact.forces.torque) ** 2)))
    assert 3.5 < np.log2(errors[0] / errors[1]) < 5.5


def with_heavier_link(model: dynamics.DynamicModel) -> dynamics.DynamicModel:
    *others, last = model.mechanism.links
    heavier = replace(last, inertia=replace(last.inertia, mass=1.001 * last.inertia.mass))
    return replace(model, mechanism=replace(model.mechanism, links=(*others, heavier)))


def with_reversed_gravity(model: dynamics.DynamicModel) -> dynamics.DynamicModel:
    x, y, z = model.forces.gravity
    return model.with_forces(replace(model.forces, gravity=(-x, -y, -z)))


def without_friction(model: dynamics.DynamicModel) -> dynamics.DynamicModel:
    return model.with_forces(replace(model.forces, friction=()))


def test_every_wrong_model_fails_in_a_free_run():
    forces = Forces(gravity=GRAVITY, motor=TorqueSpeedLine(5.0, 100.0), friction=(Friction("crank", 1e-3),))
    model = model_of("four_bar", forces)
    run = dynamics.run(model, turns=0.1, samples=12)
    for wrong in (with_heavier_link, with_reversed_gravity, without_friction):
        assert crosscheck_forward(run, wrong(model), AT_REST).outcome == "failed", wrong


@pytest.mark.long
def test_free_runs_under_an_angle_dependent_load_agree():
    forces = Forces(
        motor=TorqueSpeedLine(5.0, 100.0),
        crank_torque=load_profile.function(lambda x: 0.1 * np.cos(x) - 0.2),
        flywheel=0.01,
    )
    model = model_of("four_bar", forces)
    run = dynamics.run(model, turns=0.5, samples=30)
    verdict = crosscheck_forward(run, model, AT_REST)
    assert verdict.passed, verdict
    assert mujoco.get_mjcb_control() is None


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
    forces = replace(every_force(name), motor=DCMotor(12.0, 1.3, 0.0123))
    spec = assembled(catalog.make(name).mechanism, Scene(level="dynamics", forces=forces))
    model = spec.compile()
    back = mujoco.MjModel.from_xml_string(to_xml(spec))
    for field in dir(model):
        made = getattr(model, field)
        if isinstance(made, np.ndarray) and made.dtype == np.float64:
            np.testing.assert_array_equal(getattr(back, field), made, err_msg=field)


def test_the_exported_crank_has_only_the_flywheel_inertia():
    mechanism = catalog.make("rssr").mechanism
    spec = assembled(mechanism, Scene(level="dynamics", forces=Forces(flywheel=0.02)))
    model = spec.compile()
    assert model.dof_armature[model.joint("crank").dofadr[0]] == 0.02


def test_all_hinges_of_a_spatial_loop_have_coulomb_friction():
    mechanism = catalog.make("bennett").mechanism
    names = [joint.name for joint in mechanism.joints]
    for dry in names[1:]:
        forces = Forces(friction=(Friction(dry, 0.0, 0.1),))
        model = assembled(mechanism, Scene(level="dynamics", forces=forces)).compile()
        assert model.dof_frictionloss.any()
        assert model.nu == 0
    forces_everywhere = Forces(friction=tuple(Friction(name, 0.0, 0.1) for name in names))
    model = assembled(mechanism, Scene(level="dynamics", forces=forces_everywhere)).compile()
    assert (model.dof_frictionloss > 0.0).sum() == 4
    assert not model.nu
