"""Equilibria, holding efforts, natural frequencies and frequency response against closed solutions."""

import mpmath
import numpy as np
import pytest
from model_files import copied, load_model
from pendulums import WEIGHT

import mechsim as ms
from mechsim.numerics.differences import extrapolated_derivative
from mechsim.numerics.quadratic_roots import quadratic_roots
from mechsim.studies.dynamics_check import crosscheck_equilibrium


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


def test_mujoco_has_the_frequencies_of_nearly_stretched_loops():
    model = ms.dynamics.dynamic_model(ms.load("planar_3rrr"), ms.Forces(gravity=(0.0, -9.81, 0.0)))
    for state in ms.dynamics.equilibria(model, starts=3):
        checks = [c for c in crosscheck_equilibrium(state, model).checks if "eigenvalue" in c.kind]
        # the largest is 177 1/s; with the stiffest loops alone it is 6 1/s off
        assert max(check.worst for check in checks) < 1e-5
        assert max(check.tolerance for check in checks) < 1e-2


def test_a_stiffness_within_its_rounding_is_undecided():
    # an upright arm at the critical stiffness of its spring: the potential has order four
    forces = f"gravity = [0, -9.81, 0]\njoint_springs.h = {{ stiffness = 4.905, rest = {np.pi / 2.0} }}"
    texts = {"forces": forces, "start": 1.2, "links": "", "joints": "", "points": ""}
    states = ms.dynamics.equilibria(load_model("stability_arm.toml", still=True, **texts))
    upright = min(states, key=lambda state: abs(state.q["h"] - np.pi / 2.0))
    assert upright.q["h"] == pytest.approx(np.pi / 2.0, abs=1e-4)
    assert upright.stable is None
    assert upright.dimension == 0


def test_roots_have_error_bounds_that_hold():
    random = np.random.default_rng(3)
    for scale in (1e-9, 1.0, 1e9):
        damping, stiffness = (matrix @ matrix.T for matrix in random.normal(size=(2, 3, 3)))
        damping *= scale
        result = quadratic_roots(damping, stiffness, 0.0 * stiffness)
        with mpmath.workdps(60):
            c, k = mpmath.matrix(damping.tolist()), mpmath.matrix(stiffness.tolist())
            companion = mpmath.zeros(6)
            for i in range(3):
                companion[i, 3 + i] = 1
                for j in range(3):
                    companion[3 + i, j], companion[3 + i, 3 + j] = -k[i, j], -c[i, j]
            exact = np.array([complex(value) for value in mpmath.eig(companion, left=False, right=False)])
        for value, error in zip(result.values, result.errors, strict=True):
            assert np.abs(exact - value).min() <= error
            assert error <= 1e-6 * abs(value)


def test_a_derivative_has_an_error_estimate_that_holds():
    for width in (1.0, 1e-3):
        value, error = extrapolated_derivative(
            lambda h, width=width: (np.tanh((0.3 * width + h) / width) - np.tanh(0.3 - h / width)) / (2.0 * h)
        )
        exact = 1.0 / np.cosh(0.3) ** 2 / width
        assert abs(value - exact) <= max(4.0 * error, 1e-13 * exact)
        assert error <= 1e-6 * exact
