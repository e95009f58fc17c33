"""MuJoCo is loaded by `simulation.mujoco_loading` before any module imports it by itself."""

import re
import subprocess
import sys
from pathlib import Path

import mechsim
from mechsim.cli import LATE

HOUSE = Path(mechsim.__file__).parent
# at the head of a module, where importing the module imports it
HEAD = re.compile(r"^(?:import mujoco|from mujoco)", re.MULTILINE)
FIRST = re.compile(r"^import mechsim\.simulation\b", re.MULTILINE)


def test_a_package_that_imports_mujoco_loads_it_first_without_a_back_end_that_fails() -> None:
    """Else MUJOCO_GL=nonsense ends a command that draws nothing in an internal error."""
    importing = {path.parent for path in HOUSE.rglob("*.py") if HEAD.search(path.read_text())}
    for folder in importing:
        above = [one for one in (folder, *folder.parents) if HOUSE in one.parents]
        heads = [(one / "__init__.py").read_text() for one in above]
        assert any(FIRST.search(head) for head in heads), folder
    assert len(importing) > 5


def test_the_help_of_these_commands_is_told_without_mujoco():
    names = ["list", "show", "solve", "sensitivity", *LATE]
    told = f"""
import sys
from mechsim.cli import app
for name in {names}:
    app([name, "--help"], standalone_mode=False)
    assert not {{"mujoco", "scipy", "matplotlib"}} & sys.modules.keys(), name
"""
    found = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    for name in names:
        assert f" {name} [OPTIONS]" in found.stdout
