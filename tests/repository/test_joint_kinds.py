"""Only the modules that define joint kinds compare them by name."""

import ast

import structure

from mechsim.mechanism.joint_kinds import KINDS

FILES = structure.modules()
# modules with the table, equations, MuJoCo joints and drawings of the kinds, or with the words in another
# sense, and packages that read and write files, whose formats name kinds
DEFINING_MODULES = (
    *("mechsim.mechanism.joint_kinds", "mechsim.kinematics.loops.maximal_coordinates"),
    *("mechsim.shapes.joints", "mechsim.simulation.mjcf.joints", "mechsim.simulation.mjcf.included_files"),
    *("mechsim.simulation.mjcf_reader", "mechsim.simulation.findings.rules", "mechsim.io."),
    # "planar" describes a mechanism there, "fixed" is a key of JSON and "distance" is a quantity
    *("mechsim.report.facts", "mechsim.cli.finding_text", "mechsim.cli.check"),
    *("mechsim.mechanism.quantities", "mechsim.studies.release", "mechsim.studies.robots.serial_twin"),
    # balls and rods whose equations differ
    *("mechsim.studies.certify.loop_equations", "mechsim.codegen.assembly", "mechsim.mechanism.link_poses"),
    *("mechsim.mechanism.moved_links", "mechsim.simulation.mjcf.generator"),
)


def named(source):
    """Return the joint kinds that are complete string constants of a source."""
    if not any(kind in source for kind in KINDS):
        return []
    constants = [node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)]
    return [value for value in constants if isinstance(value, str) and value in KINDS]


def test_no_joint_kind_is_compared_by_name_outside_its_files():
    elsewhere = [name for name in FILES if not name.startswith(DEFINING_MODULES)]
    assert {name: result for name in elsewhere if (result := named(FILES[name].read_text()))} == {}


def test_the_check_rejects_a_comparison_by_name():
    assert named('turns = joint.kind in ("revolute", "cylindrical")') == ["revolute", "cylindrical"]
    assert named('COST = {"spherical": 3}') == ["spherical"]
    assert named('message = "have a revolute joint in every loop"') == []
