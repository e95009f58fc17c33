"""Public names, their declarations for type checkers, and models that functions accept."""

import ast
import importlib
from pathlib import Path

import pytest

import mechsim as ms

PUBLIC = """
    Agreement AssemblyError Bushing Certificate Check Clearance Controller Coupling End Forces Friction Gear
    Inertia InputError Joint JointSpring Link Load Look Mechanism MechsimError Motion MotionLaws Pose Run
    Scene Settings Spring Tolerance Validation Verdict __version__ assemblies catalog certify check
    closed_qpos compile crosscheck dynamics export fit formulas identify joint_map list load load_profile
    loops masses motors moved plot plots reduce render sample sensitivity show simulate simulation sweep
    testing tolerance_study trace tune units validate vectors view
"""
NAMES = PUBLIC.split()


def test_dir_lists_exactly_the_public_names():
    assert dir(ms) == sorted(NAMES) == sorted(ms.__all__)
    for name in NAMES:
        assert getattr(ms, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        getattr(ms, "nothing")  # noqa: B009


def test_declarations_for_type_checkers_match_the_runtime():
    tree = ast.parse(Path(ms.__file__).read_text())
    (block,) = [n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    reported = {}
    for statement in block.body:
        home = importlib.import_module(statement.module)
        reported |= {item.asname or item.name: (home, item.name) for item in statement.names}
    assert set(reported) == set(NAMES) - {"__version__"}
    for name, (home, name_in_home) in reported.items():
        inside = f"{home.__name__}.{name_in_home}"
        declared = (
            vars(home).get(name_in_home) if name_in_home in vars(home) else importlib.import_module(inside)
        )
        assert getattr(ms, name) is declared
    assert (Path(ms.__file__).parent / "py.typed").is_file()
