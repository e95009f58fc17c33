"""Loops of URDF files: every dialect closes the same four-bar, and invalid files are rejected."""

import tomllib

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms

CRANK, ROD, FOLLOWER, GROUND = 0.3, 1.0, 0.7, 1.0
TEXTS = tomllib.loads(model_text("urdf_loops_dialects.toml"))
DIALECTS, ENDS = TEXTS["dialects"], TEXTS["parts"]["ends"]


def robot(*elements):
    return model_text("urdf_loops_tree.urdf", elements="".join(elements))


@pytest.fixture
def written(tmp_path):
    def write(text, name="four_bar.urdf"):
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return write


def gap(path, **options):
    """Return the distance between the ends of rod and follower, and the motion."""
    motion = ms.load(path, drive={"motor": "1rad/s"}, duration=6.28, **options).solve(
        t=np.linspace(0.0, 6.28, 13)
    )
    rod, follower = motion.links["rod"], motion.links["follower"]
    end = rod.position + rod.rotation @ np.array([ROD, 0.0, 0.0])
    other = follower.position + follower.rotation @ np.array([0.0, FOLLOWER, 0.0])
    return float(np.abs(end - other).max()), motion


@pytest.mark.long
@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_dialect_closes_the_four_bar(written, dialect):
    error, motion = gap(written(robot(DIALECTS[dialect])))
    assert error <= 1e-14
    # the law of cosines at the crank's pivot and the follower's
    crank = motion.joints["motor"].value
    pin = CRANK * np.stack([-np.sin(crank), np.cos(crank)], 1)
    distance = np.hypot(*(pin - [GROUND, 0.0]).T)
    cosine = (ROD**2 + FOLLOWER**2 - distance**2) / (2.0 * ROD * FOLLOWER)
    rod, follower = (motion.links[name].rotation for name in ("rod", "follower"))
    assert -np.einsum("ni,ni->n", rod[:, :, 0], follower[:, :, 1]) == pytest.approx(-cosine, abs=1e-12)


def coupling(predecessor, successor, ratio="6"):
    return f"""<coupling name="gears"><predecessor link="{predecessor}"/><successor link="{successor}"/>
    <ratio value="{ratio}"/></coupling>"""


@pytest.mark.parametrize(("predecessor", "joints"), [("crank", ["motor"]), ("rod", ["motor", "knee"])])
def test_a_coupling_multiplies_the_angles_between_its_links(written, predecessor, joints):
    model = written(robot(coupling(predecessor, "follower")))
    qpos = ms.closed_qpos(model, dict.fromkeys(joints, (0.0, 0.1, -0.3)))
    assert qpos[:, 2] == pytest.approx(6.0 * len(joints) * np.array([0.0, 0.1, -0.3]), abs=1e-12)


def test_a_gazebo_loop_joint_uses_the_initial_configuration(written):
    # at zero the rod's end lies at (1, 0.3), the follower's in (0, 0.3) of its own frame
    joint = """<gazebo><joint name="closing" type="revolute"><parent>rod</parent><child>follower</child>
    <pose>0 0.3 0 0 0 0</pose><axis><xyz>0 0 1</xyz></axis></joint></gazebo>"""
    solver = ms.load(written(robot(joint)), drive={"motor": "0.3rad*sin(t)"}, duration=1.0)
    motion = solver.solve(t=np.linspace(0.0, 1.0, 5))
    rod, follower = motion.links["rod"], motion.links["follower"]
    end = rod.position + rod.rotation @ np.array([1.0, 0.0, 0.0])
    assert end == pytest.approx(follower.position + follower.rotation @ np.array([0.0, 0.3, 0.0]), abs=1e-14)
    assert np.ptp(motion.joints["hip"].value) > 0.1


def test_a_sidecar_file_closes_loops_between_named_frames(written):
    path = written(robot(ENDS))
    sidecar = written(
        "closed_loop: [[rod_end, follower_end_joint]]\ntype: [3d]\nname_mot: [motor]\n", "robot.yaml"
    )
    assert gap(path, loops=sidecar)[0] <= 1e-14
    with pytest.raises(ms.MechsimError, match="underdetermined"):  # without it the follower is free
        gap(path)


def test_a_sidecar_file_makes_joints_spherical_universal_or_fixed(written):
    path = written(robot(ENDS))
    text = "closed_loop: [[rod_end, follower_end]]\ntype: [6d]\njoint_name: [knee]\njoint_type: [{}]\n"

    def kinds(stated):
        loaded = ms.load(path, loops=written(text.format(stated), "joints.yaml"), still=True)
        return {joint.name: joint.kind for joint in loaded.mechanism.joints}

    assert kinds("SPHERICAL")["knee"] == "spherical"
    assert {"knee", "knee_second"} <= kinds("UJOINT_XY").keys()
    with pytest.raises(ms.InputError, match="joint_type of 'knee' is 'PLANAR'"):
        kinds("PLANAR")


# of scikit-robot: points and axes in the root frame with all joints at zero


def test_a_scikit_robot_sidecar_file_closes_a_loop(written):
    # at zero the rod lies along x at height CRANK: a follower from GROUND to its end
    text = robot().replace(f'xyz="{GROUND} 0 0"', f'xyz="{GROUND} 0 0" rpy="0 0 0.7"')
    sidecar = written(model_text("urdf_loops_scikit_robot.yaml", x=ROD, y=CRANK), "loop_closures.yaml")
    model = ms.load(written(text), drive={"motor": "1rad/s"}, duration=0.5, loops=sidecar)
    motion = model.solve(t=np.linspace(0.0, 0.5, 5))
    rod, follower = motion.links["rod"], motion.links["follower"]
    end = rod.position + rod.rotation @ np.array([ROD, 0.0, 0.0])
    # the point keeps its distance from both pivots, as in the root frame at zero
    length = np.hypot(ROD - GROUND, CRANK)
    np.testing.assert_allclose(np.linalg.norm(end - follower.position, axis=1), length, rtol=0, atol=1e-14)
    np.testing.assert_allclose(end[0], [ROD, CRANK, 0.0], rtol=0, atol=1e-14)


def test_a_declared_prefix_loses_no_loop(written):
    text = robot(DIALECTS["URDF+"], "<gz:system name='x'/>").replace("<robot", '<robot xmlns:gz="http://a"')
    assert gap(written(text))[0] <= 1e-14


def test_an_unknown_key_of_a_sidecar_file_is_a_finding(written):
    text = "closed_loop: [[rod_end, follower_end]]\ntype: [3d]\nclosures: []\njoints_type: [FIXED]\n"
    findings = ms.check(written(robot(ENDS)), loops=written(text, "robot.yaml"), select=["MS115"])
    assert [(finding.object, finding.line) for finding in findings] == [("closures", 3), ("joints_type", 4)]


def test_an_invalid_number_in_a_file_with_a_sidecar_file_is_rejected_with_its_line(written):
    path = written(robot(ENDS).replace('xyz="0 0 1"', 'xyz="0 0 x"', 1))
    with pytest.raises(ms.InputError, match="line 4: MuJoCo refuses it: bad format in attribute 'xyz'"):
        ms.check(path, loops=written("closed_loop: [[rod_end, follower_end]]", "r.yaml"))
