"""The study of generated solvers for one mechanism."""

import pytest
from speed import compiled_solver


@pytest.fixture(autouse=True)
def cache_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_a_generated_solver_satisfies_the_limits(tmp_path, capsys):
    assert compiled_solver.study("four_bar", tmp_path)
    name, unknowns, *_, error, float_error, _kilobytes = capsys.readouterr().out.strip("| \n").split(" | ")
    assert (name, unknowns) == ("four_bar", "2")
    assert float(error) <= compiled_solver.ALLOWED < 1e-8 < float(float_error) < 1e-5


def test_a_violated_limit_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled_solver, "ALLOWED", 1e-17)
    assert not compiled_solver.study("four_bar", tmp_path)
