"""The worst error is located by crank angle, or by time under motion laws."""

import json
from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.compare.checks import check_of, check_table
from mechsim.compare.tolerances import RecordInstants, Tolerance
from mechsim.files import plain
from mechsim.report.notebook import result_html
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven

# the fastest rate is 0.6 pi rad/s, so that 2 s are 3.8 rad of the normalised time
LAW = {"crank": "0.3*sin(2*pi*t)"}


@pytest.fixture(scope="module")
def swinging():
    return ms.load("four_bar", drive=LAW, duration=2.0)


def bump(angle, by):
    """Return an error of 1 mm at one crank angle."""
    return 1e-3 * np.exp(-(((angle - by) / 0.01) ** 2))[:, None]


def late_motion(motion, by):
    """Return a motion that is off by 1 mm at one crank angle."""
    point = motion.points["B"]
    wrong = replace(point, position=point.position + bump(motion.joints["crank"].value, by))
    return replace(motion, points={"B": wrong}, origin=None)


def test_verdicts_on_motion_laws_report_times(swinging):
    run = ms.simulate(swinging, samples=200)
    verdict = ms.crosscheck(run, late_motion(swinging.solve_as(run.motion), 0.3))
    check = next(item for item in verdict.checks if item.kind == "position")
    assert not check.passed
    assert check.at_unit == "s"
    # the crank is at 0.3 rad at a quarter of each second
    assert min(abs(check.instant - 0.25), abs(check.instant - 1.25)) < 1e-9
    assert {item["at_unit"] for item in plain(verdict)["checks"]} == {"s"}
    assert f"at {check.instant:7.4f} s" in str(check)
    assert "at [s]" in result_html(verdict)


def test_verdicts_on_a_crank_report_crank_angles():
    linkage = ms.catalog.make("four_bar")
    run = ms.simulate(linkage, speed=3.0, samples=72)
    verdict = ms.crosscheck(run, late_motion(linkage.solve_as(run.motion), np.pi / 3))
    check = next(item for item in verdict.checks if item.kind == "position")
    assert (check.instant, check.at_unit) == (pytest.approx(np.pi / 3), "rad")
    assert "at [deg]" in result_html(verdict)
    assert check.columns[2] == "60"


def test_force_checks_on_motion_laws_report_times(swinging):
    run = driven(swinging, samples=20)
    verdict = crosscheck_driven(run, ms.dynamics.dynamic_model(swinging))
    assert {item.at_unit for item in verdict.checks} == {"s"}
    assert max(item.instant for item in verdict.checks) <= 2.0


@pytest.mark.long
def test_checks_of_a_table_without_times_report_rows(tmp_path):
    solver = ms.load("five_bar")
    motion = solver.solve(t=np.linspace(0.0, 1.0, 11))
    position = motion.points["P"].position.copy()
    position[6, 0] += 1e-3
    path = tmp_path / "places.csv"
    columns = [motion.joints[name].value for name in ("left", "right")]
    rows = np.column_stack([*columns, position])
    np.savetxt(path, rows, delimiter=",", header="left,right,P.x,P.y,P.z", comments="", fmt="%.17g")
    result = ms.validate(ms.load("five_bar"), path, stepped=False)
    check = next(item for item in result.checks if not item.passed)
    assert (check.instant, check.at_unit) == (7.0, "row")


def test_a_sweep_with_motion_laws_reports_their_duration():
    table = ms.sweep("five_bar", {"arm": [0.05]}, "max:P.x")
    assert (table.attrs["duration"], table.attrs["duration_units"]) == (1, "s")
    assert "speed" not in table.attrs
    assert json.dumps(table.attrs, default=float)


def test_mixed_instants_are_printed_with_their_units():
    allowed = Tolerance(1.0, "m", "why")
    angle = check_of("position", "A", np.ones(1), np.array([0.5]), allowed)
    time = check_of("position", "B", np.ones(1), RecordInstants(np.array([2.0]), "s"), allowed)
    head, rows = check_table([angle, time])
    assert (head[2], [row[2] for row in rows]) == ("at", ["28.65 deg", "2 s"])
    assert check_table([time])[0][2] == "at [s]"
