"""The core works without optional libraries and reports the command that installs them."""

import json
import re
from types import SimpleNamespace

import pytest
from processes import python

from mechsim import cli
from mechsim.errors import install_command

OPTIONAL = (
    "matplotlib",
    "mediapy",
    "imageio_ffmpeg",
    "jinja2",
    "PIL",
    "pandas",
    "xarray",
)
HIDE = f"""
import sys
from importlib.machinery import PathFinder
real = PathFinder.find_spec
def seen(name, *rest, **more):
    return None if name.partition(".")[0] in {OPTIONAL!r} else real(name, *rest, **more)
PathFinder.find_spec = seen
"""


def run_core(code, cwd):
    """Run Python without optional libraries."""
    return python("-c", HIDE + code, folder=cwd)


def commands(lines, cwd):
    """Run commands in sequence in such a Python; return exit codes and text on stderr."""
    return run_core(
        "import contextlib, io, json\n"
        "from mechsim.cli import main\n"
        "ends = []\n"
        f"for line in {lines!r}:\n"
        "    sys.argv = ['mechsim', *line.split()]\n"
        "    text = io.StringIO()\n"
        "    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(text):\n"
        "        try:\n            main()\n"
        "        except SystemExit as end:\n            code = end.code or 0\n"
        "    ends.append((code, text.getvalue()))\n"
        "print(json.dumps(ends))",
        cwd,
    )


CORE = (
    "solve four_bar --angles 0:360:5deg -o four_bar.csv",
    "simulate four_bar --turns 0.1 -o run.npz",
    "show four_bar",
    "validate slider_crank",
    "export slider_crank --format toml -o slider.toml",
    "doctor",
)
# command -> the missing library in its message
WITH_EXTRAS = {
    "plot four_bar --kind transmission -o plot.svg": "matplotlib",
    "render four_bar -o picture.png": "PIL",
    "validate slider_crank --report out": "",
    "view slider_crank -o view.html": "",
}


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Return the folder of all commands, and exit code and stderr of each."""
    folder = tmp_path_factory.mktemp("core")
    completed = commands([*CORE, *WITH_EXTRAS], folder)
    assert completed.returncode == 0, completed.stderr
    return folder, dict(zip([*CORE, *WITH_EXTRAS], json.loads(completed.stdout), strict=True))


def test_the_core_solves_simulates_and_validates(ended):
    folder, ends = ended
    assert {line: ends[line] for line in CORE if ends[line][0]} == {}
    assert (folder / "four_bar.csv").stat().st_size > 0


def test_commands_with_a_missing_library_report_how_to_install_it(ended):
    folder, ends = ended
    for line, library in WITH_EXTRAS.items():
        code, output = ends[line]
        assert code == 2, line
        reported = output.strip().splitlines()[-1]
        # the command runs in another folder, so that the path of the sources may differ
        assert re.search(r"; pip install .*\[pictures\]' installs it$", reported), (line, output)
        assert f"{library} is not installed" in reported or not library
        assert "Traceback" not in output
    assert {path.name for path in folder.iterdir() if path.is_file()} == {
        "four_bar.csv",
        "run.npz",
        "slider.toml",
    }


@pytest.mark.parametrize("library", ["pandas", "xarray"])
def test_tables_with_a_missing_library_report_how_to_install_it(library, tmp_path):
    code = (
        "import mechsim as ms, numpy as np\n"
        "motion = ms.catalog.make('slider_crank').solve(np.linspace(0.0, 1.0, 3))\n"
        f"motion.to_{library}()"
    )
    completed = run_core(code, tmp_path)
    assert completed.returncode == 1
    expected = rf"{library} is not installed; pip install .*\[tables\]' installs it"
    assert re.search(expected, completed.stderr)


def test_a_failed_import_inside_mechsim_is_no_missing_library():
    from mechsim.errors import MissingToolError, needs

    with pytest.raises(ModuleNotFoundError), needs("pictures"):
        import mechsim.nowhere  # noqa: F401
    with (
        pytest.raises(MissingToolError, match=r"^nowhere is not installed; pip install .*\[pictures\]'"),
        needs("pictures"),
    ):
        import nowhere.at_all  # noqa: F401


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, "pip install 'mechsim[sweep]'"),
        ({"archive_info": {}, "url": "file:///tmp/mechsim.whl"}, "pip install 'mechsim[sweep]'"),
        ({"dir_info": {}, "url": "file:///some%20where/mechsim"}, "pip install '/some where/mechsim[sweep]'"),
        ({"dir_info": {"editable": True}, "url": "file:///src"}, "pip install -e '/src[sweep]'"),
    ],
)
def test_extras_are_installed_from_the_sources_of_an_installation_from_sources(origin, command, monkeypatch):
    text = None if origin is None else json.dumps(origin)
    monkeypatch.setattr(
        "importlib.metadata.distribution", lambda name: SimpleNamespace(read_text=lambda _: text)
    )
    assert install_command("sweep") == command


def test_doctor_reports_a_missing_library_of_every_extra(monkeypatch, capsys):
    spec = "mechsim.cli.doctor.find_spec"
    monkeypatch.setattr(spec, lambda name: None if name in ("netCDF4", "yaml") else object())
    cli.load_command("doctor").callback()
    output = capsys.readouterr().out
    assert "netCDF4 (sweep)" in output
    assert "yaml (robots)" in output
    assert "nothing is missing" not in output
