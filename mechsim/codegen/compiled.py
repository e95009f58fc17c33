"""A mechanism solved by generated C code, which is compiled and called through ctypes: `mechsim.compile`."""

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim.codegen.assembly import assembly
from mechsim.codegen.kinematics import LINK
from mechsim.codegen.solver_code import STATUSES, SolverCode, c_header, javascript, solver_code, template
from mechsim.errors import AssemblyError, InputError
from mechsim.io.readers import load
from mechsim.kinematics.loops.motion import instants_of_laws
from mechsim.kinematics.loops.record import tracked_points, tree_joint_motions
from mechsim.kinematics.path_instants import path_instants
from mechsim.mechanism.motion import LinkMotion, Motion
from mechsim.numerics.arrays import Array, numbers
from mechsim.numerics.c_library import shared_library
from mechsim.numerics.resources import require_memory


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


# bytes of a configuration for each coordinate and link: 24 numbers per link, stored twice; remedy in messages
BYTES, FEWER = 400.0, "give {most} at the most"


@dataclass(frozen=True)
class CompiledSolver:
    """A mechanism solved by generated C code, from `mechsim.compile`.

    Attributes:
        code: the code.
        library: path of the shared library.
    """

    code: SolverCode
    library: Path

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.code.assembly.mechanism.name

    @cached_property
    def header(self) -> str:
        """The C99 header of `mechsim compile MODEL -o solver.h`."""
        return c_header(self.code)

    @cached_property
    def javascript(self) -> str:
        """The JavaScript file of `mechsim compile MODEL -o solver.js`."""
        return javascript(self.code)

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the driven coordinates."""
        return self.code.assembly.drivers

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates of the tree; a ball joint has three rotations."""
        return tuple(self.code.formulas.coordinates)

    def solve(
        self,
        angles: ArrayLike | None = None,
        speed: ArrayLike | None = None,
        acceleration: ArrayLike = 0.0,
        *,
        t: ArrayLike | None = None,
    ) -> Motion:
        """Return the motion at crank angles, or at times of motion laws.

        Args:
            angles: crank angles, (n,) in [rad] or text such as "0:360:5deg"; with motion laws, use `t`.
            speed: crank speed, scalar or (n,) in [rad/s] or text; None means 1 rad/s at crank angles.
            acceleration: crank acceleration, scalar or (n,) in [rad/s2].
            t: times, (n,) in [s].

        Raises:
            AssemblyError: if an instant cannot be reached in this assembly; it names the first one.
            InputError: if several drivers have no motion laws, or memory is too small for the instants.

        Accuracy: as `KinematicSolver.solve`, which has the same equations.
        """
        source = self.code.assembly.source
        laws = source.motion_laws
        laws.require_drivers(source.mechanism)
        instants = path_instants(source.mechanism, laws, angles, speed, acceleration, t)
        parameter = np.atleast_1d(np.asarray(instants.parameter, dtype=np.float64))
        self._require_memory(len(parameter))
        rate, second = (
            np.broadcast_to(np.asarray(x, dtype=np.float64), parameter.shape)
            for x in (instants.rate, instants.second)
        )
        drivers = instants_of_laws(laws, parameter, rate, second)
        solved = self.solve_drivers(drivers.value.T, drivers.rate.T, drivers.second.T)
        time = instants.time if instants.time is not None else None if laws.crank else laws.time(parameter)
        return self._motion(solved, parameter, rate, second, time)

    def solve_drivers(
        self, values: ArrayLike, rates: ArrayLike = 0.0, accelerations: ArrayLike = 0.0
    ) -> Configurations:
        """Return configurations, maps and torques at values of the drivers, (n, drivers) each, in SI.

        The path to the first configuration begins at the start of the mechanism, the path to each other
        configuration at its predecessor.

        Raises:
            AssemblyError: if a configuration cannot be reached in this assembly; it names the first one.
            InputError: if the number of drivers is wrong, rates are not finite, or memory is too small.
        """
        drivers = np.atleast_2d(np.asarray(values, dtype=np.float64))
        if drivers.shape[1] != len(self.drivers):
            raise InputError(
                f"{self.name}: values of drivers have {drivers.shape[1]} columns; give {len(self.drivers)}: "
                f"{', '.join(self.drivers)}"
            )
        first, second = (np.broadcast_to(numbers(x), drivers.shape) for x in (rates, accelerations))
        if not (np.isfinite(first).all() and np.isfinite(second).all()):
            raise InputError(f"{self.name}: rates or accelerations of drivers are not finite; give numbers")
        self._require_memory(len(drivers))
        solved = self.configurations(drivers, first, second)
        if solved.count < len(drivers):
            raise AssemblyError(self._failure(drivers[solved.count], solved.status))
        return solved

    def configurations(self, drivers: Array, rates: Array, accelerations: Array) -> Configurations:
        """Return configurations at driver values, rates and accelerations, (n, drivers) each, in sequence."""
        sizes, inertias, n = self.code.sizes, self.code.inertias, len(drivers)
        motion = np.empty((n, 3, sizes["COORDINATES"]))
        links = np.empty((n, sizes["LINKS"], sum(LINK.values())))
        by_drivers = np.empty((n, sizes["COORDINATES"], sizes["DRIVERS"]))
        torques, status = np.empty((0 if inertias is None else n, sizes["DRIVERS"])), ctypes.c_int()
        inputs = [np.ascontiguousarray(each, dtype=np.float64) for each in (drivers, rates, accelerations)]
        extra = [] if inertias is None else [inertias, self.code.gravity, torques]
        before, after = (
            [values.ctypes.data_as(ctypes.c_void_p) for values in arrays]
            for arrays in ([*inputs, motion, links, by_drivers], extra)
        )
        count = ctypes.CDLL(str(self.library)).solve_all(n, *before, ctypes.byref(status), *after)
        return Configurations(count, status.value, motion, links, by_drivers, torques)

    def _require_memory(self, count: int) -> None:
        each = BYTES * (self.code.sizes["COORDINATES"] + self.code.sizes["LINKS"])
        require_memory(f"motion of {count:,} configurations", count, each, FEWER)

    def _failure(self, drivers: Array, status: int) -> str:
        values = ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.drivers, drivers, strict=True))
        limits = self.code.assembly.interval
        reasons = {
            "OUT_OF_RANGE": "" if limits is None else f"outside {limits[0]:.6g} to {limits[1]:.6g} rad",
            "SINGULAR": "beyond a singular configuration or another assembly",
            "TOO_FAR": "not reached from the configuration before in small steps",
        }
        reason = reasons.get(STATUSES[status], STATUSES[status])
        return (
            f"{self.name}: the generated code does not solve {values}: {reason}; stay within the range of "
            "this assembly"
        )

    def _motion(
        self, solved: Configurations, angle: Array, speed: Array, second: Array, time: Array | None
    ) -> Motion:
        links: dict[str, LinkMotion] = {}
        ends = np.cumsum([*LINK.values()])[:-1]
        for k, name in enumerate(self.code.formulas.links):
            position, rotation, *rates = np.split(solved.links[:, k], ends, axis=1)
            links[name] = LinkMotion(position, rotation.reshape(-1, 3, 3), *rates)
        build = self.code.assembly
        tree, mechanism = build.loops.tree, build.source.mechanism
        value, rate, acceleration = np.moveaxis(solved.motion, (1, 2), (0, 1))
        joints = tree_joint_motions(tree, tree.original.joints, links, (value, rate, acceleration))
        laws = build.source.motion_laws
        return Motion(
            source="loop equations",
            angle=angle,
            speed=np.array(speed),
            acceleration=np.array(second),
            points=tracked_points(mechanism, links),
            links=links,
            joints={name: joint for name, joint in joints.items() if name in mechanism.coordinates},
            time=time,
            spinning=frozenset(build.spinning),
            drivers=() if laws.crank else laws.drivers,
        )


def compile(
    model: Any,
    *,
    set: Mapping[str, str | float] | None = None,
    **options: Any,
) -> CompiledSolver:
    """Return a mechanism solved by generated C code, compiled by the system's C compiler.

    The user's cache keeps the library, so that each mechanism is compiled only once.

    Args:
        model: as `load` takes it.
        set: parameter -> its value, as `load` takes it.
        options: further arguments of `load`, such as drive= and lock=.

    Raises:
        MissingToolError: if there is no C compiler.
        AssemblyError: if the loops do not close at the start.
        MobilityError: if the drivers leave joints or tracked points undetermined, or are redundant.
        InputError: if the model is no mechanism, has no driver, or cannot be certified.
    """
    code = solver_code(assembly(load(model, set=set, **options)))
    text = template("library.c", {"TORQUES": code.inertias is not None})
    text = text.replace("@", f"{code.prefix}_").replace("HEADER", c_header(code))
    return CompiledSolver(code, shared_library(code.prefix, text))
