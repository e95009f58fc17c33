"""Reference data agree with their script, with published values and with their own derivatives."""

import csv
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import mujoco
import pytest
from grids import grid
from mpmath import mp, mpf

import mechsim as ms
from mechsim.io import gallery, reference_data

ROOT = Path(__file__).resolve().parents[2]
WHERE = ROOT / "reference"
NAMES = reference_data.names(WHERE)


def rows(name):
    with (WHERE / "data" / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def made(name, digits, row):
    """Return a row that the script computes now, in a process that cannot import mechsim."""
    reported = (
        "import sys, json; sys.modules['mechsim'] = None; sys.path.insert(0, sys.argv[1]); import make;"
        "(cell, row), = make.solved(sys.argv[2], int(sys.argv[3]), [int(sys.argv[4])]);"
        "print(json.dumps({'cell': cell} | {key: make.written(one) for key, one in row.items()}))"
    )
    completed = subprocess.run(
        [sys.executable, "-c", reported, str(WHERE), name, str(digits), str(row)],
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(completed.stdout)


@pytest.mark.long
@pytest.mark.parametrize(("name", "row"), grid([("rssr", 3), ("five_bar", 5)]))
def test_the_script_reproduces_its_digits_at_another_precision(name, row):
    again, kept = made(name, 50, row), rows(name)[row]
    assert again.pop("cell") == next(iter(kept.values()))
    with mp.workdps(40):
        for key, item in again.items():
            exact = mpf(kept[key])
            assert abs(mpf(item) - exact) <= abs(exact) * mpf(10) ** -29 + mpf(10) ** -36, key


def test_the_data_cover_catalogue_gallery_and_benchmarks():
    from mechsim import catalog

    # the script solves equations of polynomials; these have couplings by functions
    by_function = {"cam_follower", "geneva_drive"}
    solved = {*catalog.MECHANISMS, *gallery.files(), "spatial_slider_crank", "bricard"}
    assert set(NAMES) == solved - by_function
    reported = json.loads((WHERE / "datapackage.json").read_text())
    tables = [f"data/{name}.csv" for name in NAMES]
    tables += [f"forward/{name}.csv" for name in tomllib.loads((WHERE / "runs.toml").read_text())]
    assert [item["path"] for item in reported["resources"]] == tables
    assert reported["licenses"][0]["name"] == "CC-BY-4.0"
    assert sum(item["bytes"] for item in reported["resources"]) < 15e6


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_mjcf_and_sdf_have_the_points_and_masses_of_the_table(name):
    folder, row = WHERE / "models" / "driven", rows(name)[7]
    driven = {column[:-2]: float(value) for column, value in row.items() if column.endswith(".q")}
    model = mujoco.MjModel.from_xml_path(str(folder / f"{name}.xml"))
    data = mujoco.MjData(model)
    data.qpos[:] = ms.closed_qpos(folder / f"{name}.xml", driven or {"crank": float(row["angle"])})
    mujoco.mj_kinematics(model, data)
    for point in [column[:-2] for column in row if column.endswith(".x")]:
        exact = [float(row[f"{point}.{axis}"]) for axis in "xyz"]
        assert data.site(point).xpos == pytest.approx(exact, abs=1e-12)
    written, stated = (
        {link.name: link.inertia.mass for link in ms.load(path).mechanism.links if link.inertia}
        for path in (folder / f"{name}.sdf", WHERE / "mechanisms" / f"{name}.toml")
    )
    # the halves of a link that is cut by a weld have the mass of the link
    assert sum(model.body_mass) == pytest.approx(sum(stated.values()), rel=1e-9)
    # SDF has no cylindrical joint: a link of 1 mg lies between its two
    assert {name: written[name] for name in stated} == pytest.approx(stated, rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_tables_have_72_rows_of_30_digits_and_valid_checksums(name):
    reference_data.read(WHERE, name)
    result = rows(name)
    assert len(result) == 72
    segments = [segment for row in result for segment in row.values()]
    assert all(segment == "0" or len(re.sub(r"e.*|[-.]", "", segment)) == 30 for segment in segments)


def test_the_spatial_slider_crank_has_its_published_initial_state():
    first = rows("spatial_slider_crank")[0]
    printed = {"slider.x": "0.2", "slider.vx": "0.24", "rod.vx": "0.12", "rod.vy": "-0.24", "rod.vz": "0"}
    with mp.workdps(40):
        for key, value in printed.items():
            assert abs(mpf(first[key]) - mpf(value)) < mpf(10) ** -29


def test_closed_forms_agree_with_the_data():
    with mp.workdps(45):
        for row in rows("scotch_yoke"):
            assert abs(mpf(row["yoke.x"]) - mpf("0.03") * mp.cos(mpf(row["angle"]))) < mpf(10) ** -31
        for row in rows("slider_crank"):
            angle, crank, rod, offset = mpf(row["angle"]), mpf("0.05"), mpf("0.2"), mpf("0.01")
            x = crank * mp.cos(angle) + mp.sqrt(rod**2 - (crank * mp.sin(angle) - offset) ** 2)
            assert abs(mpf(row["B.x"]) - x) < mpf(10) ** -30


def test_the_examples_of_the_readme_run_without_mechsim():
    block, forward = re.findall(r"```python\n(.*?)```", (WHERE / "README.md").read_text(), re.DOTALL)
    assert len([line for line in forward.splitlines() if line]) <= 10
    completed = subprocess.run(
        [sys.executable, "-c", forward], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert 1e-9 < float(completed.stdout.split()[0]) < 1e-7
    assert "mechsim" not in re.sub(r"#.*", "", block)
    assert len([line for line in block.splitlines() if line]) <= 10
    completed = subprocess.run(
        [sys.executable, "-c", block], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert float(completed.stdout.split()[0]) < 1e-15
    wrong = block.replace("0.2**2", "0.2001**2")
    assert subprocess.run([sys.executable, "-c", wrong], cwd=ROOT, capture_output=True).returncode == 1


def test_a_changed_table_is_rejected(tmp_path):
    shutil.copytree(WHERE, tmp_path / "reference")
    path = tmp_path / "reference" / "data" / "four_bar.csv"
    path.write_text(path.read_text().replace("1", "2", 1))
    with pytest.raises(ms.InputError, match="is wrong; download"):
        reference_data.read(tmp_path / "reference", "four_bar")
    with pytest.raises(ms.InputError, match="no reference data of 'sundial'"):
        reference_data.read(WHERE, "sundial")
