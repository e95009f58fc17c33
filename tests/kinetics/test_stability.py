"""Stability, modes and families of equilibria where frequencies and stiffnesses are far apart."""

import mpmath
import numpy as np
import pytest
from model_files import FOLDER, model_text
from scipy.optimize import brentq

import mechsim as ms
from mechsim.numerics.differences import extrapolated_derivative
from mechsim.numerics.quadratic_roots import quadratic_roots
from mechsim.studies.dynamics_check import crosscheck_equilibrium

WEIGHT = "gravity = [0, -9.81, 0]\n"
# moment of inertia of the arm about its hinge, and the moment of its weight, in [kg m2] and [N m]
J, MOMENT = 0.35, 4.905


@pytest.fixture
def equilibria(tmp_path):
    def search(forces, start=0.0, links="", joints="", points=""):
        path = tmp_path / "arm.toml"
        path.write_text(
            model_text(
                "stability_arm.toml", forces=forces, start=start, links=links, joints=joints, points=points
            )
        )
        model = ms.dynamics.dynamic_model(ms.load(path, still=True))
        return model, ms.dynamics.equilibria(model)

    return search


def disc(name, parent, position):
    """Return a disc that turns freely about its centre of mass."""
    link = f"[links.{name}]\ninertia = {{ mass = 2.0, centre = [0, 0, 0], moments = [0.1, 0.1, 0.2] }}\n"
    sides = f'a = {{ link = "{parent}", at = {position} }}\nb = {{ link = "{name}" }}\n'
    joint = f'[joints.{name}]\nkind = "revolute"\n{sides}'
    return link, joint


@pytest.mark.long
@pytest.mark.parametrize("viscous", [300.0, 3e7, 1e-6])
def test_damping_does_not_hide_an_unstable_root(equilibria, viscous):
    model, (below, above) = equilibria(WEIGHT + f"friction.h = {{ viscous = {viscous} }}")
    assert below.stable is True
    assert above.stable is False
    with mpmath.workdps(40):
        for state, stiffness in ((below, MOMENT), (above, -MOMENT)):
            exact = sorted(mpmath.polyroots([stiffness, viscous, J], asc=True, extraprec=200), key=abs)
            modes = [mode.eigenvalue for mode in state.modes]
            for root, value in zip(exact, modes, strict=False):
                assert abs(complex(root).real - value.real) <= 1e-12 * abs(value)
            assert len(modes) == (2 if mpmath.im(exact[0]) == 0 else 1)
    for state in (below, above):
        assert crosscheck_equilibrium(state, model).passed


def test_the_current_of_a_motor_is_steady_in_both_methods(equilibria):
    # J s2 + (gear constant)2 / R s + moment = 0: without its inductance the motor damps
    gear, constant, resistance = 50.0, 0.05, 0.8
    motor = (
        f'motors.m = {{ kind = "dc", joint = "h", voltage = 0, resistance = {resistance}, inductance = 1e-3, '
        f"constant = {constant}, gear = {gear} }}"
    )
    model, (below, _) = equilibria(WEIGHT + motor)
    damping = (gear * constant) ** 2 / resistance
    exact = np.sort(np.roots([J, damping, MOMENT]).real)
    assert np.sort([mode.eigenvalue.real for mode in below.modes]) == pytest.approx(exact, rel=1e-12)
    assert crosscheck_equilibrium(below, model).passed


def test_friction_at_rest_is_left_out(equilibria):
    friction = "friction.h = { coulomb = 0.1, static = 0.2, stribeck = 0.1, viscous = 0.7 }"
    model, (below, _) = equilibria(WEIGHT + friction)
    exact = np.roots([J, 0.7, MOMENT])
    assert below.modes[0].eigenvalue.imag == pytest.approx(exact[0].imag, rel=1e-12)
    assert crosscheck_equilibrium(below, model).passed


