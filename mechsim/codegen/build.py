"""Compiles generated C, and calls it through ctypes."""

import ctypes
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mechsim.codegen.kinematics import LINK
from mechsim.codegen.printing import c_header
from mechsim.codegen.solver_code import SolverCode, template
from mechsim.numerics import c_library
from mechsim.numerics.arrays import Array

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


def shared_library(code: SolverCode) -> Path:
    """Return the shared library of a solver, from the cache or newly compiled.

    Raises:
        MissingToolError: if there is no C compiler, or it fails.
    """
    library_code = template("library.c", {"TORQUES": code.inertias is not None})
    text = library_code.replace("@", code.prefix + "_").replace("HEADER", c_header(code))
    return c_library.shared_library(code.prefix, text)


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
