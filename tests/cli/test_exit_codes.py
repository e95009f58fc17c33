"""How commands end: streams that take nothing, signals, faults of the program, a back end that fails."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from grids import grid

from mechsim import cli

MECHSIM = [sys.executable, "-m", "mechsim"]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(Path(cli.__file__).parents[2])}
RENDER = ["render", "rssr", "-o", "film.mp4", "--frames-per-turn", "2000", "--size", "640x480"]
SOLVE = ["solve", "rssr", "--angles", "0:3600:0.01deg", "-o", "out.csv"]


@pytest.fixture(autouse=True, scope="module")
def heard() -> Iterator[None]:
    """Let commands hear signals that the tests are run without, as in the background or under nohup."""
    handlers = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: lambda *_: None}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run(words: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = f"{sys.executable} -m mechsim {words}"
    return subprocess.run(
        ["sh", "-c", command],
        cwd=folder,
        env=ENVIRONMENT | environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("words", "code", "output"),
    [
        pytest.param("list >&-", 0, "", marks=pytest.mark.slow),
        ("solve rssr -o out.csv <&- >&- 2>&-", 0, ""),
        pytest.param("solve rsr 2>&-", 2, "", marks=pytest.mark.slow),
        pytest.param("solve rsr 2>/dev/full", 2, "", marks=pytest.mark.slow),
        ("solve rssr >/dev/full", 2, "No space left on device"),
    ],
)
def test_a_stream_that_takes_nothing_leaves_the_exit_code_right(
    words: str, code: int, output: str, tmp_path: Path
) -> None:
    done = run(words, tmp_path)
    assert done.returncode == code
    assert output in done.stderr
    assert len(done.stderr.splitlines()) <= 1
    if "-o" in words:
        # neither output nor messages went into the file that was given a stream's number
        assert (tmp_path / "out.csv").read_text().startswith("angle,P2.x")


def begun(words: list[str], folder: Path) -> subprocess.Popen[str]:
    """Start a command and wait until it writes."""
    process = subprocess.Popen(
        [*MECHSIM, *words],
        cwd=folder,
        env=ENVIRONMENT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    while process.poll() is None and not any(folder.iterdir()):
        time.sleep(0.005)
    return process


@pytest.mark.parametrize(("name", "words"), [("SIGTERM", RENDER), ("SIGHUP", SOLVE)])
def test_a_signal_that_ends_a_command_leaves_nothing_behind(
    name: str, words: list[str], tmp_path: Path
) -> None:
    process = begun(words, tmp_path)
    number = getattr(signal, name)
    process.send_signal(number)
    output = process.communicate(timeout=600)[1]
    assert process.returncode == 128 + number
    assert output.splitlines()[-1] == "mechsim: stopped"
    assert list(tmp_path.iterdir()) == []
    # the encoder, in the same group, is gone as well
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


@pytest.mark.slow
def test_an_interrupt_from_the_keyboard_that_ends_the_encoder_too_is_no_fault_of_the_encoder(
    tmp_path: Path,
) -> None:
    process = begun(RENDER, tmp_path)
    # what has frames in it, the encoder writes
    while process.poll() is None and not any(path.stat().st_size for path in tmp_path.iterdir()):
        time.sleep(0.005)
    os.killpg(process.pid, signal.SIGINT)
    output = process.communicate(timeout=600)[1]
    assert process.returncode == 2
    assert output.splitlines()[-1] == "mechsim: stopped"
    assert list(tmp_path.iterdir()) == []


def swallowing(number: signal.Signals, times: int) -> "subprocess.CompletedProcess[str]":
    """Run a command whose destructors swallow a signal so many times, and wait for what is to come again."""
    code = f"""
import os, time
from mechsim.cli import exit_codes
class Held:
    def __del__(self):
        os.kill(os.getpid(), {int(number)})
        time.sleep(0)
def command():
    for _ in range({times}):
        Held()
    time.sleep(60)
code = exit_codes.exit_code(command)
time.sleep(10 * exit_codes.RESEND_AFTER)
raise SystemExit(code)
"""
    return subprocess.run(
        [sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("number", "times", "code"), [(signal.SIGTERM, 1, 128 + signal.SIGTERM), (signal.SIGINT, 2, 2)]
)
def test_a_signal_that_destructors_swallow_ends_the_command_all_the_same_and_once(
    number: signal.Signals, times: int, code: int
) -> None:
    done = swallowing(number, times)
    assert (done.returncode, done.stderr) == (code, "mechsim: stopped\n")


def test_a_signal_that_is_ignored_stays_ignored(tmp_path: Path) -> None:
    code = (
        "import signal, os; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "from mechsim.cli import exit_codes\n"
        "raise SystemExit(exit_codes.exit_code(lambda: os.kill(os.getpid(), signal.SIGHUP)))"
    )
    assert subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, check=False).returncode == 0


def test_a_fault_of_the_motion_law_never_looks_like_missed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(**_: object) -> None:
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


@pytest.mark.parametrize("asked", grid(("osmesa", "nonsense"), ("nonsense",)))
def test_a_back_end_that_fails_stops_nothing_that_does_not_draw(asked: str, tmp_path: Path) -> None:
    done = run("simulate rssr --method pose --samples 8", tmp_path, MUJOCO_GL=asked)
    assert done.returncode == 0
    if done.stderr:
        assert done.stderr == (
            f"mechsim: MUJOCO_GL={asked} does not work here; pictures use another back end, if there is one\n"
        )
