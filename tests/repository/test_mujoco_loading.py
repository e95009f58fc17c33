"""`simulation.mujoco_loading` loads MuJoCo before any module imports it."""

import os
import re
from pathlib import Path

import pytest
from processes import mechsim_run, python

import mechsim
from mechsim.cli import LATE

PACKAGE = Path(mechsim.__file__).parent
# at module level, executed on import
MUJOCO_IMPORT = re.compile(r"^(?:import mujoco|from mujoco)", re.MULTILINE)
LOADING_IMPORT = re.compile(r"^import mechsim\.simulation\b", re.MULTILINE)


def test_packages_with_mujoco_import_the_loading_module_first() -> None:
    """Otherwise MUJOCO_GL=nonsense causes an internal error of a command that draws nothing."""
    importing = {path.parent for path in PACKAGE.rglob("*.py") if MUJOCO_IMPORT.search(path.read_text())}
    for folder in importing:
        above = [item for item in (folder, *folder.parents) if PACKAGE in item.parents]
        heads = [(item / "__init__.py").read_text() for item in above]
        assert any(LOADING_IMPORT.search(head) for head in heads), folder
    assert len(importing) > 5


def test_help_of_these_commands_does_not_import_mujoco():
    names = ["list", "show", "solve", "sensitivity", *LATE]
    reported = f"""
import sys
from mechsim.cli import app
for name in {names}:
    app([name, "--help"], standalone_mode=False)
    assert not {{"mujoco", "scipy", "matplotlib"}} & sys.modules.keys(), name
"""
    result = python("-c", reported)
    assert result.returncode == 0, result.stderr
    for name in names:
        assert f" {name} [OPTIONS]" in result.stdout


INIT = "raise ImportError('repair it by a command') from ImportError('no core bindings')"


def run_with_mujoco(tmp_path, files, *names):
    """Run a command with these files in the folder mujoco and these distributions installed."""
    for name, text in files.items():
        path = tmp_path / "mujoco" / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    for name in names:
        info = tmp_path / f"{name.replace('-', '_')}-4.0.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 4.0.0\n")
    return mechsim_run("validate", "slider_crank", PYTHONPATH=f"{tmp_path}{os.pathsep}{PACKAGE.parent}")


def test_an_old_mujoco_is_reported_with_the_update_command(tmp_path):
    completed = run_with_mujoco(tmp_path, {"__init__.py": "MjModel = object"}, "mujoco")
    assert completed.returncode == 2
    assert (
        completed.stderr == "mechsim: MuJoCo 4.0.0 is too old; pip install -U 'mujoco>=3.17.0' updates it\n"
    )


@pytest.mark.parametrize(
    ("files", "cause"),
    [
        ({"__init__.py": INIT}, "no core bindings"),
        ({"__init__.py": "", "note.txt": "what an uninstalled version leaves"}, "has no MjModel"),
    ],
)
def test_a_damaged_mujoco_is_reported_with_the_repair_command(tmp_path, files, cause):
    completed = run_with_mujoco(tmp_path, files, "mujoco", "mujoco-core", "mujoco-studio")
    assert completed.returncode == 2
    assert len(completed.stderr.splitlines()) == 1
    assert cause in completed.stderr
    pins = "mujoco==4.0.0 mujoco-core==4.0.0 mujoco-studio==4.0.0"
    assert f"pip install --force-reinstall --no-deps {pins} repairs it" in completed.stderr


@pytest.mark.parametrize("function", ["load", "check"])
def test_the_first_model_of_a_process_is_read(function):
    """Importing mujoco.batch makes MuJoCo forget the XML that it loaded last."""
    script = f"""
import mujoco, mechsim as ms
BODY = "<body pos='0.123456789 0 0'><joint name='j'/><geom size='1'/></body>"
ACTUATOR = "<actuator><motor joint='j'/></actuator>"
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody>" + BODY + "</worldbody>" + ACTUATOR + "</mujoco>")
ms.{function}(model)
print(ms.load(model).mechanism.joints[0].a.point[0])
"""
    result = python("-c", script)
    assert result.returncode == 0, result.stderr
    assert result.stdout == "0.123456789\n"


def test_a_command_that_draws_nothing_loads_no_window_library():
    model = Path(mechsim.catalog.models()) / "four_bar.xml"
    reported = f"""
import sys
from mechsim.cli import main
sys.argv = ["mechsim", "check", {str(model)!r}]
try:
    main()
finally:
    assert "mujoco" in sys.modules and "glfw" not in sys.modules
"""
    result = python("-c", reported, MUJOCO_GL=None)
    assert result.returncode == 0, result.stderr
