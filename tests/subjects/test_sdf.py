"""SDF files: what mechsim writes has the same loops when read; poses, frames and axes of others are read."""

import re

import numpy as np
import pytest

from mechsim import dynamics
from mechsim.analytic.loops.mobility import dof_count
from mechsim.analytic.loops.start import start_poses
from mechsim.errors import InputError
from mechsim.model.links import Pose
from mechsim.studies.export import export
from mechsim.subjects import catalog, gallery
from mechsim.subjects.readers import load

# couplings by a function, and a rope
NOT_LINEAR = {"cam_follower", "geneva_drive", "hoist"}
NAMES = [name for name in (*catalog.MECHANISMS, *gallery.files()) if name not in NOT_LINEAR]

# a pendulum of two links, hinged at 0.5 m and 0.3 m: frames, angles in degrees and a rotated axis
ARM = """<sdf version="1.9"><model name="arm"><pose>1 0 0 0 0 0</pose>
<frame name="hinge" attached_to="upper"><pose degrees="true">0.3 0 0 90 0 0</pose></frame>
<link name="upper"><pose>0 0 0.5 0 0 0</pose><inertial>
<pose>0.1 0 0 0 0 1.5707963267948966</pose><mass>2</mass>
<inertia><ixx>0.01</ixx><iyy>0.02</iyy><izz>0.025</izz></inertia></inertial><visual name="v"/></link>
<link name="fore"><pose relative_to="hinge">0 0 0 0 0 0</pose></link>
<joint name="shoulder" type="revolute"><parent>world</parent><child>upper</child><axis><xyz>0 2 0</xyz>
<limit><lower>-1</lower><upper>2</upper></limit><dynamics><damping>0.3</damping><friction>0.1</friction>
<spring_reference>0.2</spring_reference><spring_stiffness>5</spring_stiffness></dynamics></axis></joint>
<joint name="elbow" type="continuous"><parent>hinge</parent><child>fore</child><axis><xyz>0 0 1</xyz>
<mimic joint="shoulder"><multiplier>-2</multiplier><offset>0.1</offset><reference>0.4</reference></mimic>
</axis></joint></model></sdf>"""


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.sdf"
    path.write_text(ARM)
    return path


def mobility(solver):
    poses = start_poses(solver.mechanism)[0]
    sample = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in poses.items()}
    return dof_count(solver.mechanism, sample).mobility


@pytest.mark.parametrize("name", NAMES)
def test_a_written_mechanism_has_the_same_mobility_and_points(name, tmp_path):
    exact = load(name)
    export(exact, tmp_path / "m.sdf", format="sdf")
    read = load(tmp_path / "m.sdf", still=True)
    assert mobility(read) == mobility(exact)
    assert read.mechanism.drivers == exact.mechanism.drivers
    assert read.mechanism.points.keys() == exact.mechanism.points.keys()
    starts, poses = (start_poses(solver.mechanism)[0] for solver in (exact, read))
    for link, pose in starts.items():
        assert np.abs(pose.position - poses[link].position).max() <= 1e-12
        assert np.abs(pose.rotation - poses[link].rotation).max() <= 1e-12


@pytest.mark.parametrize(
    "name",
    ["four_bar", "rssr", "looper", "warp_knitter", "planetary_gear", "rack_steering", "rsur", "quick_return"],
)
def test_a_written_mechanism_moves_alike_over_a_revolution(name, tmp_path):
    exact = load(name)
    export(exact, tmp_path / "m.sdf", format="sdf")
    read = load(tmp_path / "m.sdf")
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


def test_friction_springs_limits_and_gravity_return(tmp_path):
    path = tmp_path / "slider.toml"
    forces = "\n[forces]\ngravity = [0, 0, -9.81]\nfriction.slide = { viscous = 2.0, coulomb = 0.5 }\n"
    forces += "[forces.joint_springs.crank]\nstiffness = 3.0\nrest = 0.4\n"
    path.write_text(export("slider_crank", format="toml").text + forces)
    exact = load(path)
    export(exact, tmp_path / "m.sdf", format="sdf")
    read = load(tmp_path / "m.sdf")
    torques = [
        dynamics.prescribed(dynamics.dynamic_model(solver), np.linspace(0.2, 6.0, 50), 5.0).forces.torque
        for solver in (exact, read)
    ]
    assert torques[1] == pytest.approx(torques[0], abs=1e-12)