def test_mujoco_has_the_frequencies_of_nearly_stretched_loops():
    model = ms.dynamics.dynamic_model(ms.load("planar_3rrr"), ms.Forces(gravity=(0.0, -9.81, 0.0)))
    for state in ms.dynamics.equilibria(model, starts=3):
        checks = [c for c in crosscheck_equilibrium(state, model).checks if "eigenvalue" in c.kind]
        # the largest is 177 1/s; with the stiffest loops alone it is 6 1/s off
        assert max(check.worst for check in checks) < 1e-5
        assert max(check.tolerance for check in checks) < 1e-2


def test_a_short_spring_has_its_frequency(equilibria):
    # K = k r1 r2 (L - L0) / L with lever arms r1 = 1, r2 = 1.003 and length L = 0.003
    _, (rest, _) = equilibria(
        'gravity = [0, 0, 0]\nsprings.s = { a = "tip", b = "near", stiffness = 100, rest = 0.0015 }',
        points='near = { link = "ground", at = [1.003, 0, 0] }',
    )
    exact = np.sqrt(100.0 * 1.003 * 0.5 / J) / (2.0 * np.pi)
    assert rest.modes[0].frequency == pytest.approx(exact, rel=1e-11)


def test_a_slow_mode_next_to_a_fast_one_is_kept(equilibria):
    link, joint = disc("rod", "arm", "[1, 0, 0]")
    _, states = equilibria(
        WEIGHT + "joint_springs.rod = { stiffness = 1e12 }", start=-1.5, links=link, joints=joint
    )
    assert [state.stable for state in states] == [True, False]
    # both links turn as one: moment of inertia 0.35 + 2 + 0.2, weight at 0.5 and 1 m
    slow = np.sqrt((MOMENT + 2.0 * 9.81) / (J + 2.2)) / (2.0 * np.pi)
    assert states[0].modes[0].frequency == pytest.approx(slow, rel=1e-9)
    assert states[0].modes[1].frequency > 1e5 * slow


@pytest.mark.long
@pytest.mark.parametrize("count", [2])
def test_freely_turning_discs_make_families_with_their_number_of_dimensions(equilibria, count):
    discs = [disc(f"d{k}", "arm", f"[{0.5 + 0.5 * k}, 0, 0]") for k in range(count)]
    links, joints = ("".join(texts) for texts in zip(*discs, strict=True))
    model, states = equilibria(WEIGHT, start=-1.2, links=links, joints=joints)
    assert [(state.stable, state.dimension) for state in states] == [(True, count), (False, count)]
    arms = 0.5 + 0.5 * np.arange(count)
    exact = np.sqrt((MOMENT + 2.0 * 9.81 * arms.sum()) / (J + 2.0 * (arms**2).sum())) / (2.0 * np.pi)
    frequencies = [mode.frequency for mode in states[0].modes]
    assert frequencies == pytest.approx([*[0.0] * count, exact], rel=1e-10)
    for state in states:
        assert crosscheck_equilibrium(state, model).passed


def test_an_arm_balanced_by_a_spring_is_at_rest_everywhere(equilibria):
    # a spring of zero rest length: k b l = m g c
    _, (state,) = equilibria(
        WEIGHT + 'springs.s = { a = "tip", b = "above", stiffness = 9.81 }',
        start=0.3,
        points='above = { link = "ground", at = [0, 0.5, 0] }',
    )
    assert state.everywhere
    assert state.dimension == 1


