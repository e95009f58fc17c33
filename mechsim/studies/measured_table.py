"""Measured motion: a table with columns named like our quantities, some with standard deviations.

Logs of robots in MCAP are read too: messages are `sensor_msgs/JointState` of ROS 2, or JSON objects with its
fields: name, position, velocity and effort.

Source: MCAP format specification, mcap.dev.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim import files, units
from mechsim.errors import InputError, MissingToolError, needs, several
from mechsim.files import Table, require_file
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics.arrays import HUGE, Array

# largest file in bytes
MAX_BYTES = 2_000_000_000
# end of the schema names of joint states
SCHEMA = "JointState"
# fields of a message -> name of the column of a joint
COLUMNS = {"position": "{}.q", "velocity": "{}.v", "effort": "torque:{}"}
NANOSECONDS = 1e-9


def read_log(path: Path) -> Table:
    """Return the columns t [s], J.q, J.v and torque:J of a log, in SI; t is 0 in the first message.

    Times are those of the messages' headers, else those at which they were logged.

    Raises:
        InputError: for a file that is no complete log, without joint states, or with several topics of them;
            for messages that name other joints than the first one.
        MissingToolError: where the libraries are not installed.
    """
    require_file(path, "a log in MCAP", MAX_BYTES)
    with needs("logs"):
        from mcap.reader import make_reader
    topics: set[str] = set()
    messages: list[tuple[int, Any]] = []
    try:
        with path.open("rb") as stream:
            for schema, channel, message in make_reader(stream).iter_messages():
                if schema is not None and schema.name.endswith(SCHEMA):
                    topics.add(channel.topic)
                    messages.append(
                        (message.log_time, _state(schema, channel.message_encoding, message.data))
                    )
    except MissingToolError:
        raise
    except Exception as error:  # the decoders raise errors of many kinds for a damaged file
        cause = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise InputError(f"{path} is no complete log in MCAP ({cause}); record it again") from None
    if len(topics) != 1:
        raise InputError(
            f"{path} has joint states on {several(len(topics), 'topic')}{': ' * bool(topics)}"
            f"{', '.join(sorted(topics))}; give a log with one topic of {SCHEMA}"
        )
    return _table(path, messages)


def _state(schema: Any, encoding: str, data: bytes) -> Any:
    """Return a message with the fields of a JointState.

    Raises:
        ValueError: for another encoding, or fields that are no names and numbers.
    """
    if encoding == "json":
        state = SimpleNamespace(**{"header": None, "velocity": (), "effort": (), **json.loads(data)})
    else:
        with needs("logs"):
            from mcap_ros2.decoder import DecoderFactory
        decode = DecoderFactory().decoder_for(encoding, schema)
        if decode is None:
            raise ValueError(f"messages in {encoding} are not read; write json or cdr")
        state = decode(data)
    try:
        state.name = [str(name) for name in state.name]
        for field in COLUMNS:
            setattr(state, field, np.asarray(getattr(state, field), dtype=np.float64))
        state.time = _stamp(state)
    except AttributeError as error:
        raise ValueError(f"a message has no {error.name}") from None
    return state


def _table(path: Path, messages: list[tuple[int, Any]]) -> Table:
    first = messages[0][1]
    shapes = [(state.name, *(getattr(state, field).shape for field in COLUMNS)) for _, state in messages]
    for row, shape in enumerate(shapes):
        if shape != shapes[0]:
            raise InputError(
                f"{path}: message {row + 1} has other joints or fields than the first one, which has "
                f"{', '.join(first.name)}; give a log in which all have the same"
            )
    count = len(first.name)
    if len(set(first.name)) < count:
        raise InputError(f"{path} names a joint twice: {', '.join(first.name)}; give each a name of its own")
    times = [state.time or logged for logged, state in messages]
    table = {"t": np.array([time - times[0] for time in times]) * NANOSECONDS}
    for field, column in COLUMNS.items():
        values = np.array([getattr(state, field) for _, state in messages])
        if values.shape == (len(messages), 0):
            continue
        if values.shape != (len(messages), count):
            raise InputError(
                f"{path} has {several(values[0].size, 'number')} of {field} for "
                f"{several(count, 'joint')}; give one for each joint, or none"
            )
        table |= dict(zip(map(column.format, first.name), values.T, strict=True))
    return table


def _stamp(state: Any) -> int:
    """Return the time of a message's header in [ns], 0 without one."""
    stamp: Any = getattr(state.header, "stamp", None)
    if isinstance(state.header, Mapping):
        stamp = SimpleNamespace(**state.header.get("stamp", {"sec": 0, "nanosec": 0}))
    return 0 if stamp is None else int(stamp.sec) * 10**9 + int(stamp.nanosec)


if TYPE_CHECKING:
    from mechsim.studies.sensitivity.moved_family import MovedFamily

# prefixes or suffixes of columns with standard deviations
DEVIATION_SIGNS = ("±", "+-")


@dataclass(frozen=True)
class TableColumn:
    """One column of a table, in SI.

    Attributes:
        values: (n,).
        uncertainty: standard deviations, (n,); None without any.
    """

    values: Array
    uncertainty: Array | None = None


def read_measured(path: str) -> dict[str, Array]:
    """Return the columns of a .csv or .npz file (`files.read`), or the joint states of an .mcap file."""
    if not path.lower().endswith(".mcap"):
        return files.read(path)
    from mechsim.studies.measured_table import read_log

    return read_log(Path(path))


