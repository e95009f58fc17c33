"""MuJoCo is loaded by `simulation.mujoco_loading` before any module imports it by itself."""

import re
from pathlib import Path

import mechsim

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
