"""Numbers without a unit are rejected where a file is in mm; `--units` writes tables in other units."""

import json

import numpy as np
import pytest
from model_files import model_text

from mechsim import files

ARM = model_text("output_units_arm.toml")


@pytest.fixture
def press(file):
    return file(ARM)


def test_cells_of_designs_need_units_for_a_file_in_mm(mechsim, press, tmp_path):
    table = tmp_path / "designs.csv"
    for values, code in (("30mm\n0.04m\n", 0), ("30\n40\n", 2)):
        table.write_text(f"rx\n{values}")
        options = ("--design", str(table), "--measure", "stroke:B", "-o", "s.csv")
        assert mechsim("sweep", press, *options).code == code
    written = (tmp_path / "s.csv").read_text().splitlines()
    assert [float(row.split(",")[0]) for row in written[1:]] == [0.03, 0.04]


@pytest.mark.long
@pytest.mark.parametrize(
    ("units", "length", "angle"),
    [("file", "mm", "deg"), ("cm", "cm", "rad"), ("SI", "m", "rad"), ("deg,in", "in", "deg")],
)
def test_columns_are_labelled_and_written_in_other_units(mechsim, press, units, length, angle, tmp_path):
    metre, radian = (
        {"mm": 1e3, "cm": 1e2, "m": 1.0, "in": 1.0 / 0.0254}[length],
        {"deg": 180.0 / np.pi}.get(angle, 1.0),
    )
    arguments = ("solve", press, "--angles", "0:90:30deg", "--speed", "60rpm")
    plain = json.loads(mechsim(*arguments, "--json").out)["columns"]
    assert mechsim(*arguments, "-o", "t.csv", "--units", units).code == 0
    table = files.read(tmp_path / "t.csv")
    assert len(table) == len(plain)
    np.testing.assert_allclose(table[f"angle [{angle}]"], radian * np.array(plain["angle"]), rtol=1e-14)
    np.testing.assert_allclose(table[f"B.x [{length}]"], metre * np.array(plain["B.x"]), rtol=1e-14)
    np.testing.assert_allclose(table[f"B.ax [{length}/s^2]"], metre * np.array(plain["B.ax"]), rtol=1e-14)
    np.testing.assert_allclose(table[f"A.v [{angle}/s]"], radian * np.array(plain["A.v"]), rtol=1e-14)
    assert mechsim(*arguments, "--units", units).out.splitlines()[0].split(",") == list(table)


def test_a_table_in_other_units_reads_back_as_a_reference(mechsim, press):
    motion = ("--angles", "0:90:30deg", "--speed", "60rpm")
    assert mechsim("solve", press, *motion, "-o", "t.csv", "--units", "file").code == 0
    answer = mechsim("validate", press, "--against", "t.csv", "--speed", "60rpm")
    assert answer.code == 0, answer.out


def test_show_accepts_units(mechsim, press):
    assert "x [mm]" in mechsim("show", press, "--units", "mm").out
    assert "x [m]" in mechsim("show", press).out
