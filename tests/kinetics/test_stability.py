"""Stability, modes and families of equilibria where frequencies and stiffnesses are far apart."""

import mpmath
import numpy as np
import pytest
from model_files import load_model

import mechsim as ms
from mechsim.numerics.differences import extrapolated_derivative
from mechsim.numerics.quadratic_roots import quadratic_roots
from mechsim.studies.dynamics_check import crosscheck_equilibrium


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
