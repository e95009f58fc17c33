"""The initial state of a TOML file: read in its units, used by dynamics, written back, and checked."""

import pytest
from model_files import model_text

import mechsim as ms
from mechsim.io.toml_writer import to_toml

TEXT = model_text("initial_table_text.toml")


def written(tmp_path, text=TEXT):
    path = tmp_path / "bar.toml"
    path.write_text(text)
    return str(path)


def test_the_initial_state_is_read_in_units_and_written_back(tmp_path):
    solver = ms.load(written(tmp_path))
    assert solver.initial == pytest.approx({"crank.q": 0.5235987755982988, "crank.v": 2.0})
    again = ms.load(written(tmp_path, to_toml(solver)))
    assert again.initial == solver.initial


def test_an_explicit_initial_state_replaces_that_of_the_file(tmp_path):
    solver = ms.load(written(tmp_path))
    run = ms.dynamics.run(solver, solver.forces, duration=0.01, samples=2)
    assert run.motion.joints["crank"].value[0] == pytest.approx(0.5235987755982988)
    assert run.motion.joints["crank"].rate[0] == pytest.approx(2.0)
    other = ms.dynamics.run(solver, solver.forces, initial={"crank.q": "40deg"}, duration=0.01, samples=2)
    assert other.motion.joints["crank"].value[0] == pytest.approx(0.6981317007977318)


def test_the_dynamics_command_uses_the_initial_state_of_a_file(tmp_path, mechsim):
    line = f"dynamics forward {written(tmp_path)} --duration 0.01s --samples 5 --method none".split()
    answer = mechsim(*line)
    assert answer.code == 0
    assert "done at 0.01 s" in answer.out
