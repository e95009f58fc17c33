"""Loops are held harder, or more softly, where no number of steps keeps a tolerance."""

import json

import pytest
from typer.testing import CliRunner

import mechsim as ms
from mechsim import catalog
from mechsim.cli import app
from mechsim.simulation import Settings, simulate
from mechsim.simulation.settings import COMPLIANCE
from mechsim.simulation.tolerance import improving_compliance

# a five-bar that bears its weight slowly: what the loop gives way by is in proportion to the time squared
FIVE_BAR = """<mujoco model="five-bar"><option gravity="0 -9.81 0"/><default><joint axis="0 0 1"/></default>
<worldbody>
<body pos="-.031 0 0"><joint name="left"/><geom size=".012"/>
 <body pos="-.02 .06 0"><joint/><geom pos=".03 .02 0" size=".005"/>
  <site name="P" pos=".055 .04 0"/></body></body>
<body pos=".037 .004 0"><joint name="right"/><geom size=".012"/>
 <body pos=".023 .056 0"><joint/><geom pos="-.02 .02 0" size=".005"/>
  <site name="Q" pos="-.056 .04 0"/></body></body>
</worldbody><equality><connect site1="P" site2="Q"/></equality></mujoco>"""
DRIVES = {"left": "0.11*sin(2*pi*t/100)", "right": "0.13*sin(2*pi*t/100)"}
TOLERANCE = 2e-11


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "five_bar.xml"
    file.write_text(FIVE_BAR)
    return str(file)


@pytest.mark.parametrize(
    ("error", "to"),
    [
        (lambda h: 0.3 * h, (1e-12, 1e-10)),
        (lambda h: 1e-17 / h, (1e-6, 1e-4)),
        # the one as soon as the other is left behind
        (lambda h: 1e-7 * h + 1e-17 / h, (1e-6, 1e-4)),
    ],
)
def test_the_way_is_reported_by_what_is_left(error, to):
    compliance, left = improving_compliance(error, 1e-8, error(1e-8), 1e-11)
    assert to[0] <= compliance <= to[1]
    assert left == error(compliance)
    assert left <= 1e-11


def test_where_compliance_changes_nothing_little_is_tried():
    asked = []
    assert improving_compliance(lambda h: asked.append(h) or 1e-9, 1e-8, 1e-9, 1e-11) is None
    assert len(asked) <= 3
    assert 1e-8 not in asked


def test_a_slow_motion_under_weight_keeps_a_tolerance_by_harder_loops(path):
    run = simulate(ms.load(path, drive=DRIVES, duration=100.0), tolerance=TOLERANCE)
    assert run.outcome == "passed"
    assert run.tolerance_report.satisfied
    assert run.estimate <= TOLERANCE
    assert run.settings.compliance < 0.1 * COMPLIANCE
    assert f"compliance {run.settings.compliance:.2g}: 1e-08 leaves a position error of" in run.note


def test_a_compliance_that_was_requested_for_is_kept_and_the_miss_states_which_would_do(path):
    words = [word for name, how in DRIVES.items() for word in ("--drive", f"{name}={how}")]
    words = ["simulate", path, *words, "--duration", "100s", "--tolerance", "2e-11"]
    output = CliRunner().invoke(app, [*words, "--compliance", "1e-8", "--json"])
    assert output.exit_code == 1
    reported = json.loads(output.stdout)
    assert reported["outcome"] == "failed"
    assert reported["settings"]["compliance"] == 1e-8
    better = float(reported["note"].partition("and by compliance ")[2].split()[0])
    again = CliRunner().invoke(app, [*words, "--compliance", f"{better:g}"])
    assert again.exit_code == 0, again.output


def test_a_run_without_a_tolerance_names_the_compliance_it_had():
    run = simulate(catalog.make("four_bar"), speed=60.0, settings=Settings(steps_per_turn=100))
    assert run.settings.compliance == COMPLIANCE
