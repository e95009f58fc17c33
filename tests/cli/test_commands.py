"""The command line: outputs, exit codes, one clear line for invalid input."""

import inspect
import json
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typed_call import Call

from mechsim import __version__, catalog, cli, files


def test_an_invalid_table_is_rejected_with_line_and_column(mechsim: Call, tmp_path: Path) -> None:
    for text, words in {
        "time,angle\n0,0\n1,x\n": ["'x'", "line 3", "'angle'"],
        "time,angle\n0,0\n1\n": ["line 3", "1 values", "2 names"],
        "time,angle,angle\n0,0,0\n1,1,1\n": ["'angle'", "twice"],
    }.items():
        (tmp_path / "profile.csv").write_text(text)
        answer = mechsim("simulate", "rssr", "--drive", "crank=profile.csv")
        assert answer.code == 2
        assert len(answer.err.strip().splitlines()) == 1
        assert all(word in answer.err for word in words)
    (tmp_path / "profile.csv").write_bytes(b"\xff\xfe\x00")
    assert "it is not text" in mechsim("simulate", "rssr", "--drive", "crank=profile.csv").err


def test_loop_errors_fail_without_a_requested_tolerance(
    mechsim: Call,
) -> None:
    settings = ["solref=0.02,1", "solimp=0.9,0.95,0.001,0.5,2", "integrator=Euler"]
    defaults = [word for setting in settings for word in ("--setting", setting)]
    answer = mechsim("simulate", "rssr", "--timestep", "20ms", "--compliance", "1", *defaults)
    assert answer.code == 1
    assert answer.out.splitlines()[0].split() == ["rssr", "MuJoCo,", "stepped", "FAIL"]
    answer = mechsim("simulate", "rssr", "--method", "step", "--json")
    assert answer.code == 0
    # 1e-4 of the stroke, which is close to the crank length of 14 mm
    assert 1.2e-6 <= json.loads(answer.out)["tolerance"] < 4e-6


def test_two_reachable_ranges_of_a_crank_are_reported(mechsim: Call) -> None:
    arguments = ["show", "four_bar", "--set", "crank=90mm"]
    first, second = json.loads(mechsim(*arguments, "--json").out)["crank_range"]
    assert first[0] < first[1] < second[0] < second[1]
    assert "no assembly at crank angle 180 deg" in mechsim(*arguments, "--angle", "180deg").out


def test_mechsim_without_a_command_shows_the_help(mechsim: Call) -> None:
    answer = mechsim()
    assert answer.code == 0
    assert "simulate" in answer.out


@pytest.mark.long
@pytest.mark.parametrize("name", catalog.MECHANISMS)
def test_show_lists_every_assembly_mode(name: str, mechsim: Call) -> None:
    result = json.loads(mechsim("show", name, "--angle", "30deg", "--json").out)
    assert result["mobility"] == (2 if name == "rssr" else 1)
    assert result["crank_range"] == "full turn"
    # a Bennett linkage has one assembly mode
    assert len(result["assemblies"]) >= (1 if name == "bennett" else 2)
    chosen = catalog.make(name).positions([np.deg2rad(30.0)])
    gaps = [
        max(
            float(np.abs(np.array(item["points"][point]) - position[0]).max())
            for point, position in chosen.items()
        )
        for item in result["assemblies"]
    ]
    # the selected assembly mode is listed once
    assert sum(gap < 1e-12 for gap in gaps) == 1
    assert result["name"] in mechsim("show", name).out


def test_show_reports_the_range_of_a_swinging_crank(mechsim: Call) -> None:
    result = json.loads(mechsim("show", "rssr", "--set", "rocker=9mm", "--json").out)
    low, high = result["crank_range"]
    assert 2.30 < low < 2.31
    assert 6.39 < high < 6.40
    assert result["dead_centres"] == [low, high]


