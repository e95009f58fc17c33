"""Free runs compared with elliptic functions and the law of energy, and every outcome of a run."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from model_files import stated_mechanism

from mechsim import catalog, dynamics, load_profile, motors
from mechsim.mechanism.forces import Forces, Friction, Load

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


@pytest.mark.parametrize(
    ("name", "turns"),
    [
        ("four_bar", 1.0),
        *(pytest.param(name, 8.0, marks=pytest.mark.slow) for name in ("four_bar", "rssr", "warp_knitter")),
    ],
)
def test_a_model_without_losses_keeps_its_energy(name, turns):
    model = dynamics.dynamic_model(catalog.make(name), Forces(gravity=DOWN))
    run = dynamics.run(model, initial={"crank.q": 0.3, "crank.v": 40.0}, turns=turns, samples=80)
    assert run.outcome == "done"
    assert run.energy_error <= 1e-10
    assert run.motion.angle[-1] - run.motion.angle[0] == pytest.approx(2.0 * np.pi * turns, rel=1e-12)


def test_the_period_without_forces_follows_from_the_reduced_inertia():
    model = dynamics.dynamic_model(catalog.make("rrsrr"), Forces())
    angle = np.arange(512) * (2.0 * np.pi / 512)
    inertia = dynamics.reduced(model, angle).inertia
    run = dynamics.run(model, initial={"crank.q": 0.0, "crank.v": 30.0}, turns=2.0, samples=2)
    exact = 2.0 * 2.0 * np.pi * np.mean(np.sqrt(inertia / inertia[0])) / 30.0
    assert run.time[-1] == pytest.approx(exact, rel=1e-11)
    assert run.motion.speed[-1] == pytest.approx(30.0, rel=1e-11)


def test_damped_and_motor_driven_wheels_follow_exponentials():
    drag = (Friction("crank", 0.2),)
    wheel = pendulum(friction=drag)
    run = dynamics.run(wheel, initial={"crank.q": 0.0, "crank.v": 5.0}, duration=8.0, samples=16)
    assert run.motion.speed == pytest.approx(5.0 * np.exp(-0.2 * run.time), rel=1e-10)
    motor = motors.DCMotor(12.0, 1.0, 0.5)
    driven = dynamics.run(
        pendulum(friction=drag, motor=motor), initial={"crank.q": 0.0}, duration=30.0, samples=4
    )
    assert driven.motion.speed[-1] == pytest.approx(0.5 * 12.0 / (0.25 + 0.2), rel=1e-5)
    assert driven.motion.speed == pytest.approx(6.0 / 0.45 * (1.0 - np.exp(-0.45 * driven.time)), rel=1e-9)


def test_coulomb_friction_stops_a_wheel_and_locks_it():
    wheel = pendulum(friction=(Friction("crank", 0.0, 2.0),))
    run = dynamics.run(wheel, initial={"crank.q": 0.0, "crank.v": 5.0}, duration=4.0, samples=40)
    assert run.outcome == "stopped"
    assert run.motion.speed == pytest.approx(np.maximum(5.0 - 2.0 * run.time, 0.0), abs=1e-9)
    assert run.motion.angle[-1] == pytest.approx(25.0 / 4.0, rel=1e-11)
    assert run.lost[-1] == pytest.approx(12.5, rel=1e-11)


@pytest.mark.parametrize(
    ("forces", "output"),
    [
        (
            Forces(motor=motors.ConstantTorque(1e-3), friction=(Friction("crank", 0.0, 0.1),)),
            "dry friction holds",
        ),
        (Forces(gravity=DOWN, motor=motors.DCMotor(0.1, 10.0, 0.01)), "turns back"),
        (Forces(), "the drive and loads give 0 N m"),
        pytest.param(
            Forces(motor=motors.ConstantTorque(-1.0)),
            "3 turns backwards",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_motor_too_weak_to_start_is_reported(forces, output):
    run = dynamics.run(dynamics.dynamic_model(catalog.make("four_bar"), forces), turns=3.0)
    assert run.outcome == "cannot start"
    assert output in run.reason


def test_incomplete_runs_report_their_outcome():
    rising = dynamics.run(pendulum(gravity=DOWN), initial={"crank.q": -np.pi / 2, "crank.v": 6.0}, turns=1.0)
    assert rising.outcome == "turned back"
    # a full revolution needs v2 = 4 g l; 36 = 2 g (1 - cos t) gives the reversal
    assert rising.motion.angle[-1] + np.pi / 2 == pytest.approx(
        np.arccos(1.0 - 36.0 / (2.0 * 9.81)), rel=1e-10
    )
    braked = dynamics.run(
        pendulum(friction=(Friction("crank", 0.0, 1.0),)), initial={"crank.q": 0.0, "crank.v": 2.0}, turns=1.0
    )
    assert braked.outcome == "stopped"
    creeping = dynamics.run(
        pendulum(friction=(Friction("crank", 1.0),)),
        initial={"crank.q": 0.0, "crank.v": 2.0},
        turns=1.0,
        duration=20.0,
    )
    assert creeping.outcome == "time over"
    short = dynamics.run(pendulum(), initial={"crank.q": 0.0, "crank.v": 1.0}, turns=1.0, duration=1.0)
    assert short.outcome == "time over"
    assert short.reason.startswith("0.159155 of 1 turns")


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


def test_a_run_ends_at_a_simultaneous_reversal_of_friction():
    """The rocker reverses at the start, and so at the end of each turn."""
    linkage = catalog.make("four_bar")
    friction = tuple(Friction(joint.name, 1e-5, 1e-5) for joint in linkage.mechanism.joints)
    model = dynamics.dynamic_model(linkage, Forces(gravity=DOWN, friction=friction))
    run = dynamics.run(model, initial={"crank.q": 0.0, "crank.v": 40.0}, turns=1.0, samples=2)
    assert run.outcome == "done"
    assert run.motion.angle[-1] == pytest.approx(2.0 * np.pi, rel=1e-12)
    assert run.energy_error <= 1e-10


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


def root_of_inertia(model, lengths, short, angle):
    """Return the root of a four-bar's reduced inertia, (n,), near its singular configuration.

    Heron's formula for coupler, rocker and the line from crank pin to pivot avoids cancellation, since it
    uses the deficit of the coupler length.
    """
    ground, crank, coupler, rocker = lengths
    bulge = 4.0 * ground * crank * np.sin(0.5 * angle) ** 2
    diagonal = ground - crank * np.exp(1j * angle)
    reach = np.abs(diagonal)
    slack = short + bulge / (reach + ground - crank)
    height = np.sqrt(
        slack * (2.0 * rocker - slack) * (2.0 * rocker + 2.0 * reach - slack) * (2.0 * reach - slack)
    )
    height /= 2.0 * reach
    beyond = (coupler**2 - rocker**2 - reach**2) / (2.0 * reach)
    coupler_axis = diagonal / reach * (reach + beyond + 1j * height) / coupler
    rocker_axis = diagonal / reach * (beyond + 1j * height) / rocker
    sine, arm = reach * height / (coupler * rocker), crank * np.exp(1j * angle)
    rate, last = (
        (item.conjugate() * arm).imag / (length * sine)
        for item, length in ((rocker_axis, coupler), (coupler_axis, rocker))
    )
    links = [link.inertia for link in model.mechanism.links]
    speeds = (
        links[0].centre[0],
        arm + complex(*links[1].centre[:2]) * rate * coupler_axis,
        links[2].centre[0] * last,
    )
    each = zip(links, speeds, (1.0, rate, last), strict=True)
    return np.sqrt(sum(item.mass * np.abs(v) ** 2 + item.moments[2][2] * w**2 for item, v, w in each))


@pytest.mark.slow
def test_a_crank_passes_close_to_a_singular_configuration():
    # a ten-millionth of the length, where rounding is 1e-9 of the inertia
    lengths, short = (0.05, 0.02, 0.07 - 1e-8, 0.04), 1e-8
    linkage = catalog.make(
        "four_bar", **dict(zip(("ground", "crank", "coupler", "rocker"), lengths, strict=True))
    )
    model = dynamics.dynamic_model(linkage, Forces())
    run = dynamics.run(model, initial={"crank.q": 2.0, "crank.v": 60.0}, turns=1.0, samples=2)
    assert run.outcome == "done"
    nodes, weights = np.polynomial.legendre.leggauss(60)
    total = 0.0
    for sign, width in ((-1.0, 2.0 * np.pi - 2.0), (1.0, 2.0)):
        ends = np.array([0.0, *(width * 10.0 ** -np.arange(8.0, -0.5, -0.5))])
        for low, high in pairwise(ends):
            angle = sign * (0.5 * (low + high) + 0.5 * (high - low) * nodes)
            total += 0.5 * (high - low) * weights @ root_of_inertia(model, lengths, short, angle)
    exact = total / root_of_inertia(model, lengths, short, np.array([2.0]))[0] / 60.0
    # measured 5e-11
    assert run.time[-1] == pytest.approx(exact, rel=1e-9)


def test_a_load_on_a_point_does_its_work():
    linkage = catalog.make("slider_crank")
    against = load_profile.constant((-3.0, 0.0, 0.0))
    model = dynamics.dynamic_model(linkage, Forces(loads=(Load("B", against),)))
    run = dynamics.run(model, initial={"crank.q": 0.2, "crank.v": 30.0}, turns=1.3, samples=49)
    path = linkage.solve(run.motion.angle).points["B"].position[:, 0]
    assert run.work == pytest.approx(-3.0 * (path - path[0]), abs=1e-10)
    assert run.energy_error <= 1e-10


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
