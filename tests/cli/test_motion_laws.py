"""Commands on mechanisms under motion laws: tables, poses, and one line for invalid input."""

import csv
import json

import numpy as np
import pytest
from model_files import model_text

from mechsim import files

ARM = model_text("motion_laws_arm.toml")


@pytest.fixture(autouse=True)
def arm(tmp_path):
    (tmp_path / "arm.toml").write_text(ARM)


MOTION_LAWS = ["--drive", "lift=20mm/s", "--drive", "turn=0.5*sin(3*t)"]


@pytest.mark.parametrize("command", ["solve", "simulate"])
def test_both_methods_follow_the_motion_laws(mechsim, command):
    code, _, output = mechsim(
        command, "arm.toml", *MOTION_LAWS, "--duration", "2s", "--samples", "11", "-o", "out.csv"
    )
    assert code == 0, output
    table = files.read("out.csv")
    time = np.linspace(0.0, 2.0, 11)
    np.testing.assert_allclose(table["t"], time, atol=1e-15)
    np.testing.assert_allclose(table["lift"], 0.02 * time, atol=1e-12)
    angle = 0.5 * np.sin(3 * time)
    np.testing.assert_allclose(table["hand.x"], 0.3 * np.cos(angle), atol=1e-12)
    np.testing.assert_allclose(table["hand.vz"], 0.02, atol=1e-9)
    np.testing.assert_allclose(table["turn.a"], -4.5 * np.sin(3 * time), atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    "command",
    [
        "solve four_bar",
        "solve arm.toml --drive lift=20mm/s --drive turn=1rad/s",
        "simulate four_bar",
        "dynamics inverse four_bar --method none",
        "dynamics inverse four_bar --method none --turns 2.5",
        "dynamics forward four_bar --method none --motor constant:0.5 --turns 0.2",
        "dynamics inverse four_bar --method none --drive crank=1rad/s",
        "dynamics forward four_bar --method none --initial crank.q=30deg --duration 0.1s",
    ],
)
def test_a_table_has_the_requested_number_of_rows(mechsim, command):
    code, _, output = mechsim(*command.split(), "--samples", "9", "-o", "out.csv")
    assert code == 0, output
    table = files.read("out.csv")
    assert len(next(iter(table.values()))) == 9


def test_poses_of_a_table_are_solved_row_by_row(mechsim, tmp_path):
    (tmp_path / "rows.csv").write_text("turn,lift\n0.5,0.1\n-0.2,0.3\n")
    code, out, _ = mechsim("solve", "arm.toml", "--at", "rows.csv")
    assert code == 0
    head, *rows = csv.reader(out.splitlines())
    assert head == ["lift", "turn", "hand.x", "hand.y", "hand.z", "lift.q", "turn.q"]
    result = np.array(rows, dtype=float)
    np.testing.assert_allclose(result[:, 2], 0.3 * np.cos([0.5, -0.2]), atol=1e-15)
    np.testing.assert_allclose(result[:, 4], [0.1, 0.3], atol=1e-15)


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "rows"),
    [("five_bar", "left,right\n2.0,1.0\n2.2,1.1\n2.2,1.1\n1.9,0.8\n"), ("rssr", "crank\n1.0\n-0.5\n7.0\n")],
)
def test_both_methods_solve_the_same_poses_of_a_table(mechsim, tmp_path, model, rows):
    (tmp_path / "rows.csv").write_text(rows)
    tables = []
    for command in ("solve", "simulate"):
        code, _, output = mechsim(command, model, "--at", "rows.csv", "-o", f"{command}.csv")
        assert code == 0, output
        tables.append(files.read(f"{command}.csv"))
    assert len(tables[1]["rocker.q" if model == "rssr" else "P.x"]) == rows.count("\n") - 1
    for name, column in tables[1].items():
        np.testing.assert_allclose(column, tables[0][name], atol=1e-12)


@pytest.mark.parametrize("arguments", [("--speed", "3"), ("--samples", "5"), ("--tolerance", "1um")])
def test_motion_options_with_a_table_of_poses_are_rejected(mechsim, tmp_path, arguments):
    (tmp_path / "rows.csv").write_text("crank\n1.0\n")
    code, _, output = mechsim("simulate", "rssr", "--at", "rows.csv", *arguments)
    assert code == 2
    assert f"{arguments[0]} has no effect with --at" in output
    assert output.count("\n") == 1


def test_show_reports_mobility_under_any_drivers(mechsim):
    def mobility(*arguments):
        code, out, _ = mechsim("show", "arm.toml", "--json", *arguments)
        assert code == 0
        return json.loads(out)["mobility"]

    plain = mobility()
    assert (plain["dofs"], plain["drivers"], plain["open"], plain["redundant"]) == (
        2,
        ["lift", "turn"],
        [],
        0,
    )
    assert mobility("--lock", "lift")["dofs"] == 1


def test_an_export_with_motion_laws_gives_the_same_solution(mechsim):
    assert mechsim("export", "arm.toml", *MOTION_LAWS, "--format", "toml", "-o", "again.toml")[0] == 0
    tables = []
    for model in (["arm.toml", *MOTION_LAWS], ["again.toml"]):
        assert mechsim("solve", *model, "--samples", "5", "-o", "out.csv")[0] == 0
        tables.append(files.read("out.csv"))
    assert tables[0].keys() == tables[1].keys()
    for name, column in tables[0].items():
        np.testing.assert_allclose(tables[1][name], column, atol=1e-14)


def test_driver_errors_beyond_the_tolerance_are_reported(mechsim):
    """Positions are checked at the actual driver positions, which lag within a step."""
    arguments = ("simulate", "four_bar", "--drive", "crank=0.5*sin(6*t)", "--samples", "12", "-o")
    fine = mechsim(*arguments, "found.csv", "--tolerance", "1um")
    coarse = mechsim(*arguments, "coarse.csv", "--tolerance", "1mm")
    assert mechsim(*arguments, "wanted.csv", "--method", "pose").code == 0
    result, expected = files.read("found.csv"), files.read("wanted.csv")
    gaps = [[result[f"{point}.{axis}"] - expected[f"{point}.{axis}"] for axis in "xyz"] for point in "ABC"]
    largest = np.linalg.norm(gaps, axis=1).max()
    assert largest > 1e-6
    assert f"positions differ by up to {largest:.2g} m from those of the motion laws" in fine.out
    assert (fine.code, coarse.code) == (0, 0)
    assert "from those of the motion laws" not in coarse.out
