"""Tables of driver positions: configurations at their rows, and motion laws through all rows."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.limits import require_travel
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import MotionLaws, State
from mechsim.numerics.arrays import Array

# suffixes of the columns of a point's coordinates
_COORDINATE_SUFFIXES = (".x", ".y", ".z")


@dataclass(frozen=True)
class Poses:
    """Configurations of a mechanism, one per row.

    Attributes:
        motion: a motion that is at rest at each configuration.
    """

    motion: Motion

    def __len__(self) -> int:
        return len(self.motion)

    def column_units(self) -> dict[str, str]:
        """Return the SI unit of each column."""
        return self.motion.column_units()

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the drivers, P.x ... of points and J.q of joints, in SI."""
        for name, column in self.motion.columns():
            if name in self.motion.drivers or name.endswith(_COORDINATE_SUFFIXES) or ".q" in name:
                yield name, column


@dataclass(frozen=True)
class DriverPath:
    """Motion laws that connect rows of driver positions by straight lines.

    Attributes:
        motion_laws: of the drivers; they are at rest at each row.
        times: times of the rows in [s], (n,); equal consecutive rows have equal times.
    """

    motion_laws: MotionLaws
    times: Array


def poses_of_table(solver: KinematicSolver, table: Mapping[str, Array], source: str) -> Poses:
    """Return the configurations at rows of driver positions, on the path from the guess through all rows.

    Raises:
        InputError: as `driver_path`.
        AssemblyError: where the loops cannot close, or a joint would leave its range; names the rows.
    """
    path = driver_path(solver, table, source)
    zero = np.zeros_like(path.times)
    loops = KinematicSolver(solver.mechanism, motion_laws=path.motion_laws, ranges=solver.ranges)
    return Poses(replace(loops.solve_along(path.times, zero, zero), time=path.times))


def driver_path(
    solver: KinematicSolver, table: Mapping[str, Array], source: str, *, uniform: bool = False
) -> DriverPath:
    """Return the motion laws through rows of driver positions.

    Args:
        solver: the mechanism.
        table: driver -> values, (n,) in [m] or [rad].
        source: origin of the rows, for messages.
        uniform: whether rows are one second apart; by default their distance in [rad] or in characteristic
            lengths is their time.

    Raises:
        InputError: for a driver without a column, numbers that are not finite, or rows too far apart.
    """
    mechanism = solver.mechanism
    missing = [name for name in mechanism.drivers if name not in table]
    if missing:
        raise InputError(
            f"{source} has no column {', '.join(missing)} (it has {', '.join(table)}); "
            f"give one for each driver: {', '.join(mechanism.drivers)}"
        )
    values = np.array([table[name] for name in mechanism.drivers])
    if not np.isfinite(values).all():
        raise InputError(f"{source} contains numbers that are not finite; correct the table")
    scales = [
        mechanism.characteristic_length if mechanism.unit(name) == "m" else 1.0 for name in mechanism.drivers
    ]
    lengths = np.abs(np.diff(values) / np.array(scales)[:, None]).max(0, initial=0.0)
    # rows within rounding of a revolution are one: the squares of their distances underflow
    lengths[lengths < np.finfo(np.float64).eps] = 0.0
    if lengths.any():
        row = int(lengths.argmax()) + 1
        require_travel(f"{solver.name} in {source}", f"row {row}", f"row {row + 1}", float(lengths.max()))
    times = np.concatenate([[0.0], np.cumsum(lengths > 0.0 if uniform else lengths, dtype=np.float64)])
    distinct = np.concatenate([[True], lengths > 0.0])
    knots, rows = times[distinct], np.flatnonzero(distinct)

    def locate(time: Array) -> tuple[NDArray[np.intp], Array, Array, Array]:
        """Return the segments of times, the fractions covered, and two derivatives of the fractions."""
        segment = np.clip(np.searchsorted(knots, time, side="right") - 1, 0, max(len(knots) - 2, 0))
        length = knots[segment + 1] - knots[segment] if len(knots) > 1 else np.ones_like(time)
        u = np.clip((time - knots[segment]) / length, 0.0, 1.0)
        v = u * (1.0 - u)
        fraction = u**4 * (35.0 + u * (-84.0 + u * (70.0 - 20.0 * u)))
        return segment, fraction, 140.0 * v**3 / length, 420.0 * v**2 * (1.0 - 2.0 * u) / length**2

    def law(column: Array) -> State:
        """Return a smooth motion law that connects rows by straight lines and is at rest at each row."""
        change = np.diff(column) if len(column) > 1 else np.zeros(1)

        def state(time: Array) -> tuple[Array, Array, Array]:
            segment, fraction, rate, second = locate(time)
            step = change[segment]
            return column[segment] + step * fraction, step * rate, step * second

        return state

    def description(time: float) -> str:
        segment = int(np.clip(np.searchsorted(knots, time, side="right") - 1, 0, len(knots) - 1))
        return f"the segment after row {rows[segment] + 1} of {source}"

    laws = tuple(law(column) for column in values[:, distinct])
    return DriverPath(MotionLaws(float(knots[-1]) or 1.0, mechanism.drivers, laws, 1.0, description), times)
