"""Equilibria, holding efforts, natural frequencies and frequency response against closed solutions."""

import numpy as np
import pytest
from pendulums import GRAVITY, WEIGHT, double_pendulum, pendulum, slider

import mechsim as ms
from mechsim.mechanism.forces import Forces, Friction, JointSpring

OSCILLATOR = Forces(friction=(Friction("s", viscous=8.0),), joint_springs=(JointSpring("s", 200.0),))


def test_a_hanging_pendulum_is_stable_and_an_upright_one_unstable():
    below, above = ms.dynamics.equilibria(pendulum(), WEIGHT, starts=4)
    assert below.q["pivot"] == pytest.approx(-np.pi / 2.0, abs=1e-11)
    assert below.stable
    assert above.q["pivot"] == pytest.approx(np.pi / 2.0, abs=1e-11)
    assert not above.stable
    assert below.modes[0].frequency == pytest.approx(np.sqrt(GRAVITY) / (2.0 * np.pi), rel=1e-11)


def test_all_four_equilibria_of_a_double_pendulum_are_found():
    result = ms.dynamics.equilibria(double_pendulum(), WEIGHT, starts=25)
    assert sorted(equilibrium.stable for equilibrium in result) == [False, False, False, True]


def test_a_double_pendulum_has_its_textbook_frequencies():
    modes = ms.dynamics.modes(double_pendulum(), WEIGHT, initial={"A.q": "-80deg", "B.q": "5deg"})
    exact = np.sqrt(GRAVITY * (2.0 + np.array([-1.0, 1.0]) * np.sqrt(2.0))) / (2.0 * np.pi)
    assert [mode.frequency for mode in modes] == pytest.approx(exact, rel=1e-10)
    # absolute amplitudes are 1 : sqrt 2 in phase, and 1 : -sqrt 2
    for mode, ratio in zip(modes, (np.sqrt(2.0), -np.sqrt(2.0)), strict=True):
        first, second = mode.shape["A"], mode.shape["A"] + mode.shape["B"]
        assert (second / first).real == pytest.approx(ratio, rel=1e-8)


def test_a_damped_oscillator_has_its_frequency_and_damping_ratio():
    (mode,) = ms.dynamics.modes(slider(), OSCILLATOR)
    assert mode.frequency == pytest.approx(10.0 / (2.0 * np.pi), rel=1e-11)
    assert mode.damping_ratio == pytest.approx(8.0 / (2.0 * 2.0 * 10.0), rel=1e-9)


def test_a_damped_oscillator_has_its_transfer_function():
    frequency = np.array([0.1, 1.5, 1.6, 5.0])
    response = ms.dynamics.response(slider(), "s", "P.x", frequency, OSCILLATOR)
    s = 2j * np.pi * frequency
    assert response == pytest.approx(1.0 / (2.0 * s**2 + 8.0 * s + 200.0), rel=1e-9)


def test_a_four_bar_has_a_stable_and_an_unstable_equilibrium():
    solver = ms.catalog.make("four_bar")
    result = ms.dynamics.equilibria(solver, WEIGHT, starts=6)
    assert [equilibrium.stable for equilibrium in result] == [True, False]
    assert all(equilibrium.reached for equilibrium in result)
    for equilibrium in result:
        torque = ms.dynamics.holding(solver, WEIGHT, initial={"crank.q": equilibrium.q["crank"]})
        assert abs(torque["crank"]) <= 1e-12


def test_the_holding_torque_agrees_with_inverse_dynamics_at_rest():
    solver = ms.catalog.make("four_bar")
    exact = ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver, WEIGHT), [0.5], speed=0.0).forces.torque[
        0
    ]
    assert ms.dynamics.holding(solver, WEIGHT, initial={"crank.q": 0.5})["crank"] == pytest.approx(
        exact, rel=1e-10
    )


def test_small_vibrations_of_the_nonlinear_run_have_the_linear_frequency():
    solver = ms.catalog.make("four_bar")
    stable = ms.dynamics.equilibria(solver, WEIGHT, starts=0, initial={"crank.q": "-95deg"})[0]
    start = {"crank.q": stable.q["crank"] + 1e-4}
    period = 1.0 / stable.modes[0].frequency
    run = ms.dynamics.run(solver, WEIGHT, initial=start, duration=period, samples=4)
    swing = run.motion.joints["crank"].value - stable.q["crank"]
    assert swing[[0, 2, 4]] == pytest.approx([1e-4, -1e-4, 1e-4], rel=1e-3)


@pytest.mark.long
def test_equilibria_of_other_assembly_modes_are_labelled():
    crank, rod = 0.05, 0.2
    solver = ms.catalog.make("slider_crank", crank=crank, rod=rod, offset=0.0)
    result = ms.dynamics.equilibria(solver, WEIGHT, starts=4, assemblies=12)
    assert {equilibrium.reached for equilibrium in result} == {True, False}
    # crank up or down, the slider on either side: by symmetry the crank is perpendicular to the guide
    sides = set()
    for equilibrium in result:
        angle = equilibrium.q["crank"]
        slider = crank * np.cos(angle) + rod * np.cos(angle + equilibrium.q["A"])
        assert abs(np.cos(angle)) < 1e-9
        assert abs(slider) == pytest.approx(np.sqrt(rod**2 - crank**2), abs=1e-9)
        sides.add((equilibrium.reached, bool(slider > 0.0)))
    assert (True, True) in sides
    assert (True, False) not in sides
    assert (False, False) in sides


def test_each_motion_without_restoring_force_is_one_mode():
    free = ms.dynamics.modes(double_pendulum(), Forces())
    assert [mode.frequency for mode in free] == [0.0, 0.0]
    rigid, elastic = ms.dynamics.modes(double_pendulum(), Forces(joint_springs=(JointSpring("B", 2.0),)))
    assert rigid.frequency == 0.0
    assert abs(rigid.shape["B"]) < 1e-12
    assert elastic.frequency > 0.1


@pytest.mark.long
def test_each_dwell_of_a_cam_is_one_family_of_equilibria():
    cam = ms.load("cam_follower")
    dwells = ms.dynamics.equilibria(cam, WEIGHT)
    lowest = np.sqrt(0.038**2 - 0.005**2)
    assert [each.dimension for each in dwells] == [1, 1]
    assert [each.q["guide"] for each in dwells] == pytest.approx([lowest + 0.03, lowest + 0.042], abs=1e-12)
    # dwells of the law: -60 to 0 and 120 to 180 degrees
    assert all(-60.0 <= np.rad2deg(each.q["cam"]) % -180.0 <= 0.0 for each in dwells)