def test_frames_degrees_axes_limits_and_mimics_of_others_are_read(arm):
    arm.write_text(re.sub("<mimic.*?</mimic>", "", ARM))
    solver = load(arm, still=True)
    mechanism = solver.mechanism
    # the model stands at x = 1; the forearm is rotated by 90 deg about x
    assert mechanism.guess["fore"].position == pytest.approx([1.3, 0.0, 0.5], abs=1e-15)
    assert mechanism.guess["fore"].rotation @ [0, 1, 0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-15)
    assert mechanism.points["hinge"] == ("upper", pytest.approx((0.3, 0.0, 0.0)))
    inertia = mechanism.links[0].inertia
    # the inertial frame is rotated by 90 deg about z
    assert np.diag(inertia.matrix) == pytest.approx([0.02, 0.01, 0.025], abs=1e-15)
    assert (inertia.mass, inertia.centre) == (2.0, (0.1, 0.0, 0.0))
    assert solver.ranges["shoulder"] == (-1.0, 2.0)
    (friction,) = solver.forces.friction
    (spring,) = solver.forces.joint_springs
    assert (friction.viscous, friction.coulomb, spring.stiffness, spring.rest) == (0.3, 0.1, 5.0, 0.2)
    assert solver.forces.gravity == (0.0, 0.0, -9.8)
    assert solver.facts == ("not read: visual",)
    arm.write_text(ARM)
    moved = load(arm, drive={"shoulder": "0.4+0.5*t"}, duration=1.0).solve(t=[0.0, 1.0])
    assert moved.joints["elbow"].value == pytest.approx([0.1, -0.9], abs=1e-12)
    # the axis y carries the hinge down for a positive angle
    assert moved.points["hinge"].position[1] == pytest.approx(
        [1.0 + 0.3 * np.cos(0.9), 0.0, 0.5 - 0.3 * np.sin(0.9)]
    )


def test_a_model_without_a_joint_to_the_world_floats(arm):
    arm.write_text(
        ARM.replace("<parent>world</parent><child>upper</child>", "<parent>upper</parent><child>fore</child>")
    )
    kinds = {joint.name: joint.kind for joint in load(arm, still=True).mechanism.joints}
    assert kinds["upper_floating"] == "floating"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type="continuous"', 'type="gearbox"', "joint elbow is of type 'gearbox'; types that are read are"),
        ('attached_to="upper"', 'attached_to="uper"', "frame 'uper' is named, but there is none"),
        ('relative_to="hinge"', 'relative_to="fore"', "frame 'fore' is given relative to itself"),
        ("<xyz>0 2 0</xyz>", "<xyz>0 0 0</xyz>", "an axis is zero"),
        ("<xyz>0 2 0</xyz>", "<xyz>0 two 0</xyz>", "an axis is '0 two 0'; give 3 numbers"),
        ("<mass>2</mass>", "<mass>heavy</mass>", "mass is 'heavy'; give 1 number"),
        ('<mimic joint="shoulder">', '<mimic joint="sholder">', "joint elbow mimics 'sholder'"),
        ("</model>", "</model><model name='b'/>", "with 2 models"),
        ("</sdf>", "", "is no XML"),
    ],
)
def test_invalid_files_are_rejected_in_one_sentence(arm, old, new, message):
    arm.write_text(ARM.replace(old, new))
    with pytest.raises(InputError, match=re.escape(message)) as error:
        load(arm, still=True)
    assert "\n" not in str(error.value)


def test_what_sdf_does_not_have_is_stated(tmp_path):
    text = export("rack_steering", format="toml").text
    joint = next(joint.name for joint in load("rack_steering").mechanism.joints if joint.name != "pinion")
    text = text.replace('driver = "pinion"', f"driver = {{ pinion = 1.0, {joint} = 0.0 }}")
    (tmp_path / "sum.toml").write_text(text.replace("pressure_angle = 0.0", ""))
    with pytest.raises(InputError, match="is not linear between two joints"):
        export(tmp_path / "sum.toml", format="sdf")
    with pytest.raises(InputError, match=r"coupling contact\.law is not linear between two joints"):
        export("cam_follower", format="sdf")
    assert "motion laws" in export("delta_robot", format="sdf").left_out
    with pytest.raises(InputError, match="--scene, --speed and settings are for MuJoCo models"):
        export("four_bar", format="sdf", speed="600rpm")
