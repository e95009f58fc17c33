"""What an SDF or USD file states about motion is read with its value, or is named as not read."""

from collections import defaultdict

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms

SDF = model_text("what_files_state_arm.sdf")
SECOND = "<axis2><xyz>0 1 0</xyz><dynamics><damping>5</damping></dynamics></axis2>"


def sdf(tmp_path, **case):
    """Return the solver of an arm whose link frame is rotated by pi/2 + 0.3 about z in the world."""
    (tmp_path / "arm.sdf").write_text(
        SDF.format_map(defaultdict(str, {"version": "1.11", "type": "revolute", **case}))
    )
    return ms.load(str(tmp_path / "arm.sdf"), still=True)


@pytest.mark.parametrize(
    ("case", "unread"),
    [
        ({}, ""),
        ({"limit": "<effort>3</effort><stiffness>9</stiffness>"}, "limit/effort, limit/stiffness"),
        ({"link": "<gravity>false</gravity>"}, "link/gravity"),
        ({"type": "universal", "axis2": SECOND}, "axis/dynamics, axis/limit, axis2/dynamics"),
        ({"type": "ball"}, "axis/dynamics, axis/limit"),
        ({"inertial": 'auto="true"', "mass": "<density>3</density>"}, "inertial/auto, inertial/density"),
        ({"mass": "<fluid_added_mass/>"}, "inertial/fluid_added_mass"),
        ({"model": 'placement_frame="arm"'}, "model/placement_frame"),
        ({"pose": 'frame="base"', "version": "1.5"}, "pose/frame"),
        ({"parts": "<static>1</static>"}, "model/static"),
        ({"joint": "<thread_pitch>3</thread_pitch><physics/>"}, "joint/physics, joint/thread_pitch"),
        ({"world": '<joint name="x" type="fixed"/><frame name="y"/>'}, "world/frame, world/joint"),
    ],
)
def test_what_is_not_read_of_sdf_is_named(case, unread, tmp_path):
    solver = sdf(tmp_path, **case)
    assert solver.facts == ((f"not read: {unread}",) if unread else ())
    assert solver.forces.gravity == (0.0, 0.0, -9.8)


@pytest.mark.parametrize(
    ("case", "angle"),
    [
        ({}, np.pi / 2 + 0.3),
        ({"xyz": 'expressed_in="__model__"'}, np.pi / 2),
        ({"xyz": 'expressed_in="base"'}, np.pi / 2),
        ({"axis": "<use_parent_model_frame>true</use_parent_model_frame>", "version": "1.6"}, np.pi / 2),
        ({"version": "1.4"}, np.pi / 2),
        ({"version": "1.10"}, np.pi / 2 + 0.3),
    ],
)
def test_directions_of_axes_are_in_the_frame_that_sdf_states(case, angle, tmp_path):
    mechanism = sdf(tmp_path, **case).mechanism
    (joint,) = (joint for joint in mechanism.joints if joint.name == "shoulder")
    direction = mechanism.guess["arm"].rotation @ joint.b.axis
    assert direction == pytest.approx([np.cos(angle), np.sin(angle), 0.0], abs=1e-15)


def test_gravity_and_frames_without_attachment_are_those_of_sdf(tmp_path):
    frame = '<frame name="tip"><pose>0 0 0.7 0 0 0</pose></frame>'
    moon = "<gravity>0 0 -1.62</gravity>"
    solver = sdf(tmp_path, world=moon, parts=frame, model='canonical_link="arm"')
    assert solver.forces.gravity == (0.0, 0.0, -1.62)
    assert solver.mechanism.points["tip"] == ("arm", pytest.approx((0.0, 0.0, 0.2), abs=1e-15))
    old = sdf(tmp_path, world=f"<physics>{moon}</physics>", version="1.5")
    assert old.forces.gravity == (0.0, 0.0, -1.62)


USD = model_text("what_files_state_rig.usda")
# 2e6 g cm2, and a damper of 1e5 g cm2/s a degree: 0.2 kg m2 and 0.01 N m s a degree
MOMENT, DAMPING = 0.2, 0.01 * 180 / np.pi


