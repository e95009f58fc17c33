"""The compliance of loops is changed if no number of steps satisfies a tolerance."""

import pytest
from model_files import FOLDER

import mechsim as ms
from mechsim.simulation import simulate
from mechsim.simulation.position_tolerance import improving_compliance
from mechsim.simulation.settings import COMPLIANCE

# a slow five-bar under gravity: the loop-closure error is proportional to the square of the period
FIVE_BAR = str(FOLDER / "compliance_search_five_bar.xml")
DRIVES = {"left": "0.11*sin(2*pi*t/100)", "right": "0.13*sin(2*pi*t/100)"}
TOLERANCE = 2e-11


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


def test_a_slow_motion_under_gravity_gets_stiffer_loops():
    run = simulate(ms.load(FIVE_BAR, drive=DRIVES, duration=100.0), tolerance=TOLERANCE)
    assert run.outcome == "passed"
    assert run.estimate <= TOLERANCE
    assert run.settings.compliance < 0.1 * COMPLIANCE
    assert f"compliance {run.settings.compliance:.2g}: 1e-08 leaves a position error of" in run.note


@pytest.mark.long
def test_a_failed_run_with_a_requested_compliance_suggests_a_better_one():
    model = ms.load(FIVE_BAR, drive=DRIVES, duration=100.0)
    failed = simulate(model, tolerance=TOLERANCE, settings=ms.Settings(compliance=1e-8))
    assert (failed.outcome, failed.settings.compliance) == ("failed", 1e-8)
    better = float(failed.note.partition("and by compliance ")[2].split()[0])
    run = simulate(model, tolerance=TOLERANCE, settings=ms.Settings(compliance=better))
    assert run.outcome == "passed", run
