"""The comparison with other programs: problem, error measure, table and plot; installed peers."""

import csv
import importlib
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from mechsim.errors import InputError

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "validation" / "peers"))

import compare  # noqa: E402
import picture  # noqa: E402
import problem as problems  # noqa: E402
import protocol  # noqa: E402

# a setting of each peer and a bound of its position error: ten times the measured one
BEST = {
    "by_mechsim": ("mechsim, configurations in MuJoCo", 20, 1e-13),
    "by_scipy": ("scipy DOP853, loop by hand", 0, 1e-2),
    "by_exudyn": ("Exudyn index 3, full Newton", 20, 1e-11),
    "by_pinocchio": ("Pinocchio (Python), RK4", 100, 3e-5),
    "by_pinocchio_cpp": ("Pinocchio (C++), Newton", 100, 1e-12),
    "by_pylinkage": ("pylinkage", 100, 1e-13),
}


@pytest.fixture(params=problems.NAMES)
def problem(request):
    return problems.make_problem(request.param)


def solved(module: str, problem, series: str, steps: int):
    peer = importlib.import_module(module)
    setting = next(item for item in peer.settings(problem) if (item.series, item.steps) == (series, steps))
    # floating-point warnings of other packages are ignored
    with np.errstate(all="ignore"):
        _, result = peer.build(problem, setting).run()
    return problems.position_errors(problem, problem.angles(setting.samples), result)


def test_joint_angles_and_points_of_the_closed_form_agree(problem):
    angles = problem.angles(50)
    joints = problem.closed_form.solve(angles).joints
    result = problem.positions(joints["crank"].value, joints["rocker"].value)
    # rounding of a few additions of lengths
    assert problems.position_errors(problem, angles, result).position < 1e-14


def test_the_start_is_closed_with_rates_of_the_closed_form(problem):
    step = 1e-6
    before, after = (problem.closed_form.solve([problem.start + side * step]) for side in (-1.0, 1.0))
    for link in ("crank", "rocker"):
        rate = (after.joints[link].value - before.joints[link].value) / (2.0 * step) * problem.speed
        assert problem.hinge(link).rate == pytest.approx(rate[0], rel=1e-8)
    (at_crank, pin), _ = problem.coupler_ends
    coupler, crank = problem.link("coupler"), problem.hinge("crank")
    tip = crank.path(at_crank, np.array([crank.angle]))[0]
    assert np.abs(coupler.position[0] + coupler.rotation[0] @ pin - tip).max() < 1e-15


def test_wrong_positions_have_their_error(problem):
    angles, exact = problem.angles(20), problem.closed_form
    displaced = {name: position.copy() for name, position in exact.positions(angles).items()}
    next(iter(displaced.values()))[7, 1] += 1e-6 * problem.crank
    longer = problems.make_problem(problem.name, coupler=1.001 * exact.coupler).closed_form.positions(angles)
    other = problems.make_problem(problem.name, branch=-exact.branch).closed_form.positions(angles)
    shifted, length, mode, late = (
        problems.position_errors(problem, angles, result)
        for result in (displaced, longer, other, exact.positions(angles - 1e-3))
    )
    assert shifted.position == pytest.approx(1e-6, rel=1e-6)
    assert length.position > 1e-3
    assert length.rocker > 1e-4
    assert mode.rocker > 0.1
    assert late.position > 0.9e-3


def test_a_wrong_or_delayed_torque_is_rejected(problem):
    angles = problem.angles(20)
    exact = problem.torque(angles)
    assert problems.torque_error(problem, angles, exact) == 0.0
    assert problems.torque_error(problem, angles, 1.001 * exact) == pytest.approx(1e-3)
    assert problems.torque_error(problem, angles, np.roll(exact, 1)) > 0.1
    assert problems.torque_error(problem, angles, exact[1:]) == np.inf
    assert np.isnan(problems.torque_error(problem, angles, None))


@pytest.mark.parametrize("broken", ["short", "missing", "not a number"])
def test_an_incomplete_turn_has_an_infinite_error(problem, broken):
    angles = problem.angles(20)
    (name, first), *others = problem.closed_form.positions(angles).items()
    wrong = {"short": first[:-1], "not a number": np.where(np.arange(21)[:, None] == 3, np.nan, first)}
    result = dict(others) | ({} if broken == "missing" else {name: wrong[broken]})
    assert problems.position_errors(problem, angles, result) == problems.Errors(np.inf, np.inf)


def test_stepping_has_fourth_order_and_the_defaults_large_errors(problem):
    fewer, more = (solved("by_mechsim", problem, "mechsim, stepped (RK4)", n).position for n in (100, 200))
    # 2^4 by the order; the coarser run deviates from it by at most a fifth
    assert 12.0 < fewer / more < 20.0
    assert solved("by_mechsim", problem, "MuJoCo's defaults (Euler)", 1000).position > 1e-3


@pytest.mark.parametrize("module", protocol.PEERS)
def test_each_peer_solves_the_same_problem(problem, module):
    package = protocol.PEERS[module]
    if package is not None:
        pytest.importorskip(package, reason=f"{package} is not installed: {protocol.EXTRA}")
    if not importlib.import_module(module).settings(problem):
        pytest.skip(f"{module} cannot state {problem.name}")
    series, steps, limit = BEST[module]
    assert solved(module, problem, series, steps).position < limit


def test_a_missing_peer_is_reported_and_the_others_run(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "exudyn", None)
    monkeypatch.delitem(sys.modules, "by_exudyn", raising=False)
    with pytest.raises(InputError, match=r"exudyn is not installed.*\[peers\]"):
        protocol.load("by_exudyn")
    monkeypatch.setattr(importlib.import_module("by_mechsim"), "STEPS", (20,))
    rows = compare.measure(("by_exudyn", "by_mechsim"), names=("four_bar",), rounds=1)
    assert "mechsim, configurations in MuJoCo" in {row.series for row in rows}
    output = capsys.readouterr().err.splitlines()
    assert len(output) == 1
    assert ".[peers]" in output[0]


def test_the_extra_installs_every_peer():
    extra = " ".join(
        tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]["peers"]
    )
    brought_by = {"pinocchio": "pin>"}
    for package in filter(None, protocol.PEERS.values()):
        assert brought_by.get(package, package) in extra


def test_table_and_plot_include_failed_rows(tmp_path):
    rows = [
        compare.Row("rssr", "mechsim, configurations in MuJoCo", 20, 1.0, 1e-14, 1e-14, 1e-12),
        compare.Row("rssr", "scipy DOP853, loop by hand", 0, 2.0, 0.0, 0.0, np.nan, "tolerance 1e-13"),
        compare.Row("four_bar", "Pinocchio (C++), Newton", 20, 3.0, np.inf, np.inf, np.nan),
    ]
    compare.write_table(rows, tmp_path / "peers.csv")
    with (tmp_path / "peers.csv").open() as file:
        read = list(csv.DictReader(file))
    assert [float(row["position"]) for row in read] == [row.position for row in rows]
    head, _, *lines = compare.markdown(rows).splitlines()
    assert "rssr: ms a turn" in head
    assert "four_bar: ms a turn" in head
    assert len(lines) == len(rows)
    assert lines[0].split(" | ")[2:6] == ["1", "1.0e-14", "1.0e-14", "1.0e-12"]
    assert "tolerance 1e-13" in lines[1]
    assert "failed" in lines[2]
    assert picture.work_precision(rows).startswith(b"\x89PNG")
