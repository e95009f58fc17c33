"""Logs of robots in MCAP: the states of joints over time, as a table.

Messages are `sensor_msgs/JointState` of ROS 2, or JSON objects with its fields: name, position, velocity and
effort.

Source: MCAP format specification, mcap.dev.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from mechsim.errors import InputError, MissingToolError, needs, several
from mechsim.files import Table, require_file

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
