"""Rounded angles between axes, such as 1.57 for pi/2, do not lock loops that move with exact ones."""

import mujoco
import numpy as np
import pytest
from model_files import changed_model, copied, load_model, model_text
from scipy.optimize import least_squares

import mechsim as ms
from mechsim.io.mjcf_source import read_mjcf
from mechsim.io.mujoco_inputs import mujoco_input

# a parallelogram of 0.2 m x 0.1 m whose second link is turned about x
# text of the rotation and the axis in the turned frame, the lower end of the foot, and the error in [rad]
ROUNDED = {
    "pi/2": ('euler="1.57 0 0"', "0 1 0", "0 0 -0.1", np.pi / 2 - 1.57),
    "pi": ('euler="3.14 0 0"', "0 0 -1", "0 -0.1 0", np.pi - 3.14),
    "pi/4": ('euler="0.785 0 0"', "0 1 1", "0 0.0707 -0.0707", np.pi / 4 - 0.785),
    "quaternion": (
        'quat="0.924 0.383 0 0"',
        "0 1 1",
        "0 0.0707 -0.0707",
        2.0 * np.arctan2(0.383, 0.924) - np.pi / 4,
    ),
    "axis": ("", "0 0.0008 1", "0 0.1 0", 0.0008),
    "two decimals": ('euler="0.79 0 0"', "0 1 1", "0 0.0707 -0.0707", 0.79 - np.pi / 4),
    "five digits": ('euler="1.5708 0 0"', "0 1 0", "0 0 -0.1", 1.5708 - np.pi / 2),
}


def leg(rotation: str, axis: str, foot: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(
        model_text("rounded_angles_leg.xml", rotation=rotation, axis=axis, foot=foot)
    )


def least_gap(spec: mujoco.MjSpec, calf: float) -> float:
    """Return MuJoCo's least gap of the loop at an angle of the calf, in [m]."""
    model = spec.compile()
    data = mujoco.MjData(model)

    def gap(passive):
        data.qpos[:] = (calf, *passive)
        mujoco.mj_fwdPosition(model, data)
        return data.efc_pos[:3].copy()

    return float(np.linalg.norm(least_squares(gap, [-calf, calf], xtol=1e-14, gtol=1e-14).fun))


@pytest.mark.long
@pytest.mark.parametrize("name", ROUNDED)
def test_loops_with_a_rounded_angle_move(name):
    rotation, axis, foot, error = ROUNDED[name]
    spec = leg(rotation, axis, foot)
    solver = read_mjcf(spec)
    (note,) = (fact for fact in solver.facts if "deg off" in fact)
    assert float(note.split(" deg off")[0].split()[-1]) == pytest.approx(np.rad2deg(abs(error)), rel=6e-3)
    stated = float(note.split("least gap ")[1].split()[0])
    assert stated == pytest.approx(least_gap(spec, 0.5), rel=0.06)
    angles = np.linspace(-0.5, 0.5, 5)
    motion = solver.solve(angles)
    # the sides of a parallelogram stay parallel
    np.testing.assert_allclose(motion.joints["shin"].value, angles, atol=1e-4)
    np.testing.assert_allclose(motion.joints["ankle"].value, -angles, atol=1e-4)


def test_a_small_error_is_a_note():
    """MuJoCo's soft constraints move a loop with a gap of 0.1 um."""
    rotation, axis, foot, _ = ROUNDED["five digits"]
    rounded = [finding for finding in ms.check(leg(rotation, axis, foot)) if "deg off" in finding.message]
    assert [finding.severity for finding in rounded] == ["note"]


# the same parallelogram, its second axis tilted by pi/2 - 1.57


@pytest.mark.long
def test_a_toml_file_moves_in_every_study():
    path = changed_model("rounded_angles_four_bar.toml", tilt=-0.00079633)
    solver = ms.load(path)
    assert any("0.0456 deg off parallel; least gap" in fact for fact in solver.facts)
    angles = np.linspace(-0.5, 0.5, 5)
    np.testing.assert_allclose(solver.solve(angles).joints["shin"].value, angles, atol=1e-12)
    assert ms.validate(solver).passed
    assert ms.sample(path, 20).residual.max() < 1e-12
    shin = ms.joint_map(path, {"calf": (-0.5, 0.5)}, ["shin"], points=5)
    np.testing.assert_allclose(shin.output[:, 0], shin.input[:, 0], atol=1e-9)
    assert "0.0456 deg" in next(item.message for item in ms.check(path) if item.severity == "warning")
    assert load_model("rounded_angles_four_bar.toml", tilt=0.0).facts == ()
    with pytest.raises(ms.MechsimError):
        load_model("rounded_angles_four_bar.toml", tilt=0.01).solve(angles)


# a planar four-bar whose frames are turned by 1.57 and 3.14; its loop closes with a hinge
URDF = model_text("rounded_angles_urdf.urdf")
LINK = '<link name="{}"><inertial><mass value="1"/>{}</inertial></link>'
INERTIA = '<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>'


def test_a_urdf_file_moves_in_both_methods():
    links = "".join(LINK.format(name, INERTIA) for name in "abc")
    states = ms.sample(copied(URDF.format(links=links), ".urdf"), 20)
    assert states.residual.max() < 1e-12
    assert np.ptp(states.qpos[:, 0]) > 0.5
    # law of cosines in the plane: a from (0, 0), length hypot(0.1, 0.05); c from (0.3, 0), length 0.2; b 0.2
    m, k = states.qpos[:, 0], states.qpos[:, 1]
    pivot = np.stack([np.cos(m) * 0.1 - np.sin(m) * 0.05, np.sin(m) * 0.1 + np.cos(m) * 0.05], 1)
    end = pivot + 0.2 * np.stack([np.cos(m + k), np.sin(m + k)], 1)
    np.testing.assert_allclose(np.hypot(end[:, 0] - 0.3, end[:, 1]), 0.2, atol=2e-4)


def test_the_crank_of_a_toml_file_keeps_its_name():
    path = changed_model("rounded_angles_four_bar.toml", tilt=0.0)
    assert ms.closed_qpos(path, {"calf": 0.3})[0] == pytest.approx([0.3, -0.3, 0.3], abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("angle", [1.564, 1.578, np.pi / 2])
def test_other_angles_remain_as_written(angle):
    """An error of 0.4 deg is no rounding, and exact angles need no correction."""
    spec = leg(f'euler="{angle!r} 0 0"', "0 1 0", "0 0 -0.1")
    assert mujoco_input(spec) is spec
    assert not any("deg off" in fact for fact in read_mjcf(spec).facts)
