"""Every study can be imported; those that need no other files run in a quick form, or as they are."""

import ast
import runpy
import subprocess
import sys
from pathlib import Path

import newest_python
import pytest
from mutants import EQUIVALENT
from mutation import ROOT, TESTS

FOLDER = Path(__file__).parents[2] / "validation"
SCRIPTS = sorted(str(path.relative_to(FOLDER)) for path in FOLDER.rglob("*.py"))
# packages that only the extras [peers] and [engines] install
OPTIONAL = {"exudyn", "jax", "mujoco_warp", "pinocchio", "pybullet", "pydrake", "pylinkage"}
QUICK = (
    "certify/all_mechanisms.py",
    "choices/compliance.py",
    "choices/constants.py numerics.fold_points.NODES 3 0.5",
    "choices/constraint_settings.py",
    "choices/crank_actuation.py",
    "choices/matrices.py",
    "choices/tolerance_study.py --count 1",
    "choices/torque_steps.py",
    "choices/tuned_scenes.py --only four_bar --cases 1",
    "engines/engine_table.py --engine by_mujoco --mechanism four_bar",
    "papers/looper_table.py",
    "papers/triad.py 20",
    "published/dry_friction.py 1",
    "published/forward_dynamics.py 1",
    "published/natural_frequencies.py",
    "published/vibrations.py",
    "robustness/assembly_detector.py --runs 4",
    "robustness/diagnosis.py --cases 2",
    "robustness/free_run_drift.py 10 four_bar",
    "robustness/power_balance.py four_bar",
    "robustness/random_toml_mechanisms.py --count 2",
    "robustness/torque_scale.py four_bar",
    "sensitivity/fifty_digits.py four_bar",
    "sensitivity/fit_coverage.py 3 four_bar",
    "speed/closed_form_speed.py",
    "speed/loop_speed.py",
    "speed/pose_speed.py",
    "speed/step_overhead.py 1 100",
    "speed/sweep_speed.py 0.0001",
)


@pytest.mark.parametrize("script", SCRIPTS)
def test_every_script_can_be_imported(script, monkeypatch):
    path = FOLDER / script
    monkeypatch.syspath_prepend(str(path.parent))
    try:
        runpy.run_path(str(path), run_name="imported")
    except ModuleNotFoundError as error:
        assert str(error.name).split(".")[0] in OPTIONAL


@pytest.mark.slow
@pytest.mark.parametrize("words", QUICK)
def test_a_study_runs_in_its_quick_form(words, tmp_path):
    script, *arguments = words.split()
    result = subprocess.run(
        [sys.executable, FOLDER / script, *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    # 1: a limit of time is exceeded, or too few cases are named; an error has a traceback
    assert result.returncode in (0, 1), result.stderr
    assert "Traceback" not in result.stderr, result.stderr
    assert result.stdout.strip()


def test_the_newest_working_interpreter_is_selected(tmp_path):
    broken, old = tmp_path / "broken", tmp_path / "old"
    broken.write_text("#!/bin/sh\nexit 1\n")
    old.write_text("#!/bin/sh\necho 3.2.1\n")
    for interpreter in (broken, old):
        interpreter.chmod(0o755)
    interpreters = [str(broken), "/nowhere/python3", sys.executable, str(old)]
    assert newest_python.newest(interpreters) == sys.executable
    assert newest_python.version(str(broken)) == ()
    assert newest_python.version(str(old)) == (3, 2, 1)
    assert sys.executable in newest_python.candidates()


@pytest.mark.parametrize("file", TESTS)
def test_a_core_file_and_its_tests_exist(file):
    assert (ROOT / "mechsim" / file).is_file()
    for name in TESTS[file]:
        path, _, function = name.partition("::")
        assert (ROOT / "tests" / path).exists(), path
        assert not function or f"def {function}(" in (ROOT / "tests" / path).read_text(), name


@pytest.mark.parametrize("file", sorted({file for file, _, _ in EQUIVALENT}))
def test_lines_of_equivalent_mutants_exist(file):
    lines = ast.unparse(ast.parse((ROOT / "mechsim" / file).read_text())).splitlines()
    present = {line.strip() for line in lines}
    changes = [(before, after) for name, before, after in EQUIVALENT if name == file]
    assert {before for before, _ in changes} <= present
    assert all(before != after for before, after in changes)
