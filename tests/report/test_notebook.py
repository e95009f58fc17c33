import ast
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drawing import draws

import mechsim as ms
from mechsim.errors import MissingToolError
from mechsim.pictures.render import gl_backend
from mechsim.report import notebook

EXAMPLE = Path(__file__).parents[2] / "examples" / "first_steps.ipynb"


@pytest.fixture(scope="module")
def run():
    return ms.simulate(ms.catalog.make("rssr", rocker=0.03).mechanism, speed=60.0, tolerance=1e-6)


def page_of(value):
    """Return what IPython shows of a value, as registered with it."""
    for (module, name), (_, page) in notebook.SHOWN.items():
        if (type(value).__module__, type(value).__name__) == (module, name):
            return page(value)
    return value._repr_html_() if hasattr(value, "_repr_html_") else ""


def value_of(cell, names):
    """Run a cell as a notebook does; return the value of its last line."""
    tree = ast.parse(cell)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.slow
def test_the_example_notebook_runs_and_displays_its_results(monkeypatch):
    try:
        gl_backend.choose()
    except MissingToolError as missing:
        pytest.skip(str(missing))
    # animations of full size are slow
    plain = ms.show
    monkeypatch.setattr(
        ms,
        "show",
        lambda *args, **look: plain(*args, frames_per_turn=3, size=(96, 72), **look),
        raising=False,
    )
    cells = json.loads(EXAMPLE.read_text(encoding="utf-8"))["cells"]
    names: dict[str, object] = {}
    values = [value_of("".join(cell["source"]), names) for cell in cells if cell["cell_type"] == "code"]
    pages = [page_of(value) for value in values if page_of(value)]
    assert [page[:6] for page in pages] == ["<p sty", "<p sty", "<video", "<video"]
    assert all(cell.get("outputs", []) == [] for cell in cells)


@pytest.mark.long
def test_a_run_displays_outcome_settings_and_motion(run):
    page = page_of(run)
    assert "<svg" in page
    for word in ("passed", "RK4", "steps per turn"):
        assert word in page
    assert "#a8261a" in page_of(replace(run, outcome="failed"))


def test_a_verdict_displays_every_check_and_failures_in_red(run):
    linkage = ms.catalog.make("rssr", rocker=0.03)
    agreeing = ms.crosscheck(run.motion, linkage)
    assert page_of(agreeing).count("<tr") == len(agreeing.checks) + 1
    bad = ms.crosscheck(run.motion, linkage.with_parameters(rocker=0.0301))
    assert not bad.passed
    assert "failed" in page_of(bad)
    assert 'style="color:#a8261a"' in page_of(bad)


def test_table_contents_are_escaped():
    verdict = ms.Verdict("failed", (), "<script>")
    assert "<script>" not in page_of(verdict)
    assert np.isfinite(len(page_of(verdict)))


@pytest.mark.long
def test_a_model_is_displayed_as_an_interactive_view():
    value_of = ms.show(ms.load("four_bar"), height=500)
    framed = value_of._repr_html_()
    assert framed.startswith("<iframe srcdoc=")
    assert 'height="500"' in framed
    assert value_of.text.startswith("<!doctype html>")
    assert "<!doctype" not in framed  # a nested page is escaped
    by_loops = ms.show(ms.catalog.make("four_bar").mechanism)
    assert "loop equations" in by_loops.text
    assert ms.show("four_bar", height=500) == value_of
    with pytest.raises(ms.InputError, match=r"there is no mechanism 'four_bat'; did you mean 'four_bar'"):
        ms.show("four_bat")


@pytest.mark.long
def test_results_have_a_short_text_and_a_table():
    solver = ms.catalog.make("four_bar")
    validation = ms.validate("four_bar")
    for result in (validation, validation.verdict):
        assert 2 <= len(repr(result).splitlines()) <= 8
        assert repr(result).endswith(f"and {len(str(result).splitlines()) - 7} more; print lists all")
        assert notebook.result_html(result).count("<tr") == 1 + len(result.checks)
    motion = solver.solve(np.linspace(0.0, 1.0, 9), 1.0)
    assert len(repr(motion).splitlines()) <= 8
    assert "<svg" in notebook.motion_html(motion)


@pytest.mark.long
@draws
def test_render_is_a_function(tmp_path):
    small = {"size": (96, 72)}
    still = ms.render("slider_crank", tmp_path / "slider.png", angle=0.7, **small)
    assert still._repr_png_() == (tmp_path / "slider.png").read_bytes()
    assert still._repr_png_()[:8] == b"\x89PNG\r\n\x1a\n"
    assert ms.render("slider_crank", angle=0.7, **small).data == still.data
    assert ms.render("slider_crank", angle=0.7, camera="top", **small).data != still.data
    solver = ms.catalog.make("slider_crank")
    motion = solver.solve([0.7], 1.0)
    assert ms.render(solver.mechanism, motion=motion, paths=False, **small).data
    assert ms.render("planar_3rrr", tmp_path / "frames", fps=3.0, **small) is None
    assert len(list((tmp_path / "frames").iterdir())) == round(
        3.0 * ms.load("planar_3rrr").motion_laws.duration
    )
    with pytest.raises(ms.InputError, match="there is no camera 'back'"):
        ms.render("slider_crank", camera="back")
    with pytest.raises(ms.InputError, match="jpg"):
        ms.render("slider_crank", tmp_path / "slider.jpg", **small)
    assert len(repr(still)) < 100
