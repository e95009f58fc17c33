"""The command line: outputs, exit codes, one clear line for invalid input."""

import inspect
import json
import re

import numpy as np
import pytest
from processes import python

from mechsim import catalog, cli


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