def usd(tmp_path, **case):
    default = {"type": "PhysicsRevoluteJoint", "centre": "(0, 0, 0)", "moments": "(1e6, 1e6, 2e6)"}
    (tmp_path / "rig.usda").write_text(USD.format_map(defaultdict(str, default | case)))
    return ms.load(str(tmp_path / "rig.usda"), still=True)


@pytest.mark.parametrize(
    ("case", "unread"),
    [
        ({}, ""),
        ({"body": "vector3f physics:angularVelocity = (0, 0, 9)"}, "physics:angularVelocity"),
        ({"body": "vector3f physics:velocity = (0, 0, 0)"}, ""),
        ({"centre": "(-inf, -inf, -inf)"}, "centres of mass by shapes"),
        ({"moments": "(0, 0, 0)"}, "moments of inertia by shapes"),
        (
            {
                "joint": "float physics:breakForce = 5\nfloat physics:breakTorque = 7",
                "joint_schemas": ', "PhysxJointAPI"',
            },
            "PhysxJointAPI, physics:breakForce, physics:breakTorque",
        ),
        (
            {"type": "PhysicsSphericalJoint", "joint": "float physics:coneAngle0Limit = 30"},
            "PhysicsDriveAPI:angular, physics:coneAngle0Limit",
        ),
        ({"joint_schemas": ', "PhysicsDriveAPI:rotX"'}, "PhysicsDriveAPI:rotX"),
        (
            {
                "joint": 'uniform token drive:angular:physics:type = "acceleration"\n'
                "float drive:angular:physics:damping = 3"
            },
            "drives of type acceleration",
        ),
        (
            {"prims": 'def MjcTendon "t" {}\ndef PhysxPhysicsGearJoint "g" {}'},
            "MjcTendon, PhysxPhysicsGearJoint",
        ),
    ],
)
def test_what_is_not_read_of_usd_is_named(case, unread, tmp_path):
    solver = usd(tmp_path, **case)
    assert solver.facts == ((f"not read: {unread}",) if unread else ())
    assert not solver.forces.friction
    assert not solver.forces.actuators


@pytest.mark.parametrize("kind", ["limited", "with a speed"])
def test_a_drive_with_a_limit_or_a_speed_moves_a_wheel_as_the_closed_form(kind, tmp_path):
    damping = "float drive:angular:physics:damping = 1e5\n"
    # 5e6 g cm2/s2 are 0.5 N m; the spring asks for more at 0.1 rad from its target of 60 deg
    limited = "float drive:angular:physics:stiffness = 1e7\nfloat drive:angular:physics:targetPosition = 60\n"
    limited += "float drive:angular:physics:maxForce = 5e6"
    cases = {"limited": limited, "with a speed": damping + "float drive:angular:physics:targetVelocity = 30"}
    solver = usd(tmp_path, joint=cases[kind])
    run = ms.dynamics.run(ms.dynamics.dynamic_model(solver, solver.forces), duration=0.2, samples=5)
    times, shaft = np.linspace(0.0, 0.2, 6), run.motion.joints["shaft"]
    if kind == "limited":
        assert shaft.value == pytest.approx(0.5 * 0.5 / MOMENT * times**2, abs=1e-7)
    else:
        time = MOMENT / DAMPING
        rotation = np.pi / 6 * (times - time * (1.0 - np.exp(-times / time)))
        assert shaft.value == pytest.approx(rotation, abs=1e-7)


def test_bodies_of_instances_are_read_and_a_mimic_may_be_off(tmp_path):
    prototype = """def Xform "copy" ( instanceable = true
    prepend references = </rig/set> ) {}
    def Xform "set" {
    def Xform "bob" ( prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"] ) {
      float physics:mass = 500
    }
    }"""
    bodies = usd(tmp_path, prims=prototype).mechanism.links
    assert sorted(link.inertia.mass for link in bodies) == [0.5, 0.5, 2.0]
    off = "bool newton:mimicEnabled = 0\nrel newton:mimicJoint = </rig/shaft>"
    assert not usd(tmp_path, joint=off, joint_schemas=', "NewtonMimicAPI"').mechanism.couplings
