"""Serial equivalents in MJCF and URDF move as the closed model within their stated errors."""

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.studies.robots.serial_twin import serial_twin

RANGE = {"crank": ("20deg", "80deg")}
FORMATS = ("mjcf-tree", "urdf")


def closed(names, angles):
    """Return joint coordinates of the closed four-bar at crank angles."""
    model = mujoco.MjModel.from_xml_string(ms.export("four_bar", scene="dynamics").text)
    qpos = ms.closed_qpos(model, {"crank": angles})
    return np.stack([qpos[:, model.joint(name).qposadr[0]] for name in names], 1)


@pytest.mark.parametrize("format", FORMATS)
def test_couplings_follow_the_loops_within_their_stated_errors(format):
    equivalent = serial_twin("four_bar", format, independent=RANGE)
    model = mujoco.MjModel.from_xml_string(equivalent.text)
    angles = np.radians(np.linspace(20, 80, 31))
    names = [joint.joint for joint in equivalent.coupled]
    expected = closed(names, angles)
    assert equivalent.left_out
    for i in range(model.neq):
        first, second = (model.joint(int(number)).name for number in (model.eq_obj1id[i], model.eq_obj2id[i]))
        x = angles - model.joint(second).qpos0[0]
        y = sum(model.eq_data[i, k] * x**k for k in range(5)) + model.joint(first).qpos0[0]
        index = names.index(first)
        error = np.abs(y - expected[:, index]).max()
        assert error <= equivalent.coupled[index].position_error * 1.05
        assert error >= 0.5 * equivalent.coupled[index].position_error


@pytest.mark.parametrize("format", FORMATS)
def test_body_poses_and_masses_of_the_tree_equal_the_closed_model(format):
    source = mujoco.MjModel.from_xml_string(ms.export("four_bar", scene="dynamics").text)
    equivalent = mujoco.MjModel.from_xml_string(serial_twin("four_bar", format, independent=RANGE).text)
    item, other = mujoco.MjData(source), mujoco.MjData(equivalent)
    for i in range(source.njnt):
        name = source.joint(i).name
        item.joint(name).qpos[:] = other.joint(name).qpos[:] = 0.3 * (i + 1)
    for model, data in ((source, item), (equivalent, other)):
        mujoco.mj_forward(model, data)
    for body in range(1, source.nbody):
        name = source.body(body).name
        np.testing.assert_allclose(other.body(name).xipos, item.body(name).xipos, atol=1e-12)
        assert equivalent.body(name).mass[0] == pytest.approx(source.body(name).mass[0], rel=1e-12)
        moments = np.sort(source.body(name).inertia)
        np.testing.assert_allclose(np.sort(equivalent.body(name).inertia), moments, rtol=1e-9)


def test_two_independent_joints_are_coupled_by_tendons():
    equivalent = serial_twin(
        "five_bar", "mjcf-tree", independent={"left": ("115deg", "125deg"), "right": ("55deg", "65deg")}
    )
    model = mujoco.MjModel.from_xml_string(equivalent.text)
    assert model.ntendon == 2 * len(equivalent.coupled)
    data = mujoco.MjData(model)
    data.joint("left").qpos[:], data.joint("right").qpos[:] = np.radians([118.0, 61.0])
    expected = mujoco.MjModel.from_xml_string(ms.export("five_bar", scene="dynamics").text)
    qpos = ms.closed_qpos(expected, {"left": np.radians(118.0), "right": np.radians(61.0)})[0]
    for joint in equivalent.coupled:
        data.joint(joint.joint).qpos[:] = qpos[expected.joint(joint.joint).qposadr[0]]
    mujoco.mj_forward(model, data)
    rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert np.abs(data.efc_pos[rows]).max() <= max(joint.position_error for joint in equivalent.coupled)


def test_inaccurate_couplings_are_reported_with_a_remedy():
    coarse = ms.export("four_bar", format="urdf", independent={"crank": ("20deg", "80deg")})
    assert "give a smaller range" in coarse.twin.summary()
    fine = ms.export("four_bar", format="mjcf-tree", independent={"crank": ("40deg", "50deg")})
    assert "give a smaller range" not in fine.twin.summary()
    with pytest.raises(ms.InputError, match="--lock"):
        ms.export("four_bar", format="urdf", independent={"crank": ("20deg", "80deg")}, lock=["crank"])
