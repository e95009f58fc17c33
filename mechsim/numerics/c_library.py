"""Compiles C code with the system's compiler into a cache of shared libraries, and loads them."""

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from mechsim.errors import MechsimError, MissingToolError, OutputError

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
# longest time of a compiler in [s] on an idle machine; the largest generated solvers take a few seconds
TIME_LIMIT = 30.0


def compiler() -> str:
    """Return the C compiler: that of the variable CC, otherwise the first installed compiler.

    Raises:
        MissingToolError: if there is no compiler.
    """
    named = os.environ.get("CC")
    path = next(filter(None, map(shutil.which, [named] if named else COMPILERS)), None)
    if path is None:
        what = f"CC={named} is not found" if named else f"there is no C compiler ({', '.join(COMPILERS)})"
        raise MissingToolError(
            f"{what}; install gcc or clang, or write the text by `mechsim compile MODEL -o solver.h`"
        )
    return path


def cache_folder() -> Path:
    """Return the folder of compiled code: mechsim in the user's cache folder."""
    base = os.environ.get("XDG_CACHE_HOME") or (
        "~/Library/Caches" if sys.platform == "darwin" else "~/.cache"
    )
    return Path(base).expanduser() / "mechsim" / "compiled"


def shared_library(name: str, text: str, headers: Path | None = None, *options: str) -> Path:
    """Return the shared library of a C text, from the cache or newly compiled.

    Its name states the text, the compiler and the machine; the digest next to it its content, so that a
    damaged file is compiled again. `headers` is a folder of headers whose release the text names; `options`
    are further ones of the compiler.

    Raises:
        MissingToolError: if there is no C compiler, or it fails.
        OutputError: if the folder is not writable.
    """
    command = compiler()
    status = os.stat(os.path.realpath(command))
    flags = (*FLAGS, *options) if headers is None else (*FLAGS, *options, f"-I{headers}")
    inputs = text, command, str(status.st_mtime_ns), str(status.st_size), platform.machine(), *flags
    key = hashlib.sha256("\0".join(inputs).encode()).hexdigest()[:24]
    path = cache_folder() / f"{name[:60]}-{key}.so"
    try:
        intact = _digest(path) == path.with_suffix(".sha256").read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError):
        intact = False
    if not intact:
        compile_library(command, text, path, flags)
    return path


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def compile_library(command: str, text: str, path: Path, flags: Sequence[str] = FLAGS) -> None:
    """Compile C code into a shared library.

    Raises:
        MissingToolError: if the compiler fails, or does not end.
        OutputError: if the folder is not writable.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, ignore_cleanup_errors=True) as folder:
            source, built, digest = (Path(folder) / f"code.{end}" for end in ("c", "so", "sha256"))
            source.write_text(text, encoding="utf-8")
            _run_compiler(command, [*flags, "-o", str(built), str(source), "-lm"])
            digest.write_text(_digest(built), encoding="ascii")
            # concurrent processes with the same code write identical files
            built.replace(path)
            digest.replace(path.with_suffix(".sha256"))
    except OSError as error:
        raise OutputError(
            f"cannot keep compiled code in {path.parent}: {error.strerror}; set XDG_CACHE_HOME to a folder "
            "that can be written"
        ) from None


def _run_compiler(command: str, arguments: list[str]) -> None:
    # other processes share the processors
    load = os.getloadavg()[0] / (os.cpu_count() or 1) if hasattr(os, "getloadavg") else 1.0
    limit = TIME_LIMIT * max(1.0, load)
    try:
        result = subprocess.run(
            [command, *arguments], capture_output=True, text=True, check=False, timeout=limit
        )
        first = next(iter(result.stderr.strip().splitlines()), "no message") if result.returncode else ""
    except subprocess.TimeoutExpired:
        first = f"it does not end within {limit:.3g} s"
    if first:
        raise MissingToolError(f"the C compiler {command} fails: {first}; set CC to one that compiles C99")


@cache
def library_or_error(name: str, text: str, headers: Path | None, *options: str) -> ctypes.CDLL | MechsimError:
    """Return the loaded shared library of a C text, or the reason why there is none."""
    try:
        return ctypes.CDLL(str(shared_library(name, text, headers, *options)))
    except (MissingToolError, OutputError) as error:  # first, as OutputError is an OSError too
        return error
    except OSError as error:
        return MissingToolError(f"compiled code cannot be loaded: {error}; set CC to another compiler")


def loaded_library(name: str, text: str, headers: Path | None = None, *options: str) -> ctypes.CDLL:
    """Return the loaded shared library of a C text, as `shared_library`; a compiler that fails is tried once.

    Raises:
        MissingToolError: if there is no C compiler, or the system does not load what it makes.
        OutputError: if the folder is not writable.
    """
    result = library_or_error(name, text, headers, *options)
    if isinstance(result, MechsimError):
        raise result
    return result
