"""Compiles generated C with the system's compiler into a cache, and calls it through ctypes."""

import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from mechsim.codegen.kinematics import LINK
from mechsim.codegen.printing import c_header
from mechsim.codegen.solver_code import SolverCode, template
from mechsim.errors import MissingToolError, OutputError
from mechsim.numerics.arrays import Array

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared")
# number of values of a link's motion
LINK_NUMBERS = sum(LINK.values())


@dataclass(frozen=True, slots=True)
class Configurations:
    """Configurations solved by generated code.

    Attributes:
        count: number of configurations solved before a failure.
        status: status of the last call, an index of `solver_code.STATUSES`.
        motion: coordinates, rates and accelerations, (n, 3, coordinates).
        links: values of `kinematics.LINK` for each link, (n, links, 24).
        map: derivatives of the coordinates by the drivers, (n, coordinates, drivers).
        torques: torques or forces of the drivers, (n, drivers) in [N m] or [N]; empty if undetermined.
    """

    count: int
    status: int
    motion: Array
    links: Array
    map: Array
    torques: Array


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
    """Return the folder of compiled solvers: mechsim in the user's cache folder."""
    base = os.environ.get("XDG_CACHE_HOME") or (
        "~/Library/Caches" if sys.platform == "darwin" else "~/.cache"
    )
    return Path(base).expanduser() / "mechsim" / "compiled"


def shared_library(code: SolverCode) -> Path:
    """Return the shared library of a solver, from the cache or newly compiled.

    Raises:
        MissingToolError: if there is no C compiler, or it fails.
    """
    library_code = template("library.c", {"TORQUES": code.inertias is not None})
    text = library_code.replace("@", code.prefix + "_").replace("HEADER", c_header(code))
    command = compiler()
    key = hashlib.sha256("\0".join((text, command, _version(command), *FLAGS)).encode()).hexdigest()[:24]
    path = cache_folder() / f"{code.prefix[:60]}-{key}.so"
    if not path.exists():
        compile_library(command, text, path)
    return path


@cache
def _version(command: str) -> str:
    return subprocess.run([command, "--version"], capture_output=True, text=True, check=False).stdout


def compile_library(command: str, text: str, path: Path) -> None:
    """Compile C code into a shared library.

    Raises:
        MissingToolError: if the compiler fails.
        OutputError: if the folder is not writable.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = tempfile.TemporaryDirectory(dir=path.parent)
    except OSError as error:
        raise OutputError(
            f"cannot keep compiled code in {path.parent}: {error.strerror}; set XDG_CACHE_HOME to a folder "
            "that can be written"
        ) from None
    with temporary as folder:
        source, built = Path(folder) / "solver.c", Path(folder) / "solver.so"
        source.write_text(text, encoding="utf-8")
        line = [command, *FLAGS, "-o", str(built), str(source), "-lm"]
        result = subprocess.run(line, capture_output=True, text=True, check=False)
        if result.returncode:
            first = next(iter(result.stderr.strip().splitlines()), "no message")
            raise MissingToolError(
                f"the C compiler {command} fails: {first}; set CC to one that compiles C99"
            )
        # concurrent processes with the same code write identical files
        built.replace(path)


@dataclass(frozen=True, slots=True)
class Library:
    """A compiled solver.

    Attributes:
        code: the solver's code.
        path: path of the shared library.
    """

    code: SolverCode
    path: Path

    def solve(self, drivers: Array, rates: Array, accelerations: Array) -> Configurations:
        """Return configurations at driver values, rates and accelerations, (n, drivers) each, in sequence."""
        sizes, n = self.code.sizes, len(drivers)
        motion = np.empty((n, 3, sizes["COORDINATES"]))
        links = np.empty((n, sizes["LINKS"], LINK_NUMBERS))
        by_drivers = np.empty((n, sizes["COORDINATES"], sizes["DRIVERS"]))
        has_torques = self.code.inertias is not None
        torques = np.empty((n if has_torques else 0, sizes["DRIVERS"]))
        status = ctypes.c_int()
        inputs = [
            np.ascontiguousarray(values, dtype=np.float64) for values in (drivers, rates, accelerations)
        ]
        arrays = [*inputs, motion, links, by_drivers]
        extra = [self.code.inertias, self.code.gravity, torques] if has_torques else []
        function = ctypes.CDLL(str(self.path)).solve_all
        count = function(
            n,
            *(_pointer(values) for values in arrays),
            ctypes.byref(status),
            *(_pointer(v) for v in extra if v is not None),
        )
        return Configurations(count, status.value, motion, links, by_drivers, torques)


def _pointer(values: Array) -> ctypes.c_void_p:
    return values.ctypes.data_as(ctypes.c_void_p)
