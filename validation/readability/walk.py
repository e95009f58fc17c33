"""Follow the model argument of a command through the files of mechsim.

A reader who wants to know what a command does with its model opens the functions in the order in which they
are first called. A stop is a change of file in that order, a return a stop in a file that was open before.

Run: python validation/readability/walk.py [-v]   (-v lists the functions)
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
# title -> arguments of the command, and the function at which the walk ends
WALKS = {
    "solve FILE.toml": (
        ["solve", f"{GALLERY / 'jansen.toml'}", "--angles", "0:360:5deg", "-o", "{out}.csv"],
        "LoopForm.solve",
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
        "LoopForm.solve",
    ),
}
# a model on its way: a path, then objects of these classes
CLASSES = {
    "TomlSource",
    "TomlModel",
    "ModelDescription",
    "MujocoSource",
    "MjcfModel",
    "MjcfForm",
    "LoopForm",
    "Mechanism",
    "Values",
    "Prescription",
    "DesignFamily",
}


def walk(arguments: list[str], end: str) -> list[tuple[str, str]]:
    """Return file and function of each function that takes the model, in the order of first calls."""
    path, visited = arguments[1], dict[tuple[str, str], None]()

    def is_model(value: Any) -> bool:
        return value == path if isinstance(value, str) else type(value).__name__ in CLASSES

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
    """Print stops, files and returns of each walk; with -v the walk itself."""
    for title, (arguments, end) in WALKS.items():
        with tempfile.TemporaryDirectory() as folder:
            visited = walk([argument.replace("{out}", f"{folder}/motion") for argument in arguments], end)
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
