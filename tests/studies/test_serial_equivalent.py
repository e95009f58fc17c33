"""Serial twins move as the closed model within the errors they state, in MJCF and as URDF."""

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
def test_couplings_follow_the_loops_within_their_errors(format):
    twin = serial_twin("four_bar", format, independent=RANGE)
    model = mujoco.MjModel.from_xml_string(twin.text)
    angles = np.radians(np.linspace(20, 80, 31))
    names = [joint.joint for joint in twin.coupled]
    expected = closed(names, angles)
    assert twin.left_out
    for i in range(model.neq):
        first, second = (model.joint(int(number)).name for number in (model.eq_obj1id[i], model.eq_obj2id[i]))
        x = angles - model.joint(second).qpos0[0]
        y = sum(model.eq_data[i, k] * x**k for k in range(5)) + model.joint(first).qpos0[0]
        index = names.index(first)
        error = np.abs(y - expected[:, index]).max()
        assert error <= twin.coupled[index].position_error * 1.05
        assert error >= 0.5 * twin.coupled[index].position_error


@pytest.mark.parametrize("format", FORMATS)
def test_the_tree_has_the_bodies_where_the_closed_model_has_them(format):
    source = mujoco.MjModel.from_xml_string(ms.export("rssr", scene="dynamics").text)
    source = mujoco.MjModel.from_xml_string(ms.export("four_bar", scene="dynamics").text)
    twin = mujoco.MjModel.from_xml_string(serial_twin("four_bar", format, independent=RANGE).text)
    item, other = mujoco.MjData(source), mujoco.MjData(twin)
    for i in range(source.njnt):
        name = source.joint(i).name
        item.joint(name).qpos[:] = other.joint(name).qpos[:] = 0.3 * (i + 1)
    for model, data in ((source, item), (twin, other)):
        mujoco.mj_forward(model, data)
    for body in range(1, source.nbody):
        name = source.body(body).name
        np.testing.assert_allclose(other.body(name).xipos, item.body(name).xipos, atol=1e-12)
        assert twin.body(name).mass[0] == pytest.approx(source.body(name).mass[0], rel=1e-12)
        moments = np.sort(source.body(name).inertia)
        np.testing.assert_allclose(np.sort(twin.body(name).inertia), moments, rtol=1e-9)


def test_two_independent_joints_are_coupled_by_tendons():
    twin = serial_twin(
        "five_bar", "mjcf-tree", independent={"left": ("115deg", "125deg"), "right": ("55deg", "65deg")}
    )
    model = mujoco.MjModel.from_xml_string(twin.text)
    assert model.ntendon == 2 * len(twin.coupled)
    data = mujoco.MjData(model)
    data.joint("left").qpos[:], data.joint("right").qpos[:] = np.radians([118.0, 61.0])
    expected = mujoco.MjModel.from_xml_string(ms.export("five_bar", scene="dynamics").text)
    qpos = ms.closed_qpos(expected, {"left": np.radians(118.0), "right": np.radians(61.0)})[0]
    for joint in twin.coupled:
        data.joint(joint.joint).qpos[:] = qpos[expected.joint(joint.joint).qposadr[0]]
    mujoco.mj_forward(model, data)
    rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert np.abs(data.efc_pos[rows]).max() <= max(joint.position_error for joint in twin.coupled)


@pytest.mark.parametrize(
    ("model", "options", "message"),
    [
        ("four_bar", {"independent": {"wheel": ("0deg", "10deg")}}, "wheel"),
        ("four_bar", {"independent": {"crank": None}}, "no limits"),
        ("four_bar", {}, "no actuator"),
        ("four_bar", {"loops": "loops.yaml"}, "need the path of a URDF file|no URDF"),
        ("stewart_gough", {"independent": {f"l{i}": ("150mm", "151mm") for i in range(1, 7)}}, "ball"),
    ],
)
def test_what_has_no_twin_ends_in_one_sentence(model, options, message):
    with pytest.raises(ms.MechsimError, match=message):
        serial_twin(model, "urdf", **options)


def test_coarse_couplings_come_with_a_remedy_and_other_options_are_rejected():
    coarse = ms.export("four_bar", format="urdf", independent={"crank": ("20deg", "80deg")})
    assert "give a smaller range" in coarse.twin.summary()
    fine = ms.export("four_bar", format="mjcf-tree", independent={"crank": ("40deg", "50deg")})
    assert "give a smaller range" not in fine.twin.summary()
    with pytest.raises(ms.InputError, match="--lock"):
        ms.export("four_bar", format="urdf", independent={"crank": ("20deg", "80deg")}, lock=["crank"])
