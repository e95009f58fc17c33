"""The pytest plugin in separate projects and processes."""

import shutil
import xml.etree.ElementTree as ET
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from processes import python

ROOT = Path(__file__).parents[2]
INSTALLED = bool(entry_points(group="pytest11", name="mechsim"))


@pytest.fixture
def project(tmp_path):
    folder = tmp_path / "my_project"
    shutil.copytree(ROOT / "examples" / "my_project", folder, ignore=shutil.ignore_patterns("reports"))
    return folder


def run(folder, *arguments, isolated=True):
    """Return exit code and output of pytest in a folder, alone with the plugin, or with all installed."""
    plugin = ("-p", "mechsim.testing.plugin") if isolated else ()
    variables = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"} if isolated else {}
    variables |= {"PYTHONPATH": str(ROOT), "COLUMNS": "80"}
    words = [*plugin, "-q", "-W", "error", "--strict-markers", *arguments]
    completed = python("-m", "pytest", *words, folder=folder, **variables)
    return completed.returncode, completed.stdout + completed.stderr


def collected(folder, *arguments, isolated=True):
    code, out = run(folder, "--collect-only", *arguments, isolated=isolated)
    return code, [line for line in out.splitlines() if "::" in line]


@pytest.mark.long
def test_only_the_intended_failure_of_the_sample_project_fails(project):
    code, out = run(project, "--junitxml=junit.xml")
    assert code == 1, out
    assert "1 failed, 3 passed" in out
    assert "pump does not agree with rod_of_96_mm" in out
    assert "cause:  rod" in out
    command = "again:  pytest tests/test_pump.py::test_red_on_purpose_a_rod_one_millimetre_too_long"
    assert command in out
    cases = {case.get("name"): case for case in ET.parse(project / "junit.xml").iter("testcase")}
    green = {item.get("name"): item.get("value") for item in cases["formula"].iter("property")}
    assert green["mechsim.model"] == "pump"
    assert green["mechsim.outcome"] == "passed"
    (red,) = (case for name, case in cases.items() if "red_on_purpose" in name)
    reported = {item.get("name"): item.get("value") for item in red.iter("property")}
    assert reported["mechsim.outcome"] == "failed"
    assert reported["mechsim.worst"] == "position of piston"


@pytest.mark.slow
def test_a_toml_file_with_a_wrong_formula_fails_under_xdist(project):
    description = project / "models" / "pump.toml"
    description.write_text(description.read_text().replace("pump.py:piston", "pump.py:mistyped"))
    code, out = run(project, "models/pump.toml", "-p", "xdist.plugin", "-n", "1")
    assert code == 1, out
    assert "pump does not agree with" in out
    assert "again:  mechsim validate models/pump.toml" in out
    assert "Traceback" not in out


@pytest.mark.long
def test_toml_files_are_collected_if_configured_or_named(project):
    assert collected(project)[1][0] == "models/pump.toml::formula"
    assert collected(project, "-m", "mechsim")[1] == ["models/pump.toml::formula"]
    (project / "pyproject.toml").write_text("[tool.pytest.ini_options]\n")
    assert collected(project, "models")[1] == []
    assert collected(project, "models/pump.toml") == (0, ["models/pump.toml::formula"])


@pytest.mark.long
def test_other_toml_files_are_ignored(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]\nmechsim_collect = *.toml\n")
    (tmp_path / "pyproject.toml").write_text("[joints]\n[formula]\n")
    (tmp_path / "settings.toml").write_text("[formula]\npython = 'x.py:f'\n")
    (tmp_path / "linkage.toml").write_text("[joints.a]\nkind = 'revolute'\n")
    (tmp_path / "broken.toml").write_bytes(b"[formula]\n\xff[joints]")
    assert collected(tmp_path) == (5, [])


@pytest.mark.slow
@pytest.mark.skipif(not INSTALLED, reason="the entry point needs an installed package")
def test_the_installed_plugin_is_loaded_and_can_be_disabled(project):
    (project / "pyproject.toml").unlink()
    assert collected(project, "models/pump.toml", isolated=False) == (0, ["models/pump.toml::formula"])
    assert collected(project, "-p", "no:mechsim", "models/pump.toml", isolated=False) == (4, [])
