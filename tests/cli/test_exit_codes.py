"""Exit codes for closed streams, signals, internal errors and a failing OpenGL back end."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import process, python

from mechsim import cli

MECHSIM = [sys.executable, "-m", "mechsim"]
PATH = {"PYTHONPATH": str(Path(cli.__file__).parents[2])}
RENDER = ["render", "rssr", "-o", "animation.mp4", "--frames-per-turn", "2000", "--size", "640x480"]
SOLVE = ["solve", "rssr", "--angles", "0:3600:0.01deg", "-o", "out.csv"]


@pytest.fixture(autouse=True, scope="module")
def enabled_signals():
    """Enable signals that a test run in the background or under nohup ignores."""
    handlers = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: lambda *_: None}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run(arguments, folder, **environment):
    """Run a command in a shell."""
    return process(
        "sh", "-c", f"{sys.executable} -m mechsim {arguments}", folder=folder, **PATH, **environment
    )


@pytest.mark.parametrize(
    ("arguments", "code", "output"),
    [
        pytest.param("list >&-", 0, "", marks=pytest.mark.slow),
        pytest.param("solve rssr -o out.csv <&- >&- 2>&-", 0, "", marks=pytest.mark.slow),
        pytest.param("solve rsr 2>&-", 2, "", marks=pytest.mark.slow),
        pytest.param("solve rsr 2>/dev/full", 2, "", marks=pytest.mark.slow),
        ("solve rssr >/dev/full", 2, "No space left on device"),
    ],
)
def test_closed_and_full_streams_keep_the_exit_code(arguments, code, output, tmp_path):
    completed = run(arguments, tmp_path)
    assert completed.returncode == code
    assert output in completed.stderr
    assert len(completed.stderr.splitlines()) <= 1
    if "-o" in arguments:
        # no output or message goes into a file that reuses the number of a closed stream
        assert (tmp_path / "out.csv").read_text().startswith("angle,P2.x")


def started(arguments, folder):
    """Start a command and wait until it writes."""
    process = subprocess.Popen(
        [*MECHSIM, *arguments],
        cwd=folder,
        env=os.environ | PATH,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    while process.poll() is None and not any(folder.iterdir()):
        time.sleep(0.005)
    return process


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        pytest.param("SIGTERM", RENDER, marks=pytest.mark.slow),
        pytest.param("SIGINT", RENDER, marks=pytest.mark.slow),
        ("SIGHUP", SOLVE),
    ],
)
def test_a_terminating_signal_leaves_no_files(name, arguments, tmp_path):
    process = started(arguments, tmp_path)
    number = getattr(signal, name)
    if name == "SIGINT":
        # wait until the encoder writes frames: the keyboard interrupts it too
        while process.poll() is None and not any(path.stat().st_size for path in tmp_path.iterdir()):
            time.sleep(0.005)
        os.killpg(process.pid, number)
    else:
        process.send_signal(number)
    output = process.communicate(timeout=600)[1]
    assert process.returncode == 128 + number
    assert output.splitlines()[-1] == "mechsim: stopped"
    assert list(tmp_path.iterdir()) == []
    # the encoder, in the same process group, has ended
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


def test_an_ignored_signal_stays_ignored(tmp_path):
    code = (
        "import signal, os; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from mechsim.cli import exit_codes\n"
        "raise SystemExit(exit_codes.exit_code(lambda: os.kill(os.getpid(), signal.SIGHUP)))"
    )
    assert python("-c", code, **PATH).returncode == 0


def test_an_internal_error_has_its_own_exit_code(monkeypatch, capsys):
    def broken(**_):
        raise IndexError("list index out of range")

    monkeypatch.setattr(cli, "app", broken)
    for debug in (False, True):
        if debug:
            monkeypatch.setenv("MECHSIM_DEBUG", "1")
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 70
        output = capsys.readouterr().err
        assert "mechsim: internal error: IndexError: list index out of range: please report" in output
        assert ("Traceback" in output) is debug


@pytest.mark.long
def test_a_failing_opengl_back_end_does_not_stop_other_commands(tmp_path):
    completed = run("simulate rssr --method pose --samples 8", tmp_path, MUJOCO_GL="nonsense")
    assert completed.returncode == 0
    if completed.stderr:
        assert completed.stderr == (
            "mechsim: MUJOCO_GL=nonsense does not work here; pictures use another back end, if there is one\n"
        )
