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

# arguments, and words that the message must contain: the subject, the value, the remedy
BAD = {
    "unknown mechanism": ("solve rsr", ["'rsr'", "did you mean 'rssr'"]),
    "unknown parameter": ("solve rssr --set crnk=3mm", ["'crnk'", "did you mean 'crank'"]),
    "no equals sign": ("solve rssr --set crank", ["--set crank=13mm"]),
    "wrong dimension": ("solve rssr --set crank=3deg", ["crank", "3deg", "a length"]),
    "unknown unit": ("solve rssr --set crank=3parrots", ["parrots"]),
    "negative length": ("solve rssr --set crank=-3mm", ["crank", "-0.003", "above 0"]),
    "zero length": ("solve rssr --set crank=0", ["crank", "above 0"]),
    "nan length": ("solve rssr --set crank=nan", ["crank", "nan"]),
    "infinite length": ("solve rssr --set crank=inf", ["crank", "inf"]),
    "nan angle": ("solve rssr --set gamma1=nan", ["gamma1", "nan"]),
    "vector too short": ("solve rssr --set pivot=1,2mm", ["pivot", "give 3"]),
    "no such branch": ("solve rssr --set branch=2", ["branch", "1 or -1"]),
    "guide neither on nor off": ("solve rssr --set guide=maybe", ["guide", "on or off"]),
    "closes nowhere": ("solve rssr --set coupler=1mm", ["close", "change the dimensions"]),
    "closes nowhere, simulated": ("simulate rssr --set coupler=1mm", ["close", "change the dimensions"]),
    "closes over part of the turn": (
        "solve rssr --set rocker=9mm --angles 0:360:5deg",
        ["from 2.3", "to 6.39"],
    ),
    "part of the turn, simulated": ("simulate rssr --set rocker=9mm --turns 1", ["from 2.3", "to 6.39"]),
    "speed zero": ("solve rssr --speed 0rpm", ["0rpm", "other than 0"]),
    "speed too high": ("simulate rssr --speed 1e300rpm", ["1e300rpm", "1e+09"]),
    "speed too low": ("validate rssr --speed 1e-300rpm", ["1e-300rpm", "0.0001"]),
    "speed is a length": ("solve rssr --speed 3mm", ["3mm", "600 rpm"]),
    "step larger than the turn": ("simulate rssr --timestep 1s", ["1 s", "0.1 s"]),
    "step too short": ("simulate rssr --timestep 1e-300", ["1e-300 s", "at the least"]),
    "too many steps": (
        "simulate rssr --setting steps_per_turn=1000000000000",
        ["1e+12", "the limit is 100,000,000 per run"],
    ),
    "too many turns": ("simulate rssr --turns 1e9", ["1e+09 turns", "at the most"]),
    "too many records": ("simulate rssr --samples 360000000000001", ["3.6e+14", "at the most"]),
    "step zero": ("simulate rssr --timestep 0", ["time step"]),
    "two steps a turn": ("simulate rssr --setting steps_per_turn=2", ["at least 4"]),
    "both kinds of step": ("simulate rssr --setting steps_per_turn=100 --timestep 1ms", ["one of them"]),
    "tolerance with step": ("simulate rssr --tolerance 1um --timestep 1ms", ["leave out"]),
    "tolerance zero": ("simulate rssr --tolerance 0", ["tolerance", "above 0"]),
    "unknown integrator": ("simulate rssr --setting integrator=verlet", ["verlet", "RK4"]),
    "solref of one number": ("simulate rssr --setting solref=1", ["setting solref", "give 2"]),
    "no turns": ("simulate rssr --turns 0", ["turns", "above 0"]),
    "invalid turns": ("simulate rssr --turns many", ["--turns"]),
    "unknown method": ("simulate rssr --method guess", ["guess", "pose"]),
    "unknown scene": ("export rssr --scene sea", ["sea", "motion"]),
    "joint that cannot be cut": ("export rssr --cut Q", ["'Q'", "P2, P3"]),
    "unknown extension": ("solve rssr -o out.xls", [".xls", ".csv"]),
    "unknown model extension": ("export rssr -o out.urdf", [".urdf", ".xml"]),
    "unknown picture extension": ("render rssr -o out.bmp", [".bmp", ".png"]),
    "missing folder": ("solve rssr -o nowhere/out.csv", ["nowhere"]),
    "output is a folder": ("solve rssr -o .", ["'.'", "is a folder", "file name"]),
    "report into a file": (f"validate rssr --report {__file__}", [__file__, "name a folder"]),
    "report in a missing folder": ("validate rssr --report no/out", ["'no'", "create it first"]),
    "missing profile": ("simulate rssr --profile no.csv", ["no.csv"]),
    "angle step of zero": ("solve rssr --angles 0:360:0deg", ["0:360:0deg"]),
    "invalid angles": ("solve rssr --angles a:b:c", ["a:b:c"]),
    "unknown command": ("solv rssr", ["solv"]),
    "unknown option": ("solve rssr --colour red", ["--colour"]),
    "nothing to solve": ("solve", ["MODEL"]),
    "export of nothing": ("export", ["MODEL"]),
    "set without a name": ("validate --set crank=1mm", ["name it"]),
    "unknown camera": ("render rssr -o a.png --camera up", ["up", "iso"]),
    "invalid size": ("render rssr -o a.png --size big", ["big", "960x720"]),
    "unknown driver": ("show four_bar --driver engine", ["engine"]),
}


@pytest.mark.long
@pytest.mark.parametrize("case", BAD)
def test_invalid_input_gives_one_line_and_no_files(case: str, mechsim: Call, tmp_path: Path) -> None:
    arguments, words = BAD[case]
    answer = mechsim(*arguments.split())
    assert answer.code == 2
    assert answer.out == ""
    assert len(answer.err.strip().splitlines()) == 1
    assert "Traceback" not in answer.err
    for word in words:
        assert word in answer.err
    assert list(tmp_path.iterdir()) == []


def test_an_invalid_table_is_rejected_with_line_and_column(mechsim: Call, tmp_path: Path) -> None:
    for text, words in {
        "time,angle\n0,0\n1,x\n": ["'x'", "line 3", "'angle'"],
        "time,angle\n0,0\n1\n": ["line 3", "1 values", "2 names"],
        "time,angle,angle\n0,0,0\n1,1,1\n": ["'angle'", "twice"],
    }.items():
        (tmp_path / "profile.csv").write_text(text)
        answer = mechsim("simulate", "rssr", "--profile", "profile.csv")
        assert answer.code == 2
        assert len(answer.err.strip().splitlines()) == 1
        assert all(word in answer.err for word in words)
    (tmp_path / "profile.csv").write_bytes(b"\xff\xfe\x00")
    assert "it is not text" in mechsim("simulate", "rssr", "--profile", "profile.csv").err


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


def test_a_profile_drives_the_crank_along_it(mechsim: Call, tmp_path: Path) -> None:
    time = np.linspace(0.0, 0.2, 41)
    np.savez(tmp_path / "crank.npz", time=time, angle=0.5 * np.sin(30.0 * time))
    assert mechsim("simulate", "rssr", "--profile", "crank.npz", "-o", "run.npz").code == 0
    table = files.read(tmp_path / "run.npz")
    assert np.abs(table["angle"] - 0.5 * np.sin(30.0 * table["t"])).max() < 1e-4


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
