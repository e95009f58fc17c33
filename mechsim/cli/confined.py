"""Commands in a process that reads and writes files of one folder only."""

import os
import re
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from html import unescape
from pathlib import Path
from typing import Any

from mechsim.cli import main
from mechsim.errors import InputError
from mechsim.numerics.c_library import cache_folder
from mechsim.simulation.mjcf.included_files import read_text

# what Python, its libraries and the drawing of pictures read, besides their own folders
SYSTEM = (
    "/usr /lib /lib64 /etc/fonts /etc/ld.so.cache /etc/localtime /dev /sys /System /Library "
    "/proc/meminfo /proc/cpuinfo /proc/self/statm /proc/self/maps /proc/self/cgroup"
)
# file operations of Python, of which the first argument, or the first two, are paths
OPERATIONS = {
    **dict.fromkeys(("open", "os.listdir", "os.scandir", "os.mkdir", "os.remove", "os.rmdir"), 1),
    **dict.fromkeys(("os.truncate", "os.chmod"), 1),
    **dict.fromkeys(("os.rename", "os.link", "os.symlink"), 2),
}
# code, as in formula.py:position
PYTHON = re.compile(r"\.pyw?(?![\w.])", re.IGNORECASE)
# names of files in MJCF and URDF, which MuJoCo opens itself
NAMED_FILE = re.compile(r"""\b(?:file\w*|\w*dir)\s*=\s*["']([^"']*)["']""")
# what separates a path from the rest of an option, as in crank=law.csv or formula.py:position
SEPARATORS = re.compile(r"[=,:@\s]")


def _is_within(path: Path, folders: Sequence[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)


def require_confined(arguments: Sequence[str], folder: Path) -> None:
    """Raise InputError for an argument that is code or, directly or in an MJCF file, outside the folder."""
    for argument in arguments:
        if PYTHON.search(argument):
            raise InputError(
                f"{argument!r} names Python code, which is not run for others; give a table instead"
            )
        # whole, or a part of it, it may name a path
        for text in (argument, *SEPARATORS.split(argument)):
            path = Path(os.path.realpath(folder / Path(text).expanduser()))
            if not _is_within(path, [folder]):
                raise InputError(f"{argument!r} is outside {folder}; name a file in that folder")
            if path.suffix.lower() in (".xml", ".urdf") and path.is_file():
                _require_confined_names(path, folder, set())


def _require_confined_names(path: Path, folder: Path, read: set[Path]) -> None:
    read.add(path)
    for name in NAMED_FILE.findall(read_text(path)):
        for start in {folder, path.parent}:
            # MuJoCo reads &#46; as a dot
            named = Path(os.path.realpath(start / unescape(name)))
            if not _is_within(named, [folder]):
                raise InputError(
                    f"{path.name} names {name!r}, which is outside {folder}; copy it into that folder"
                )
            if named in read or not named.is_file():
                continue
            # an included file can have any name, but starts as XML does
            with named.open("rb") as file:
                if file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
                    _require_confined_names(named, folder, read)


def confine(folder: Path) -> None:
    """Let this process open, write and list files only in a folder and where its libraries are.

    Python calls the hook before each file operation of its own, also by libraries (PEP 578); what MuJoCo
    opens in C is not noticed, so `require_confined` reads the names in its files.
    """
    own = [folder, Path(tempfile.gettempdir()), cache_folder()]
    own += [Path.home() / name for name in (".cache/matplotlib", ".config/matplotlib", ".cache/fontconfig")]
    system = [*SYSTEM.split(), os.devnull, os.environ.get("SYSTEMROOT", "")]
    folders = [*sysconfig.get_paths().values(), *sys.path, sys.prefix, sys.base_prefix, *system]
    readable = [*own, *(Path(name) for name in folders if name)]
    # libraries can be links into a cache of packages
    readable += [path for path in Path(sysconfig.get_path("purelib")).iterdir() if path.is_symlink()]
    readable += [Path(os.path.realpath(path)) for path in readable]

    def hook(event: str, details: tuple[Any, ...]) -> None:
        for path in details[: OPERATIONS.get(event, 0)]:
            if isinstance(path, str | bytes | os.PathLike) and not _is_within(
                Path(os.path.realpath(os.fsdecode(path))), readable
            ):
                raise PermissionError(13, f"outside {folder}", os.fsdecode(path))

    sys.addaudithook(hook)


def run() -> None:
    """Run the command line, confined to the folder that the first argument names."""
    sys.argv[0] = "mechsim"
    os.chdir(sys.argv.pop(1))
    confine(Path.cwd())
    main()
