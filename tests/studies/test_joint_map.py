"""Maps from motors to joints against closed forms; loop equations reject wrong maps."""

import json
from dataclasses import replace
from pathlib import Path

import mpmath
import mujoco
import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.state import rotation_vector_rates
from mechsim.studies.robots.joint_map import MapComparison, compare_with_loop_equations, joint_map

FOUR_BAR = Path(__file__).parents[2] / "models" / "four_bar.xml"
RANGE = {"crank": ("20deg", "80deg")}


@pytest.fixture(scope="module")
def four_bar():
    return ms.joint_map("four_bar", RANGE, ["rocker", "B.x", "rocker.rz"], points=21, degree=6)


def test_positions_and_derivatives_equal_the_closed_form(four_bar):
    exact = ms.load("four_bar").solve(four_bar.input[:, 0], 1.0)
    rocker, point = exact.joints["rocker"], exact.points["B"]
    np.testing.assert_allclose(four_bar.output[:, 0], rocker.value, atol=1e-13)
    np.testing.assert_allclose(four_bar.output[:, 1], point.position[:, 0], atol=1e-14)
    np.testing.assert_allclose(four_bar.jacobian[:, 0, 0], rocker.rate, atol=1e-13)
    np.testing.assert_allclose(four_bar.jacobian[:, 1, 0], point.velocity[:, 0], atol=1e-14)
    np.testing.assert_allclose(four_bar.jacobian[:, 2, 0], rocker.rate, atol=1e-13)
    np.testing.assert_allclose(four_bar.jacobian_derivative[:, 0, 0, 0], rocker.acceleration, atol=1e-10)


def test_reflected_inertia_gives_the_kinetic_energy(four_bar):
    model = ms.dynamics.dynamic_model(ms.load("four_bar"))
    forces = ms.dynamics.prescribed(model, four_bar.input[:, 0], speed=2.0)
    expected = 0.5 * four_bar.reflected_inertia[:, 0, 0] * 2.0**2
    np.testing.assert_allclose(forces.forces.kinetic, expected, rtol=1e-9)


def test_reported_polynomial_errors_hold_between_grid_points(four_bar):
    fit = four_bar.polynomials
    angles = np.linspace(*np.radians([20.0, 80.0]), 400)[:, None]
    exact = ms.load("four_bar").solve(angles[:, 0], 1.0).joints["rocker"]
    position = np.abs(fit.values(angles)[:, 0] - exact.value).max()
    torque = np.abs(fit.jacobian(angles)[:, 0, 0] - exact.rate).max()
    assert position == pytest.approx(fit.position_error[0], rel=0.2)
    assert position < 1e-4
    assert torque == pytest.approx(fit.torque_error[0], rel=0.3)


@pytest.mark.long
def test_loop_equations_accept_a_map_and_reject_a_wrong_one(four_bar):
    assert compare_with_loop_equations(four_bar, "four_bar").passed
    wrong = [replace(four_bar, jacobian=four_bar.jacobian + 1e-8)]
    wrong += [replace(four_bar, jacobian_derivative=four_bar.jacobian_derivative + 1e-8)]
    # an angle, a position and a rotation
    wrong += [replace(four_bar, output=four_bar.output + 1e-8 * np.eye(3)[i]) for i in range(3)]
    assert not any(compare_with_loop_equations(each, "four_bar").passed for each in wrong)
    assert not compare_with_loop_equations(four_bar, "four_bar", {"crank": "31mm"}).passed


def test_a_hinge_may_be_called_as_a_coordinate_is(tmp_path):
    named = Path(tmp_path, "named.xml")
    named.write_text(FOUR_BAR.read_text().replace('name="rocker"', 'name="B.x"'))
    table = ms.joint_map(str(named), RANGE, ["B.x"], points=5)
    exact = ms.load("four_bar").solve(table.input[:, 0], 1.0)
    np.testing.assert_allclose(table.output[:, 0], exact.joints["rocker"].value, atol=1e-13)
    assert compare_with_loop_equations(table, str(named)).passed


def test_differences_that_are_no_numbers_are_no_agreement():
    assert MapComparison(9, 0.0, 0.0, 0.0).passed
    for values in ((np.nan, 0.0, 0.0), (0.0, np.nan, 0.0), (0.0, 0.0, np.nan)):
        assert not MapComparison(9, *values).passed


# a four-bar on a turntable whose angle no input determines; the numbers of its pin are rounded
TURNTABLE = model_text("joint_map_turntable.xml")


def test_a_motor_left_out_stays_where_it_is():
    spec = mujoco.MjSpec.from_string(TURNTABLE)
    table = joint_map(spec, {"crank": (-0.2, 0.2)}, ["rocker", "coupler.ry"], points=5)
    # least squares on MuJoCo's own constraint residuals, from the crank at -0.2 to 0.2 rad
    exact = [0.034564, 0.012727, 0.000002, -0.004013, 0.000054]
    np.testing.assert_allclose(table.output[:, 0], exact, atol=1e-6)
    assert compare_with_loop_equations(table, spec).passed


