"""SDF and USD files: what mechsim writes has the same loops when read; those of others are read."""

import re

import numpy as np
import pytest
from model_files import changed_model, copied, load_model, model_text

from mechsim import dynamics
from mechsim.errors import InputError
from mechsim.io import catalog, gallery
from mechsim.io.readers import load
from mechsim.kinematics.loops.mobility import dof_count
from mechsim.kinematics.loops.start import start_poses
from mechsim.mechanism.links import Pose
from mechsim.studies.export import export

# couplings by a function, and a rope
FORMATS = ("sdf", "usda")
NOT_LINEAR = {"cam_follower", "geneva_drive", "hoist"}
NAMES = [name for name in (*catalog.MECHANISMS, *gallery.files()) if name not in NOT_LINEAR]


def mobility(solver):
    poses = start_poses(solver.mechanism)[0]
    sample = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in poses.items()}
    return dof_count(solver.mechanism, sample).mobility


@pytest.mark.long
@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("name", NAMES)
def test_a_written_mechanism_has_the_same_mobility_and_points(name, format, tmp_path):
    exact = load(name)
    export(exact, tmp_path / f"m.{format}", format=format)
    read = load(tmp_path / f"m.{format}", still=True)
    assert mobility(read) == mobility(exact)
    assert read.mechanism.drivers == exact.mechanism.drivers
    assert read.mechanism.points.keys() == exact.mechanism.points.keys()
    starts, poses = (start_poses(solver.mechanism)[0] for solver in (exact, read))
    for link, pose in starts.items():
        assert np.abs(pose.position - poses[link].position).max() <= 1e-12
        assert np.abs(pose.rotation - poses[link].rotation).max() <= 1e-12


@pytest.mark.long
@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize(
    "name",
    ["four_bar", "rssr", "looper", "warp_knitter", "planetary_gear", "rack_steering", "rsur", "quick_return"],
)
def test_a_written_mechanism_moves_alike_over_a_revolution(name, format, tmp_path):
    exact = load(name)
    export(exact, tmp_path / f"m.{format}", format=format)
    read = load(tmp_path / f"m.{format}")
    angles = exact.mechanism.start + np.linspace(0.0, 2.0 * np.pi if exact.crank_range().full else 0.4, 37)
    before, after = exact.solve(angles, 3.0), read.solve(angles, 3.0)
    for point, motion in before.points.items():
        assert np.abs(motion.position - after.points[point].position).max() <= 1e-12
        scale = np.abs(motion.acceleration).max() + 1e-3
        assert np.abs(motion.acceleration - after.points[point].acceleration).max() <= 1e-9 * scale


def test_without_its_own_elements_a_file_has_the_same_loops_and_joints_at_zero(tmp_path):
    exact = load("slider_crank")
    text = export(exact, format="sdf").text
    plain = re.sub(r"<mechsim:.*?</mechsim:\w+>|mechsim:name=\".*?\"", "", text)
    (tmp_path / "m.sdf").write_text(plain)
    read = load(tmp_path / "m.sdf", drive={"crank_joint": "1*t"}, duration=1.0)
    start = exact.mechanism.start
    times = np.linspace(0.0, 1.0, 9)
    before, after = exact.solve(start + times, 1.0), read.solve(t=times)
    assert after.joints["crank_joint"].value[0] == 0.0
    for point, motion in before.points.items():
        gap = (
            motion.position
            - after.points[f"{point}_frame" if f"{point}_frame" in after.points else point].position
        )
        assert np.abs(gap).max() <= 1e-12


@pytest.mark.parametrize(("format", "coulomb"), [("sdf", 0.5), ("usda", 0.0)])
def test_friction_springs_limits_and_gravity_return(format, coulomb, tmp_path):
    friction = f"{{ viscous = 2.0, coulomb = {coulomb} }}"
    forces = f"[forces]\ngravity = [0, 0, -9.81]\nfriction.slide = {friction}\n"
    forces += "[forces.joint_springs.crank]\nstiffness = 3.0\nrest = 0.4\n"
    exact = load_model("slider_crank", more=forces)
    export(exact, tmp_path / f"m.{format}", format=format)
    read = load(tmp_path / f"m.{format}")
    assert read.ranges == exact.ranges
    torques = [
        dynamics.prescribed(dynamics.dynamic_model(solver), np.linspace(0.2, 6.0, 50), 5.0).forces.torque
        for solver in (exact, read)
    ]
    assert torques[1] == pytest.approx(torques[0], abs=1e-12)


def test_what_sdf_does_not_have_is_stated():
    text = export("rack_steering", format="toml").text
    joint = next(joint.name for joint in load("rack_steering").mechanism.joints if joint.name != "pinion")
    text = text.replace('driver = "pinion"', f"driver = {{ pinion = 1.0, {joint} = 0.0 }}")
    with pytest.raises(InputError, match="is not linear between two joints"):
        export(copied(text.replace("pressure_angle = 0.0", "")), format="sdf")
    with pytest.raises(InputError, match="joint contact is on a cam, which"):
        export("cam_follower", format="sdf")
    assert "motion laws" in export("delta_robot", format="sdf").left_out
    with pytest.raises(InputError, match="--scene, --speed and settings are for MuJoCo models"):
        export("four_bar", format="sdf", speed="600rpm")
    path = changed_model("slider_crank", more="[forces]\nfriction.slide = { coulomb = 2.0 }")
    assert "constant friction" in export(path, format="usda").left_out


# a crank about x at the height 0.5 m, in cm and g, y up; its group is rotated and scaled
CRANK = model_text("sdf_and_usd_crank.usda")


def test_mimics_and_binary_files_of_usd_are_read(tmp_path):
    from pxr import Usd

    mimic = (
        "rel newton:mimicJoint = </rig/shaft>\nfloat newton:mimicCoef0 = 90\nfloat newton:mimicCoef1 = -2\n"
    )
    pin = "rel physics:body0 = </rig/group/crank/pin>"
    follower = CRANK.replace(pin, mimic + pin).replace('"PhysicsLimitAPI:rotY"]', '"NewtonMimicAPI"]')
    binary = tmp_path / "crank.usdc"
    stage = Usd.Stage.Open(copied(follower, ".usda"))
    stage.GetRootLayer().Export(str(binary))
    moved = load(binary, drive={"shaft": "0.1*t"}, duration=1.0).solve(t=[0.0, 1.0])
    assert moved.joints["wrist"].value == pytest.approx([np.pi / 2, np.pi / 2 - 0.2], abs=1e-12)


def test_a_body_without_joints_floats_and_a_link_may_be_called_physics(tmp_path):
    text = 'name = "top"\n[links.physics]\n'
    text += "inertia = { mass = 2.0, centre = [0, 0, 0], moments = [1.0, 1.0, 1.0] }\n"
    text += '[joints.free]\nkind = "floating"\na = { link = "ground" }\nb = { link = "physics" }\n'
    export(copied(text), tmp_path / "top.usda", format="usda")
    (joint,) = load(tmp_path / "top.usda", still=True).mechanism.joints
    assert (joint.kind, joint.links) == ("floating", ("ground", "physics"))
