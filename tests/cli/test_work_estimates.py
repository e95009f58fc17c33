"""Requested work is sized before it starts; long work reports its remaining time."""

from contextlib import contextmanager

import mujoco
import numpy as np
import pytest

from mechsim import catalog, dynamics, files, motors, units
from mechsim.cli import inverse_dynamics as cli_dynamics
from mechsim.cli import options, progress, solve
from mechsim.mechanism.forces import Forces


def test_a_memory_error_of_mujoco_is_rejected_in_one_line(monkeypatch, mechsim):
    def fails(*_, **__):
        raise mujoco.FatalError("Could not allocate memory")

    monkeypatch.setattr(options, "load", fails)
    answer = mechsim("solve", "four_bar")
    assert (answer.code, len(answer.err.splitlines())) == (2, 1)
    assert "not enough memory" in answer.err


@pytest.mark.parametrize("line", ["solve rrsrr", "solve four_bar --drive crank=sin(3*t) --duration 2"])
def test_a_solution_is_independent_of_chunks(line, monkeypatch, mechsim):
    for name, chunk in (("whole.csv", solve.CHUNK), ("parts.csv", 10)):
        monkeypatch.setattr(solve, "CHUNK", chunk)
        assert mechsim(*line.split(), "-o", name).code == 0
    whole, chunked = files.read("whole.csv"), files.read("parts.csv")
    assert whole.keys() == chunked.keys()
    for name, column in whole.items():
        # motion laws close each chunk from its own start
        rounding = 1e-12 * np.abs(column).max() if "--drive" in line else 0.0
        np.testing.assert_allclose(chunked[name], column, rtol=0, atol=rounding)


def test_long_work_reports_its_remaining_time(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])

    def lines(steps, total=None, at_least=False):
        now[0] = 0.0
        with progress.progress("work", total, at_least=at_least) as report:
            for seconds, *arguments in steps:
                now[0] += seconds
                report(*arguments)
        return capsys.readouterr().err.splitlines()

    parted = [(3600.0, f"{i} steps", i / 20) for i in range(1, 4)]
    first, *_, last = lines(20 * [(4.0, "piece")], 100)
    # no estimate before a tenth of the work
    assert first == "work: 3 of 100, piece"
    assert last.endswith("of 100, piece, about 5 min left")
    # the first report only sets the start
    assert lines(parted) == [
        "work: 1 steps",
        "work: 2 steps, about 18 h left",
        "work: 3 steps, about 17 h left",
    ]
    # a lower bound of the finished part determines no remaining time
    assert lines(parted, at_least=True)[1:] == ["work: 2 steps", "work: 3 steps"]
    assert lines([(1.0, "", i / 4) for i in range(1, 5)]) == []
    assert [progress.in_words(rest) for rest in (1.0, 100.0, 1e4, 1e6)] == [
        "",
        "about 100 s left",
        "about 3 h left",
        "about 12 days left",
    ]


@pytest.mark.long
@pytest.mark.parametrize(("method", "count"), [("pose", 3), ("step", 3), ("none", 1)])
def test_dynamics_report_progress_of_every_method(method, count, monkeypatch, mechsim):
    reported = []

    @contextmanager
    def recorded_progress(*_):
        yield lambda label="", fraction=None: reported.append((label.split(",")[0], fraction))

    monkeypatch.setattr(cli_dynamics, "progress", recorded_progress)
    assert mechsim("dynamics", "inverse", "four_bar", "--method", method, "--samples", "90").code == 0
    assert list(dict.fromkeys(route for route, _ in reported)) == ["formulas", "MuJoCo", "check"][:count]
    fractions = [fraction for _, fraction in reported]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


@pytest.mark.parametrize(
    "motor",
    [
        pytest.param(motors.TorqueSpeedLine(1e4, units.rpm(600)), marks=pytest.mark.slow),
        motors.DCMotor(1.0, 2.0, 3.0),
        motors.ConstantTorque(1e20),
    ],
)
def test_a_motor_much_too_strong_for_its_model_drives_it(motor):
    model = dynamics.dynamic_model(catalog.make("four_bar"), Forces(motor=motor))
    run = dynamics.run(model, turns=0.25)
    assert run.outcome == "done"
    assert run.energy_error < 1e-9
    assert run.motion.angle[-1] - run.motion.angle[0] == pytest.approx(0.5 * np.pi, rel=1e-12)
    if motor.derivative:
        # it keeps its speed after the start
        assert np.ptp(run.motion.speed[1:]) < 0.02 * abs(motor.no_load)