@pytest.mark.parametrize("extension", [".csv", ".npz"])
def test_solve_writes_the_documented_columns_in_si(extension: str, mechsim: Call, tmp_path: Path) -> None:
    words = ["solve", "rssr", "--angles", "0:360:5deg", "--speed", "600rpm", "--set", "crank=14mm"]
    assert mechsim(*words, "-o", f"out{extension}").code == 0
    table = files.read(tmp_path / f"out{extension}")
    points = ("P2", "P3")
    expected = [f"{p}.{k}{axis}" for p in points for k in ("", "v", "a") for axis in "xyz"]
    joints = [f"{j}.{k}" for j in ("crank", "rocker") for k in "qva"]
    assert list(table) == ["angle", *expected, *joints]
    np.testing.assert_allclose(table["crank.v"], 20.0 * np.pi, rtol=1e-14)
    assert len(table["angle"]) == 73
    np.testing.assert_allclose(np.hypot(table["P2.y"], table["P2.z"]), 0.014, rtol=1e-15)
    np.testing.assert_allclose(np.hypot(table["P2.vy"], table["P2.vz"]), 0.014 * 20.0 * np.pi, rtol=1e-14)


def test_simulate_prints_one_json_object_and_writes_time(mechsim: Call, tmp_path: Path) -> None:
    words = ["simulate", "rssr", "--speed", "600rpm", "--turns", "2", "--tolerance", "1e-6", "--json"]
    answer = mechsim(*words, "-o", "run.npz")
    assert answer.code == 0
    output = json.loads(answer.out)
    assert output["outcome"] == "passed"
    assert output["tolerance"] == 1e-6
    assert 0.0 < output["estimate"] <= 1e-6
    assert output["steps"] > 0
    assert output["seconds"] > 0.0
    assert output["settings"]["integrator"] == "RK4"
    table = files.read(tmp_path / "run.npz")
    assert next(iter(table)) == "t"
    exact = catalog.make("rssr").positions(table["angle"])["P3"]
    gap = np.stack([table[f"P3.{axis}"] for axis in "xyz"], 1) - exact
    assert np.linalg.norm(gap, axis=1).max() <= 1e-6


PARALLELOGRAM = [
    argument
    for text in ("ground=0.1", "crank=0.045", "coupler=0.1", "rocker=0.045")
    for argument in ("--set", text)
]


def test_branch_policy_keeps_the_branch_and_stepping_is_rejected(mechsim: Call, tmp_path: Path) -> None:
    table = str(tmp_path / "turn.csv")
    assert mechsim("solve", "four_bar", *PARALLELOGRAM, "--change-point", "branch", "-o", table).code == 0
    result = files.read(table)
    exact = catalog.make(
        "four_bar", ground=0.1, crank=0.045, coupler=0.1, rocker=0.045, change_point="branch"
    )
    points = {name: np.column_stack([result[f"{name}.{axis}"] for axis in "xyz"]) for name in ("A", "B")}
    assert (exact.assembly_sign(points) >= -1e-15).all()
    rejected = mechsim("solve", "four_bar", *PARALLELOGRAM, "--change-point", "past")
    assert rejected.code == 2
    assert "smooth or branch" in rejected.err
    reported = mechsim("simulate", "four_bar", *PARALLELOGRAM, "--method", "step")
    assert reported.code == 2
    assert "starts at crank angle 0 rad, where two assemblies meet and dynamics alone do not" in reported.err


def test_a_table_drives_the_crank_along_it(mechsim: Call, tmp_path: Path) -> None:
    time = np.linspace(0.0, 0.2, 41)
    np.savez(tmp_path / "crank.npz", time=time, angle=0.5 * np.sin(30.0 * time))
    assert mechsim("simulate", "rssr", "--drive", "crank=crank.npz", "-o", "run.npz").code == 0
    table = files.read(tmp_path / "run.npz")
    assert np.abs(table["crank"] - 0.5 * np.sin(30.0 * table["t"])).max() < 1e-4


@pytest.mark.long
def test_validate_prints_only_the_documented_json(mechsim: Call) -> None:
    answer = mechsim("validate", "rssr", "four_bar", "--json")
    assert answer.code == 0
    output = json.loads(answer.out)
    assert output["passed"] is True
    assert list(output["mechanisms"]) == ["rssr", "four_bar"]
    for case in output["mechanisms"].values():
        assert case["outcome"] == "passed"
        assert case["steps"] > 0
        for check in case["checks"]:
            assert set(check) >= {
                "quantity",
                "unit",
                "worst",
                "at",
                "method",
                "tolerance",
                "reason",
                "passed",
            }
            assert check["passed"] is (check["worst"] <= check["tolerance"])


