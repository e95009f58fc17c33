"""Only the modules that define joint kinds compare them by name."""

import ast

import structure

from mechsim.mechanism.joint_kinds import KINDS

FILES = structure.modules()
# modules with the table, equations, MuJoCo joints, file elements and drawings of the kinds;
# a mechanism of the catalogue names those of its own joints
DEFINING_MODULES = {
    "mechsim.mechanism.joint_kinds",
    "mechsim.kinematics.loops.maximal_coordinates",
    "mechsim.simulation.mjcf.joints",
    "mechsim.simulation.mjcf_reader.kinematic_tree",
    "mechsim.shapes.joints",
    "mechsim.simulation.mjcf.included_files",  # "fixed" is an element of MJCF there
    "mechsim.report.facts",  # "planar" describes a mechanism there
    "mechsim.cli.finding_text",  # likewise
    "mechsim.cli.check",  # "fixed" is a key of its JSON
    "mechsim.simulation.mjcf_reader.urdf_loops",  # types of joints in URDF
    "mechsim.simulation.mjcf_reader.urdf_tree",  # types of joints in URDF
    "mechsim.simulation.mjcf_reader.urdf_unread",  # types of joints in URDF
    "mechsim.studies.certify.loop_equations",  # interval equations of a ball
    "mechsim.codegen.assembly",  # replaces a ball by a universal joint
    "mechsim.io.linkage_sim_json",  # types of joints in files of other programs
    "mechsim.io.planar_json",  # types of joints in files of other programs
    "mechsim.io.pylinkage_json",  # types of joints in files of other programs
    "mechsim.studies.robots.serial_twin",  # types of joints in URDF
    "mechsim.mechanism.link_poses",  # the rod that locks the spin of a ball
    "mechsim.mechanism.moved_links",  # the ends of the links that stand for rods
    "mechsim.mechanism.quantities",  # "distance" is a quantity there
    "mechsim.simulation.mjcf.generator",  # the ends of the links that stand for rods
    "mechsim.simulation.mjcf_reader.equality_constraints",  # a tendon's equality is a rod
    "mechsim.studies.release",  # "distance" is a quantity there
    "mechsim.io.toml_cams",  # the joints that a cam and its follower consist of
    "mechsim.io.toml_curves",  # the joints that a point on a curve consists of
    "mechsim.io.sdf_reader",  # types of joints in SDF
    "mechsim.io.sdf_writer",  # types of joints in SDF
    "mechsim.io.plain_joints",  # the two joints into which one is split
    "mechsim.simulation.findings.rules",  # tags of MJCF
    "mechsim.io.usd_reader",  # types of joints in USD
    "mechsim.io.usd_writer",  # types of joints in USD
    "mechsim.io.pose_drivers",  # the joints whose coordinates are the pose of a link
}


def named(source):
    """Return the joint kinds that are complete string constants of a source."""
    if not any(kind in source for kind in KINDS):
        return []
    constants = [node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)]
    return [value for value in constants if isinstance(value, str) and value in KINDS]


def test_no_joint_kind_is_compared_by_name_outside_its_files():
    elsewhere = [name for name in FILES if name not in DEFINING_MODULES]
    assert {name: result for name in elsewhere if (result := named(FILES[name].read_text()))} == {}


def test_the_check_rejects_a_comparison_by_name():
    assert named('turns = joint.kind in ("revolute", "cylindrical")') == ["revolute", "cylindrical"]
    assert named('COST = {"spherical": 3}') == ["spherical"]
    assert named('message = "have a revolute joint in every loop"') == []
