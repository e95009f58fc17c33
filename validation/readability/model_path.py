"""Trace the model argument of a command through the files of mechsim.

The script lists the functions that take the model, in the order of their first calls. A stop is a change of
file in that order. A return is a stop in a file that occurred before.

Run: python validation/readability/model_path.py [-v]   (-v lists the functions)
"""

import contextlib
import io
import itertools
import sys
import tempfile
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import Any

from mechsim import cli

PACKAGE = Path(cli.__file__).parents[1]
ROOT = Path(__file__).resolve().parents[2]
GALLERY = ROOT / "models" / "gallery"
# title -> arguments of the command, and the last function to trace
COMMANDS = {
    "solve FILE.toml": (
        ["solve", f"{GALLERY / 'jansen.toml'}", "--angles", "0:360:5deg", "-o", "{out}.csv"],
        "KinematicSolver.solve",
    ),
    "validate FILE.xml": (["validate", f"{ROOT / 'models' / 'four_bar.xml'}"], "crosscheck"),
    "sweep FILE.toml": (
        [
            "sweep",
            f"{GALLERY / 'jansen.toml'}",
            "--vary=m=14mm:15mm:3",
            "--measure=range:crank",
            "-o",
            "{out}.csv",
        ],
        "KinematicSolver.solve",
    ),
}
# the model is a path first, then an object of these classes
MODEL_CLASSES = {
    "TomlSource",
    "TomlModel",
    "ModelDescription",
    "MujocoSource",
    "MjcfModel",
    "LoopForm",
    "Mechanism",
    "Values",
    "Prescription",
    "DesignFamily",
}


def functions_with_model(arguments: list[str], end: str) -> list[tuple[str, str]]:
    """Return the file and name of each function that takes the model, in the order of first calls."""
    path, visited = arguments[1], dict[tuple[str, str], None]()

    def is_model(value: Any) -> bool:
        return value == path if isinstance(value, str) else type(value).__name__ in MODEL_CLASSES

    def profile(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(str(PACKAGE)) or code.co_name.startswith("<"):
            return
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        if isinstance(
            getattr(type(frame.f_locals.get("self")), code.co_name, None), property | cached_property
        ):
            return
        if any(is_model(frame.f_locals.get(name)) for name in names):
            visited.setdefault((str(Path(code.co_filename).relative_to(PACKAGE)), code.co_name))
            if code.co_qualname == end:
                sys.setprofile(None)

    sys.setprofile(profile)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            cli.app(arguments, standalone_mode=False)
    finally:
        sys.setprofile(None)
    return list(visited)


def main() -> None:
    """Print the stops, files and returns of each command; with -v the functions."""
    for title, (arguments, end) in COMMANDS.items():
        with tempfile.TemporaryDirectory() as folder:
            visited = functions_with_model(
                [argument.replace("{out}", f"{folder}/motion") for argument in arguments], end
            )
        files = [file for file, _ in visited]
        stops = 1 + sum(first != second for first, second in itertools.pairwise(files))
        print(
            f"{title:20} functions {len(visited):4}  stops {stops:4}  files {len(set(files)):3}  "
            f"returns {stops - len(set(files)):4}"
        )
        if "-v" in sys.argv:
            print("\n".join(f"    {file:45} {name}" for file, name in visited))


if __name__ == "__main__":
    main()
