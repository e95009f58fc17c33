"""The compliance of loops is changed if no number of steps satisfies a tolerance."""

import json

import pytest
from model_files import model_text
from typer.testing import CliRunner

import mechsim as ms
from mechsim.cli import app
from mechsim.simulation import simulate
from mechsim.simulation.position_tolerance import improving_compliance
from mechsim.simulation.settings import COMPLIANCE

# a slow five-bar under gravity: the loop-closure error is proportional to the square of the period
FIVE_BAR = model_text("compliance_search_five_bar.xml")
DRIVES = {"left": "0.11*sin(2*pi*t/100)", "right": "0.13*sin(2*pi*t/100)"}
TOLERANCE = 2e-11


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "five_bar.xml"
    file.write_text(FIVE_BAR)
    return str(file)


@pytest.mark.parametrize(
    ("error", "bounds"),
    [
        (lambda h: 0.3 * h, (1e-12, 1e-10)),
        (lambda h: 1e-17 / h, (1e-6, 1e-4)),
        # the second term as soon as it dominates the first
        (lambda h: 1e-7 * h + 1e-17 / h, (1e-6, 1e-4)),
    ],
)
def test_the_compliance_search_follows_the_decreasing_error(error, bounds):
    compliance, remaining = improving_compliance(error, 1e-8, error(1e-8), 1e-11)
    assert bounds[0] <= compliance <= bounds[1]
    assert remaining == error(compliance)
    assert remaining <= 1e-11


def test_a_slow_motion_under_gravity_gets_stiffer_loops(path):
    run = simulate(ms.load(path, drive=DRIVES, duration=100.0), tolerance=TOLERANCE)
    assert run.outcome == "passed"
    assert run.estimate <= TOLERANCE
    assert run.settings.compliance < 0.1 * COMPLIANCE
    assert f"compliance {run.settings.compliance:.2g}: 1e-08 leaves a position error of" in run.note


@pytest.mark.long
def test_a_failed_run_with_a_requested_compliance_suggests_a_better_one(path):
    arguments = [word for name, law in DRIVES.items() for word in ("--drive", f"{name}={law}")]
    arguments = ["simulate", path, *arguments, "--duration", "100s", "--tolerance", "2e-11"]
    output = CliRunner().invoke(app, [*arguments, "--compliance", "1e-8", "--json"])
    assert output.exit_code == 1
    reported = json.loads(output.stdout)
    assert reported["outcome"] == "failed"
    assert reported["settings"]["compliance"] == 1e-8
    better = float(reported["note"].partition("and by compliance ")[2].split()[0])
    with_better_compliance = CliRunner().invoke(app, [*arguments, "--compliance", f"{better:g}"])
    assert with_better_compliance.exit_code == 0, with_better_compliance.output


def test_a_run_without_a_tolerance_reports_the_default_compliance():
    run = simulate(ms.catalog.make("four_bar"), speed=60.0, settings=ms.Settings(steps_per_turn=100))
    assert run.settings.compliance == COMPLIANCE
