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


def test_a_table_that_is_no_text_is_rejected(mechsim: Call, tmp_path: Path) -> None:
    (tmp_path / "profile.csv").write_bytes(b"\xff\xfe\x00")
    assert "it is not text" in mechsim("simulate", "rssr", "--drive", "crank=profile.csv").err


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
