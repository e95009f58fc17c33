"""User-defined names are text in every output, never markup, formula or separator."""

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from model_files import model_text
from processes import mechsim_run

import mechsim as ms
from mechsim import files
from mechsim.io.model_source import Prescription
from mechsim.io.toml_reader import TomlModel
from mechsim.io.toml_writer import to_toml
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.pictures.view.offline_page import page
from mechsim.report.views import mechanism_view
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled

# each would break an output without escaping
CRITICAL = (
    "[/]",
    "[bold]",
    r"$\frac{$",
    "a,b",
    'a"b',
    "a'b",
    "</script><b>",
    "../x",
    "_x_",
    "{{x}}",
    "%s",
    "\\",
    "=1+1",
    "😀",
    "a.b",
    "--json",
)
ODD = r"_[/]$\frac{$,</script>../x"
NAMES = st.text(
    st.characters(exclude_categories=["C", "Z"], include_characters=" "), min_size=1, max_size=12
).filter(lambda name: name == name.strip() and name.isprintable())


def renamed(value: Any, names: dict[str, str]) -> Any:
    """Return a value in which names are replaced by those of a table, in all that it contains."""
    if isinstance(value, str):
        return names.get(value, value)
    if isinstance(value, tuple):
        return tuple(renamed(item, names) for item in value)
    if isinstance(value, dict):
        return {renamed(key, names): renamed(item, names) for key, item in value.items()}
    if is_dataclass(value):
        own = (field.name for field in fields(value) if field.init)
        return replace(value, **{name: renamed(getattr(value, name), names) for name in own})
    return value


def named(name: str) -> ms.Mechanism:
    """Return the four-bar with this name, and names derived from it for links, joints and points."""
    mechanism = ms.catalog.make("four_bar").mechanism
    own = [*(item.name for item in (*mechanism.links, *mechanism.joints)), *mechanism.points]
    return renamed(mechanism, {mechanism.name: name} | {text: f"{name}{i}" for i, text in enumerate(own)})


def every_name(test):
    """Run a test with the critical names and with random ones."""
    for name in CRITICAL:
        test = example(name)(test)
    suppressed = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    return settings(max_examples=5, suppress_health_check=suppressed)(given(NAMES)(test))


@pytest.mark.long
@every_name
def test_names_round_trip_through_tables_and_toml(tmp_path, name):
    mechanism = named(name)
    motion = KinematicSolver(mechanism).solve(np.linspace(0.0, 1.0, 3))
    for ending in (".csv", ".npz"):
        files.write(tmp_path / f"motion{ending}", motion)
        assert list(files.read(tmp_path / f"motion{ending}")) == list(dict(motion.columns()))
    (tmp_path / "odd.toml").write_text(to_toml(mechanism), encoding="utf-8")
    read = TomlModel(str(tmp_path / "odd.toml")).describe({}, Prescription()).solver.mechanism
    assert (read.name, read.points, read.drivers) == (mechanism.name, mechanism.points, mechanism.drivers)
    assert [joint.name for joint in read.joints] == [joint.name for joint in mechanism.joints]


@pytest.mark.long
@every_name
def test_names_round_trip_through_mjcf(name):
    mechanism = named(name)
    model = mujoco.MjModel.from_xml_string(to_xml(assembled(mechanism, ms.Scene())))
    assert {model.body(i).name for i in range(1, model.nbody)} == {link.name for link in mechanism.links}
    assert mechanism.points.keys() <= {model.site(i).name for i in range(model.nsite)}


@pytest.mark.long
@settings(max_examples=1, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(NAMES)
@example(r"$\frac{$")
def test_plots_show_names_unchanged(tmp_path, name):
    mechanism = named(name)
    # every breaking name in one legend
    position = (mechanism.links[0].name, (0.01, 0.0, 0.0))
    mechanism = replace(mechanism, points=mechanism.points | dict.fromkeys(CRITICAL, position))
    motion = KinematicSolver(mechanism).solve(np.linspace(0.0, 1.0, 3))
    figure = ms.plots.coupler_curve(mechanism, motion)
    ms.plots.write(tmp_path / "plot.svg", figure)
    ET.parse(tmp_path / "plot.svg")
    (legend,) = [ax.get_legend() for ax in figure.axes]
    assert [text.get_text().strip() for text in legend.get_texts()] == list(motion.points)


def test_a_page_escapes_names():
    name = "</title></script><b>{{x}}"
    text = page(mechanism_view(KinematicSolver(named(name)), 1.0))
    data = re.search(r'<script[^>]*id="data"[^>]*>(.*?)</script>', text, re.DOTALL)[1]
    assert json.loads(data)["name"] == name
    assert "<b>" not in text
    assert text.count("</title>") == 1


@pytest.mark.long
@pytest.mark.parametrize(
    "line",
    [
        "solve odd.toml --angles 0:20:10deg",
        "show odd.toml --angle 30deg",
        pytest.param("plot odd.toml --kind motion -o p.png", marks=pytest.mark.slow),
        "dynamics inverse odd.toml -o p.svg",
        "export odd.toml -o x.xml",
    ],
)
def test_special_names_cause_no_internal_error(mechsim, line):
    Path("odd.toml").write_text(to_toml(named(ODD)), encoding="utf-8")
    reported = mechsim(*line.split())
    assert reported.code == 0, reported.err
    assert "internal error" not in reported.err
    assert "Warning" not in reported.err


@pytest.mark.long
@pytest.mark.parametrize(
    ("variables", "printed"),
    [
        ({"PYTHONIOENCODING": "cp1252"}, r"\u0440\u0443\u043a\u0430"),
        ({"PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONIOENCODING": ""}, "рука"),
    ],
)
def test_names_are_printed_whatever_the_encoding_of_the_system(variables, printed, tmp_path):
    text = model_text("cam_export_cam.toml").replace('"follower"', '"рука"')
    (tmp_path / "cam.toml").write_text(text, encoding="utf-8")
    run = mechsim_run("show", "cam.toml", folder=tmp_path, **variables)
    assert run.returncode == 0, run.stderr
    assert f"guide    prismatic  ground - {printed}" in run.stdout