def table_columns(table: Mapping[str, ArrayLike], where: str) -> dict[str, TableColumn]:
    """Return the columns of a table by name, in SI, each with its standard deviations.

    A header may contain a unit, as `P.x [mm]`; a column `P.x ±`, or `± P.x`, contains standard deviations.

    Raises:
        InputError: for an unknown unit, two columns of one name, numbers that are not finite, standard
            deviations without a column, or standard deviations that are not above 0.
    """
    columns = units.table_in_si(table, where)
    for name, values in columns.items():
        _require_rows(values, np.abs(values) <= HUGE, name, where, "remove the row")
    result = {name: TableColumn(values) for name, values in columns.items() if deviation_of(name) is None}
    for name, values in columns.items():
        quantity_name = deviation_of(name)
        if quantity_name is None:
            continue
        if quantity_name not in result:
            raise InputError(
                f"{where}: column {name} is the standard deviation of {quantity_name}, but there is no "
                f"column {quantity_name}; there are {', '.join(result)}"
            )
        _require_rows(values, values > 0.0, name, where, "give it above 0")
        result[quantity_name] = TableColumn(result[quantity_name].values, values)
    return result


def _require_rows(values: Array, valid: NDArray[np.bool_], name: str, where: str, remedy: str) -> None:
    """Reject a column (n,) with an invalid value; the message names the first one."""
    if not valid.all():
        row = int(np.argmin(valid))
        problem = f"{values[row]:g}" if np.isfinite(values[row]) else "no finite number"
        raise InputError(f"{where}: column {name} is {problem} in row {row + 1}; {remedy}")


def deviation_of(name: str) -> str | None:
    """Return the quantity of a column of standard deviations; None for other columns."""
    for sign in DEVIATION_SIGNS:
        if name.startswith(sign) or name.endswith(sign):
            return name.removeprefix(sign).removesuffix(sign).strip()
    return None


# largest range of crank angles in [rad]; the solver follows the path over all of it
MAX_RANGE = 2e3 * np.pi


@dataclass(frozen=True)
class MeasuredMotion:
    """Measured quantities at n instants.

    Attributes:
        over: crank angle in [rad], or t in [s] under motion laws, as in the table, (n,).
        angles: path parameters, (n,) in [rad].
        values: quantity -> (n,), in SI.
        deviations: quantity -> standard deviations, (n,), if known.
    """

    over: Array
    angles: Array
    values: Mapping[str, Array]
    deviations: Mapping[str, Array]

    @property
    def count(self) -> int:
        """Number of measured values."""
        return len(self.angles) * len(self.values)


def measured_of(
    table: Mapping[str, ArrayLike], solver: KinematicSolver, where: str = "the table"
) -> MeasuredMotion:
    """Return the measured motion of a table: angle (or t under motion laws), quantities, and ± columns.

    A header may contain a unit, as `P.x [mm]`; the default is SI.

    Raises:
        InputError: without angle or t, for numbers that are not finite, or a ± column without its quantity.
    """
    columns, motion_laws = table_columns(table, where), solver.motion_laws
    over = motion_laws.axis
    if motion_laws.crank and over not in columns and f"{solver.mechanism.drivers[0]}.q" in columns:
        columns[over] = columns.pop(f"{solver.mechanism.drivers[0]}.q")
    if over not in columns:
        unit = "crank angles in rad" if over == "angle" else "times in s"
        raise InputError(f"{where} has no column {over} ({unit}); it has {', '.join(columns) or 'none'}")
    instants = columns[over].values
    # instants and prescribed motions count as exact
    for name in (over, "angle", "t", "time", "speed", "acceleration", *solver.mechanism.drivers):
        if name in columns and columns.pop(name).uncertainty is not None:
            raise InputError(f"{where}: column {name} counts as exact; leave out its standard deviation")
    values = {name: column.values for name, column in columns.items()}
    deviations = {
        name: column.uncertainty for name, column in columns.items() if column.uncertainty is not None
    }
    if not values:
        raise InputError(f"{where} contains no measured quantity; add columns as P3.x or rocker.q")
    angles = motion_laws.parameter(instants)
    if len(angles) and float(np.ptp(angles)) > MAX_RANGE:
        turns = float(np.ptp(angles)) / (2.0 * np.pi)
        raise InputError(
            f"{where}: column {over} covers {turns:.4g} turns; the limit is {MAX_RANGE / (2.0 * np.pi):g}"
        )
    return MeasuredMotion(instants, angles, values, deviations)


def single(table: Mapping[str, Array], moved: "MovedFamily") -> dict[str, str]:
    """Return the quantity of each column of a table: name in the table -> our name.

    Names of forces in `reference/` are accepted too: torque:J of a crank or of a driver, and force:J of a
    prismatic driver.

    Raises:
        InputError: for a column that is no quantity, or several quantities.
    """
    names: dict[str, str] = {}
    straight = {f"force:{name}": f"drive {name}" for name in moved.solver.mechanism.straight}
    for name in table:
        columns = moved.quantities([straight.get(name, name)])
        if len(columns) != 1:
            raise InputError(f"column {name} is not a single quantity; name columns as P3.x or rocker.q")
        names[name] = columns[0]
    return names
