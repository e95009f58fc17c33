import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.errors import MissingToolError
from mechsim.render import backend

EXAMPLE = Path(__file__).parents[1] / "examples" / "first_steps.ipynb"


@pytest.fixture(scope="module")
def run():
    return ms.simulate(ms.catalog.make("rssr", rocker=0.03).mechanism, speed=60.0, tolerance=1e-6)


def shown(cell, names):
    """Run a cell as a notebook does; return what its last line is worth."""
    tree = ast.parse(cell)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def test_the_example_notebook_runs_and_everything_in_it_shows_itself(monkeypatch):
    try:
        backend.choose()
    except MissingToolError as missing:
        pytest.skip(str(missing))
    # films of full size take their time
    plain = ms.show
    monkeypatch.setattr(
        ms,
        "show",
        lambda *args, **look: plain(*args, frames_per_turn=3, size=(96, 72), **look),
        raising=False,
    )
    cells = json.loads(EXAMPLE.read_text(encoding="utf-8"))["cells"]
    names: dict[str, object] = {}
    values = [shown("".join(cell["source"]), names) for cell in cells if cell["cell_type"] == "code"]
    pages = [value._repr_html_() for value in values if hasattr(value, "_repr_html_")]
    assert [page[:6] for page in pages] == ["<p sty", "<p sty", "<video", "<video"]
    assert all(cell.get("outputs", []) == [] for cell in cells)


def test_a_run_shows_its_outcome_its_settings_and_its_motion(run):
    page = run._repr_html_()
    assert "<svg" in page
    for word in ("met", "RK4", "steps per turn"):
        assert word in page
    assert "#a8261a" in replace(run, outcome="missed")._repr_html_()


def test_a_verdict_shows_every_check_and_condemns_in_red(run):
    drive = ms.catalog.make("rssr", rocker=0.03)
    good = ms.crosscheck(run.motion, drive)
    assert good._repr_html_().count("<tr") == len(good.checks) + 1
    bad = ms.crosscheck(run.motion, replace(drive, rocker=0.0301))
    assert not bad.passed
    assert "missed" in bad._repr_html_()
    assert 'style="color:#a8261a"' in bad._repr_html_()


def test_what_a_table_holds_cannot_smuggle_markup():
    verdict = ms.Verdict("missed", (), "<script>")
    assert "<script>" not in verdict._repr_html_()
    assert np.isfinite(len(verdict._repr_html_()))