def test_validate_reports_an_unassemblable_mechanism(mechsim: Call) -> None:
    answer = mechsim("validate", "rssr", "--set", "coupler=1mm", "--json")
    assert answer.code == 2
    assert json.loads(answer.out)["mechanisms"]["rssr"]["outcome"] == "cannot assemble"
    assert len(answer.err.strip().splitlines()) == 1


@pytest.mark.long
def test_doctor_names_versions_back_ends_and_ffmpeg(mechsim: Call) -> None:
    output = json.loads(mechsim("doctor", "--json").out)
    assert output["versions"]["mujoco"]
    assert {row["name"] for row in output["opengl"]} >= {"egl", "osmesa"}
    assert output["ffmpeg"]


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_is_listed_with_its_complete_summary(name: str, mechsim: Call) -> None:
    output = inspect.getdoc(cli.load_command(name).callback) or ""
    assert re.fullmatch(r"[A-Z].*\.", output.split("\n\n")[0], re.DOTALL)
    line = next(line for line in mechsim("--help").out.splitlines() if line.startswith(f"  {name} "))
    assert line.split(maxsplit=len(name.split()))[-1] == cli.COMMANDS[name][1]


def test_the_package_runs_as_a_module() -> None:
    completed = subprocess.run(
        [sys.executable, "-m", "mechsim", "--version"], capture_output=True, text=True, check=False
    )
    assert completed.stdout.strip() == __version__


HEAVY = {"scipy", "matplotlib", "mediapy", "pint", "networkx", "jinja2"}


def loaded_by(*arguments: str) -> set[str]:
    """Return the packages loaded after these commands."""
    code = (
        "import sys\n"
        "from mechsim.cli import main\n"
        f"for words in {arguments!r}:\n"
        "    sys.argv = ['mechsim', *words.split()]\n"
        "    try: main()\n"
        "    except SystemExit as ended: assert not ended.code, words\n"
        "print('loaded', *{name.partition('.')[0] for name in sys.modules})"
    )
    completed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(completed.stdout.splitlines()[-1].split())


def test_help_imports_no_heavy_library() -> None:
    # the time is a benchmark; this test asserts its cause
    assert not loaded_by("--help") & (HEAVY | {"numpy", "mujoco"})


@pytest.mark.long
def test_common_units_and_analytic_commands_import_no_heavy_library() -> None:
    usual = loaded_by("show four_bar", "solve four_bar --set crank=41mm --speed 300rpm --angles 0:360:45deg")
    assert not usual & {"pint", "xarray", "scipy", "matplotlib", "mediapy", "mujoco"}


@pytest.mark.long
def test_a_killed_run_leaves_no_partial_file(tmp_path: Path) -> None:
    code = "from mechsim.cli import main; import sys; sys.argv = ['mechsim', *sys.argv[1:]]; main()"
    words = ["solve", "rssr", "--angles", "0:3600:0.01deg", "-o", str(tmp_path / "out.csv")]
    process = subprocess.Popen([sys.executable, "-c", code, *words])
    while process.poll() is None and not any(tmp_path.iterdir()):
        time.sleep(0.005)
    process.kill()
    process.wait()
    # the file is complete or absent
    if (tmp_path / "out.csv").exists():
        assert len(files.read(tmp_path / "out.csv")["angle"]) == 360_001


SWINGS = ("four_bar", "--set", "rocker=35mm")
END = 2.43123


def test_solve_and_simulate_cover_one_swing_with_a_note(mechsim):
    answer = mechsim("solve", *SWINGS, "--json")
    assert answer.code == 0, answer.err
    angles = np.array(json.loads(answer.out)["columns"]["angle"])
    assert [angles.min(), angles.max()] == pytest.approx([-0.9 * END, 0.9 * END], rel=1e-5)
    assert "the crank swings, its reachable range is -139.299 to 139.299 deg" in answer.err
    run = mechsim("simulate", *SWINGS, "-o", "run.csv")
    assert run.code == 0, run.err
    assert "reachable range is -139.299 to 139.299 deg" in run.err
    swung = np.genfromtxt("run.csv", delimiter=",", names=True, deletechars="")["angle"]
    assert [swung.min(), swung.max()] == pytest.approx([-0.9 * END, 0.9 * END], rel=1e-5)
