"""Free runs compared with elliptic functions and the law of energy, and every outcome of a run."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import stated_mechanism

from mechsim import catalog, dynamics, load_profile, motors
from mechsim.mechanism.forces import Forces, Friction

DOWN = (0.0, -9.81, 0.0)
PERIOD = 2.367841947576237  # IFToMM benchmark A01: 1 m, released level, g = 9.81


def pendulum(**forces):
    """A01: a point mass of 1 kg on 1 m; angle zero is level."""
    return dynamics.dynamic_model(stated_mechanism("free_running_pendulum.toml"), Forces(**forces))


def test_the_bearing_of_a_pendulum_carries_three_times_its_weight():
    model = pendulum(gravity=DOWN)
    run = dynamics.run(model, initial={"crank.q": 0.0}, duration=PERIOD / 4.0, samples=4)
    study = dynamics.prescribed(model, run.motion.angle, run.motion.speed, run.motion.acceleration)
    # free motion needs no drive torque
    assert np.abs(study.forces.torque).max() <= 1e-10
    assert np.abs(study.second_torque).max() <= 1e-10
    assert study.forces.reactions["crank"].force[-1] == pytest.approx([0.0, 3 * 9.81, 0.0], abs=1e-9)


def test_the_period_without_forces_follows_from_the_reduced_inertia():
    model = dynamics.dynamic_model(catalog.make("rrsrr"), Forces())
    angle = np.arange(512) * (2.0 * np.pi / 512)
    inertia = dynamics.reduced(model, angle).inertia
    run = dynamics.run(model, initial={"crank.q": 0.0, "crank.v": 30.0}, turns=2.0, samples=2)
    exact = 2.0 * 2.0 * np.pi * np.mean(np.sqrt(inertia / inertia[0])) / 30.0
    assert run.time[-1] == pytest.approx(exact, rel=1e-11)
    assert run.motion.speed[-1] == pytest.approx(30.0, rel=1e-11)


def test_a_crank_turns_back_at_its_dead_centre():
    linkage = catalog.make("four_bar", crank=0.2, rocker=0.19, coupler=0.05, ground=0.1)
    start = linkage.mechanism.start
    run = dynamics.run(
        dynamics.dynamic_model(linkage, Forces()),
        initial={"crank.q": start, "crank.v": 5.0},
        turns=1.0,
        samples=4,
    )
    assert run.outcome == "turned back"
    ahead = min((end - start) % (2.0 * np.pi) for end in linkage.dead_centres())
    assert run.motion.angle[-1] - start == pytest.approx(ahead, abs=1e-9)
    assert run.energy_error <= 1e-9


@pytest.mark.slow
def test_friction_torques_of_several_joints_add_up():
    """Each alone is too weak, and that of the ball has a direction only while the ball moves."""
    linkage = catalog.make("rrsrr")
    friction = tuple(Friction(joint.name, 1e-5, 3e-6) for joint in linkage.mechanism.joints)
    model = dynamics.dynamic_model(linkage, Forces(gravity=DOWN, friction=friction))
    run = dynamics.run(model, initial={"crank.q": 0.0, "crank.v": 40.0}, turns=1.0, samples=2)
    assert run.outcome == "stopped"
    reduced = dynamics.reduced(model, run.motion.angle[-1:])
    assert 3e-6 < abs(reduced.static[0]) < reduced.coulomb[0]


def test_mirrored_forces_give_the_mirrored_run():
    model = pendulum(gravity=DOWN, motor=motors.ConstantTorque(12.0))
    mirrored = model.with_forces(replace(model.forces, motor=motors.ConstantTorque(-12.0)))
    item = dynamics.run(model, initial={"crank.q": -np.pi / 2 + 0.4}, duration=2.0, samples=8)
    other = dynamics.run(mirrored, initial={"crank.q": -np.pi / 2 - 0.4}, duration=2.0, samples=8)
    assert item.motion.angle + np.pi / 2 == pytest.approx(-(other.motion.angle + np.pi / 2), rel=1e-9)


@pytest.mark.long
def test_frictions_that_hold_a_crank_together_release_it_when_their_sum_is_exceeded():
    ramp = load_profile.table([0.0, 1.0], [0.0, 0.1], over="time")
    friction = (Friction("crank", 0.0, 0.02), Friction("rocker", 0.0, 0.03), Friction("A", 0.0, 0.01))
    solver = catalog.make("four_bar")
    forces = Forces(friction=friction, crank_torque=ramp, flywheel=0.1)
    result = dynamics.run(dynamics.dynamic_model(solver, forces), initial={"crank.q": 1.0}, duration=0.5)
    joints = solver.solve(1.0, 1.0).joints
    # power of all frictions at unit speed
    torque = sum(row.coulomb * abs(joints[row.joint].rate[0]) for row in friction)
    # friction holds up to 1e-9 above its limit
    assert result.events == pytest.approx([torque / 0.1], rel=3e-9)
    assert result.motion.angle[-1] > 1.0002
