"""The command line: outputs, exit codes, one clear line for invalid input."""

import inspect
import json
import re
import shlex

import numpy as np
import pytest
from processes import python
from valid_scene import SOUND

from mechsim import catalog, cli, files
from mechsim.cli import examples
from mechsim.errors import InputError


def test_a_table_that_is_no_text_is_rejected(mechsim, tmp_path):
    (tmp_path / "profile.csv").write_bytes(b"\xff\xfe\x00")
    assert "it is not text" in mechsim("simulate", "rssr", "--drive", "crank=profile.csv").err


@pytest.mark.long
@pytest.mark.parametrize("name", catalog.MECHANISMS)
def test_show_lists_every_assembly_mode(name, mechsim):
    result = json.loads(mechsim("show", name, "--angle", "30deg", "--json").out)
    assert result["mobility"] == (2 if name == "rssr" else 1)
    assert result["crank_range"] == "full turn"
    # a Bennett linkage has one assembly mode
    assert len(result["assemblies"]) >= (1 if name == "bennett" else 2)
    chosen = catalog.make(name).positions([np.deg2rad(30.0)])
    gaps = [
        max(np.abs(item["points"][point] - position[0]).max() for point, position in chosen.items())
        for item in result["assemblies"]
    ]
    # the selected assembly mode is listed once
    assert sum(gap < 1e-12 for gap in gaps) == 1
    assert result["name"] in mechsim("show", name).out


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_is_listed_with_its_complete_summary(name, mechsim):
    output = inspect.getdoc(cli.load_command(name).callback) or ""
    assert re.fullmatch(r"[A-Z].*\.", output.split("\n\n")[0], re.DOTALL)
    line = next(line for line in mechsim("--help").out.splitlines() if line.startswith(f"  {name} "))
    assert line.split(maxsplit=len(name.split()))[-1] == cli.COMMANDS[name][1]


HEAVY = {"scipy", "matplotlib", "mediapy", "pint", "networkx", "jinja2"}


def loaded_by(*arguments):
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
    return set(python("-c", code).stdout.splitlines()[-1].split())


def test_help_imports_no_heavy_library():
    # the time is a benchmark; this test asserts its cause
    assert not loaded_by("--help") & (HEAVY | {"numpy", "mujoco"})


@pytest.mark.long
def test_common_units_and_analytic_commands_import_no_heavy_library():
    usual = loaded_by("show four_bar", "solve four_bar --set crank=41mm --speed 300rpm --angles 0:360:45deg")
    assert not usual & {"pint", "xarray", "scipy", "matplotlib", "mediapy", "mujoco"}


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_help_names_types_fits_eighty_columns_and_ends_with_two_examples(name, mechsim):
    out = mechsim(*name.split(), "--help").out
    assert not re.search(r"<(str|int|float|text)>", out)
    assert max(map(len, out.splitlines())) <= 80
    lines = examples(cli.load_command(name).help)
    assert len(lines) >= 2
    assert out.splitlines()[-len(lines) :] == [f"  {line}" for line in lines]


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_examples_use_existing_options(name):
    command = cli.load_command(name)
    for line in examples(command.help):
        words = shlex.split(line)
        count = 1 + len(name.split())
        assert words[:count] == ["mechsim", *name.split()]
        # raises for an unknown option or a missing argument
        command.make_context(name, words[count:])


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


DRIVEN = ("--drive", "crank=0.3*sin(2*pi*t)", "--duration", "0.1")


def test_a_late_rejection_writes_no_file(mechsim, file, tmp_path, monkeypatch):
    def reject(*_):
        raise InputError("no")

    for function in ("scene_findings", "loss_of_significance"):
        with monkeypatch.context() as patched:
            patched.setattr(f"mechsim.cli.simulate.{function}", reject)
            code, _, err = mechsim("simulate", file(SOUND), *DRIVEN, "-o", "run.csv")
        assert (code, err) == (2, "mechsim: no\n")
        assert not (tmp_path / "run.csv").exists()