def test_a_stiffness_within_its_rounding_is_undecided(equilibria):
    # an upright arm at the critical stiffness of its spring: the potential has order four
    _, states = equilibria(
        WEIGHT + f"joint_springs.h = {{ stiffness = {MOMENT}, rest = {np.pi / 2.0} }}", start=1.2
    )
    upright = min(states, key=lambda state: abs(state.q["h"] - np.pi / 2.0))
    assert upright.q["h"] == pytest.approx(np.pi / 2.0, abs=1e-4)
    assert upright.stable is None
    assert upright.dimension == 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("angles", "length", "rest", "count"),
    [((0.4,), 1.002, 0.03, 4), ((0.4, 0.46), 1.002, 0.1, 6), ((0.4, 0.5, 0.62), 1.0005, 0.12, 8)],
)
def test_all_equilibria_of_an_arm_with_short_springs_are_found(equilibria, angles, length, rest, count):
    stiffness = (3e4, 5e4, 3e4)[: len(angles)]
    springs = "".join(
        f'springs.s{k} = {{ a = "tip", b = "p{k}", stiffness = {value}, rest = {rest} }}\n'
        for k, value in enumerate(stiffness)
    )
    positions = [(length * np.cos(angle), length * np.sin(angle)) for angle in angles]
    points = "".join(
        f'p{k} = {{ link = "ground", at = [{x}, {y}, 0] }}\n' for k, (x, y) in enumerate(positions)
    )

    def torque(q):
        total = -MOMENT * np.cos(q)
        for angle, value in zip(angles, stiffness, strict=True):
            distance = np.sqrt(1.0 + length**2 - 2.0 * length * np.cos(q - angle))
            total -= value * (distance - rest) / distance * length * np.sin(q - angle)
        return total

    grid = np.linspace(-np.pi, np.pi, 400_001)
    values = torque(grid)
    crossings = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    exact = [brentq(torque, grid[k], grid[k + 1], xtol=1e-15) for k in crossings]
    assert len(exact) == count
    _, states = equilibria(WEIGHT + springs, start=-1.0, points=points)
    assert sorted(state.q["h"] for state in states) == pytest.approx(exact, abs=1e-9)


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


def test_the_derivatives_of_a_controller_count(equilibria):
    # an upright arm under a controller of stiffness 20 N m and damping -3 N m s, unstable by its damping only
    forces = WEIGHT + 'controllers.h = "-20*(h.q - pi/2) + 3*h.v"\n'
    _, states = equilibria(forces, start=1.5)
    (upright,) = [state for state in states if abs(state.q["h"] - np.pi / 2.0) < 1e-9]
    exact = np.roots([J, -3.0, 20.0 - MOMENT])
    assert upright.stable is False
    assert upright.modes[0].eigenvalue == pytest.approx(exact[exact.imag > 0.0][0], rel=1e-12)


def test_a_load_over_the_crank_angle_changes_the_stiffness(equilibria):
    profile = ms.load_profile.function(lambda angle: 3.0 * np.sin(angle))
    model, _ = equilibria(WEIGHT)
    states = ms.dynamics.equilibria(
        model.mechanism, ms.Forces(gravity=(0.0, -9.81, 0.0), crank_torque=profile)
    )
    # 3 sin q - m g c cos q = 0, K = -(3 cos q + m g c sin q)
    angle = np.arctan2(MOMENT, 3.0)
    for state in states:
        assert np.sin(state.q["h"] - angle) == pytest.approx(0.0, abs=1e-10)
        stiffness = -(3.0 * np.cos(state.q["h"]) + MOMENT * np.sin(state.q["h"]))
        assert state.linear.stiffness[0, 0] == pytest.approx(stiffness, rel=1e-9)
        assert state.stable is bool(stiffness > 0.0)
    assert len(states) == 2


@pytest.mark.long
def test_a_light_table_under_a_heavy_load_has_the_frequencies_of_its_arms_in_mujoco():
    """With its base at 0 both arms swing as one: J = 2 (20 + 6.7) + 2 * 0.001 * 4 kg m2."""
    path = FOLDER / "stability_lift.toml"
    model = ms.dynamics.dynamic_model(ms.load(path, still=True))
    states = ms.dynamics.equilibria(model)
    assert sorted(state.stable for state in states) == [False, True]
    exact = np.sqrt((2.0 * 2000.0 + 9.81 * (2.0 * 20.0 + 2.0 * 0.002)) / 53.408)
    for state in states:
        assert np.abs(state.linear.roots.values).max() == pytest.approx(exact, rel=1e-9)
        verdict = crosscheck_equilibrium(state, model)
        assert verdict.passed, verdict