def test_jacobian_derivatives_are_exact_near_a_dead_centre():
    # the crank of a slider-crank as a function of the slide is singular at its dead centre
    spec = mujoco.MjSpec.from_string(ms.export("slider_crank", scene="dynamics").text)
    reach = np.sqrt(0.25**2 - 0.01**2)
    table = ms.joint_map(spec, {"slide": (reach - 1e-3, reach - 2e-5)}, ["crank"], points=2)

    def angle(x):  # by the law of cosines
        crank, rod, offset = (mpmath.mpf(text) for text in ("0.05", "0.2", "0.01"))
        distance = mpmath.sqrt(x**2 + offset**2)
        return mpmath.atan2(offset, x) - mpmath.acos(
            (distance**2 + crank**2 - rod**2) / (2 * distance * crank)
        )

    with mpmath.workdps(40):
        expected = [float(mpmath.diff(angle, mpmath.mpf(float(x)), 2)) for x in table.input[:, 0]]
    np.testing.assert_allclose(table.jacobian_derivative[:, 0, 0, 0], expected, rtol=1e-9)


def test_rates_of_rotation_vectors_equal_finite_differences():
    from scipy.spatial.transform import Rotation

    vectors = np.array([[0.3, -0.8, 0.4], [1e-5, 2e-5, 0.0], [0.0, 0.0, 0.0], [2.0, 1.0, -1.5]])
    angular = np.array([0.7, -0.2, 0.5])
    step = 1e-6
    sides = [
        (Rotation.from_rotvec(sign * step * angular) * Rotation.from_rotvec(vectors)).as_rotvec()
        for sign in (1, -1)
    ]
    expected = (sides[0] - sides[1]) / (2 * step)
    np.testing.assert_allclose(rotation_vector_rates(vectors) @ angular, expected, atol=1e-9)


def test_a_map_of_one_configuration_has_its_rotation():
    table = ms.joint_map("four_bar", {"rocker": ("96deg", "300deg")}, ["rocker.rz"], points=2)
    assert len(table.input) == 1
    np.testing.assert_allclose(table.output[:, 0], table.input[:, 0] - table.reference[0], atol=1e-13)


TWO_MOTORS = model_text("joint_map_two_motors.xml")


@pytest.mark.long
def test_holding_torques_equal_energy_derivatives():
    model = mujoco.MjModel.from_xml_string(TWO_MOTORS)
    table = ms.joint_map(model, ["left", "right"], ["tip.x", "tip.y"], points=7)
    assert table.jacobian.shape == (len(table.input), 2, 2)
    assert 0 < table.reached <= 1
    data = mujoco.MjData(model)
    inner = np.flatnonzero((np.abs(table.input - [1.95, 1.15]) < 0.3).all(1))
    assert len(inner) > 3
    # each motor displaced to either side of each configuration
    step = 1e-6
    displaced = table.qpos[inner][:, None, [0, 2]] + step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    energies = []
    for qpos in ms.closed_qpos(model, dict(zip(table.inputs, displaced.reshape(-1, 2).T, strict=True))):
        data.qpos[:], data.qvel[:] = qpos, 0.0
        mujoco.mj_forward(model, data)
        mujoco.mj_energyPos(model, data)
        energies.append(data.energy[0])
    sides = np.reshape(energies, (-1, 2, 2))
    by_energy = (sides[..., 0] - sides[..., 1]) / (2 * step)
    np.testing.assert_allclose(table.holding_torque[inner], by_energy, atol=1e-6)
    product = np.swapaxes(table.jacobian, 1, 2) @ table.torque_map
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(2), product.shape), atol=1e-9)


def test_the_command_writes_arrays_and_reports_their_errors(tmp_path, mechsim):
    output = tmp_path / "map.npz"
    line = ["map", "four_bar", "--from", "crank=20deg:80deg", "--to", "rocker", "--degree", "4"]
    answer = mechsim(*line, "-o", str(output), "--json")
    report = json.loads(answer.out)
    assert report["passed"]
    assert report["differences"]["output"] < 1e-12
    with np.load(output) as arrays:
        assert arrays["jacobian"].shape == (21, 1, 1)
        assert arrays["polynomial_coefficients"].shape == (1, 5)


def test_a_floating_base_stays_where_it_is():
    arm = '<joint name="{0}" axis="0 0 1"/><geom size="0.01"/>'
    spec = mujoco.MjSpec.from_string(
        f"""<mujoco><worldbody><body name="chassis" pos="0 0 0.2"><freejoint/><geom size="0.1"/>
        <body pos="0.3 0.25 0">{arm.format("left")}<body name="tie" pos="-0.1 -0.04 0">{arm.format("tie")}
        </body></body><body name="right_arm" pos="0.3 -0.25 0">{arm.format("right")}</body></body></worldbody>
        <equality><connect body1="tie" body2="right_arm" anchor="0 -0.42 0"/></equality></mujoco>"""
    )
    table = joint_map(spec, {"left": ("-24.5deg", "35deg")}, ["right"], points=3)
    # law of cosines of the four-bar 0.107703, 0.42, 0.107703, 0.5 m
    assert np.rad2deg(table.output[[0, -1], 0]) == pytest.approx([-32.494, 25.696], abs=5e-4)
    assert compare_with_loop_equations(table, spec).passed
