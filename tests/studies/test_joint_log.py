"""Logs of joint states in MCAP: written with the mcap package, read as tables, fitted."""

import json

import numpy as np
import pytest
from mcap.writer import Writer
from mcap_ros2.writer import Writer as RosWriter
from model_files import FOLDER, model_text

import mechsim as ms
from mechsim.studies.measured_table import measured_of, read_log

JOINT_STATE = model_text("joint_log_joint_state.msg")
TIMES = np.arange(200) * 0.02
# seconds of the first stamp; the messages are logged one second later
EPOCH = 1_700_000_000


def pendulum_states():
    """Return position, rate and torque of a pendulum of 1.4 kg with its centre at 0.2 m."""
    position, rate = 0.7 * np.sin(3.0 * TIMES), 2.1 * np.cos(3.0 * TIMES)
    inertia = 0.001 + 1.4 * 0.2**2
    return position, rate, inertia * (-9.0 * position) + 1.4 * 9.81 * 0.2 * np.cos(position)


def ros_log(path, names=("pivot",), topic="/joint_states", states=None, stamped=True):
    states = pendulum_states() if states is None else states
    with path.open("wb") as stream, RosWriter(stream) as writer:
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for i, time in enumerate(TIMES):
            nanoseconds = round(time * 1e9)
            stamp = {"sec": EPOCH + nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}
            named = names(i) if callable(names) else names
            message = {
                "header": {"stamp": stamp if stamped else {"sec": 0, "nanosec": 0}, "frame_id": ""},
                "name": list(named),
                **{
                    key: [column[i]] * len(named)
                    for key, column in zip(("position", "velocity", "effort"), states, strict=True)
                },
            }
            writer.write_message(topic, schema, message, log_time=(EPOCH + 1) * 10**9 + nanoseconds)


def json_log(path, topics=("/joint_states",), text=None):
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("JointState", "jsonschema", b"{}")
        for topic in topics:
            channel = writer.register_channel(topic, "json", schema)
            for i, time in enumerate(TIMES):
                nanoseconds = round(time * 1e9)
                message = {"name": ["pivot"], "position": [pendulum_states()[0][i]]}
                data = (text or json.dumps(message)).encode()
                writer.add_message(channel, nanoseconds, data, nanoseconds)
        writer.finish()


@pytest.mark.long
@pytest.mark.parametrize("stamped", [True, False])
def test_a_ros_log_is_a_table_of_joint_states(tmp_path, stamped):
    ros_log(tmp_path / "run.mcap", stamped=stamped)
    table = read_log(tmp_path / "run.mcap")
    position, rate, torque = pendulum_states()
    expected = {"t": TIMES, "pivot.q": position, "pivot.v": rate, "torque:pivot": torque}
    assert list(table) == list(expected)
    for name, values in expected.items():
        # stamps are whole nanoseconds
        np.testing.assert_allclose(table[name], values, rtol=0.0, atol=1e-9 if name == "t" else 0.0)


def test_a_json_log_may_lack_rates_torques_and_header(tmp_path):
    json_log(tmp_path / "run.mcap")
    table = read_log(tmp_path / "run.mcap")
    assert list(table) == ["t", "pivot.q"]
    np.testing.assert_array_equal(table["pivot.q"], pendulum_states()[0])


def test_the_mass_is_identified_from_a_log(tmp_path):
    ros_log(tmp_path / "run.mcap")
    table = read_log(tmp_path / "run.mcap")
    result = ms.identify(ms.load(FOLDER / "identification_pendulum.toml", still=True), table, ["bob.mass"])
    # the spline through rates of 50 Hz is the only error
    assert result.values["bob.mass"] == pytest.approx(1.4, rel=1e-5)


def cut_short(path):
    ros_log(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def fleeting(i):
    return ("pivot",) if i < 7 else ("elbow",)


@pytest.mark.long
@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path: path.write_bytes(b"not a log"), "is no complete log in MCAP"),
        (cut_short, "is no complete log in MCAP"),
        (lambda path: ros_log(path, fleeting), "message 8 has other joints or fields than the first one"),
        (lambda path: json_log(path, ("/left", "/right")), "joint states on 2 topics: /left, /right"),
        (lambda path: json_log(path, ()), "joint states on 0 topics; give a log with one topic"),
        (lambda path: json_log(path, text="[1]"), "is no complete log in MCAP"),
        (
            lambda path: json_log(path, text='{"name": ["a"], "position": ["x"]}'),
            "could not convert string to float",
        ),
        (lambda path: json_log(path, text='{"position": [1.0]}'), "a message has no name"),
        (
            lambda path: json_log(path, text='{"name": ["a", "b"], "position": [1.0]}'),
            "1 number of position for 2 joints; give one for each joint, or none",
        ),
        (
            lambda path: json_log(path, text='{"name": ["a", "a"], "position": [1.0, 2.0]}'),
            "names a joint twice: a, a",
        ),
        (lambda path: json_log(path, text="[" * 100_000), "is no complete log in MCAP"),
    ],
)
def test_invalid_logs_are_rejected_in_one_sentence(tmp_path, write, message):
    write(tmp_path / "run.mcap")
    with pytest.raises(ms.InputError, match=message) as error:
        read_log(tmp_path / "run.mcap")
    assert "\n" not in str(error.value)


def test_the_crank_of_a_log_counts_as_the_crank_angle():
    solver, angles = ms.load("four_bar"), np.linspace(0.2, 1.4, 7)
    rocker = solver.solve(angles).joints["rocker"].value
    measured = measured_of({"t": angles, "crank.q": angles, "rocker.q": rocker}, solver)
    np.testing.assert_array_equal(measured.angles, angles)
    assert list(measured.values) == ["rocker.q"]
