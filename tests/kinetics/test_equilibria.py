"""Equilibria, holding efforts, natural frequencies and frequency response against closed solutions."""

import numpy as np
import pytest
from model_files import copied
from pendulums import WEIGHT

import mechsim as ms


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


SERVO = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body>
<joint name="j" axis="0 1 0" limited="true" range="-170 170"/>
<inertial pos="0.25 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>
<actuator><position joint="j" kp="50"/></actuator></mujoco>"""


@pytest.mark.parametrize("start", ["-10deg", "6deg", "170deg"])
def test_a_servo_has_one_equilibrium_whatever_the_start_and_its_stops(start):
    """The torque 50 N m/rad of a servo is not that after a revolution: 50 q = 9.81 (0.25) cos q."""
    (equilibrium,) = ms.dynamics.equilibria(
        ms.load(copied(SERVO, ".xml"), still=True), initial={"j.q": start}
    )
    assert 50.0 * equilibrium.q["j"] == pytest.approx(9.81 * 0.25 * np.cos(equilibrium.q["j"]), rel=1e-12)
    assert not equilibrium.stops


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
