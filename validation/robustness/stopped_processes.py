"""Whole processes ended by signals, or killed while they write."""

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from command_outcomes import Case, broken, unclear, untidy

PIPES: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
CODE = "from mechsim.cli import main; import sys; sys.argv = ['mechsim', *sys.argv[1:]]; main()"

# the same, with a line as soon as the command line has taken over
LISTENING = CODE.replace("main()", "print('here', flush=True); main()")

# what is long enough to be interrupted, and writes
SCENE = Path(__file__).resolve().parents[2] / "models" / "four_bar.xml"
RUN = f"{SCENE} --drive crank=600rpm --duration 0.2 --tolerance 1um"
LONG = tuple(
    tuple(line.split())
    for line in (
        "solve rssr --angles 0:3600:0.05deg -o out.csv",
        "solve rssr --angles 0:3600:0.05deg -o out.npz",
        "simulate four_bar --turns 20 -o out.npz",
        "export looper -o out.xml",
        "plot rssr -o out.svg",
        "sweep four_bar --vary rocker=70mm:78mm:9000 --measure stroke:C -o out.csv",
        f"tune {RUN} -o out.xml",
        f"reduce {RUN} -o out.xml",
        "view rssr -o out.html",
        "trace looper --starts 3000 -o out.csv",
        "sensitivity rssr --of P3 --tolerances crank=10um --samples 3000000 -o out.csv",
        f"validate {SCENE} --drive crank=600rpm --duration 2 --plot out.svg",
    )
)

# so many of them are done within two seconds or so
SHORT = 5
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def _heard() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def interrupts(count: int, seed: int = 1) -> list[str]:
    """End whole processes by Ctrl-C, SIGTERM or SIGHUP after random times; return every fault."""
    chance, result = random.Random(seed), []
    for i in range(count):
        words, number = LONG[i % len(LONG)], SIGNALS[(i + i // len(LONG)) % len(SIGNALS)]
        with tempfile.TemporaryDirectory() as place:
            # what runs in the background ignores Ctrl-C, and nohup a hang-up
            process = subprocess.Popen(
                [sys.executable, "-c", LISTENING, *words], cwd=place, text=True, preexec_fn=_heard, **PIPES
            )
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(chance.uniform(0.0, 5.0 if i % len(LONG) >= SHORT else 1.5))
            process.send_signal(number)
            output = process.communicate()[1]
            # as if by Ctrl-C, whose exit code is that of a rejection
            ended = 2 if process.returncode == 128 + number else process.returncode
            # before a command listens and after it is done the system ends the process, and nothing is said
            last = (output.splitlines() or [""])[-1]
            wrong = [] if process.returncode == -number else unclear(ended, last)
            faults = [*wrong, *untidy(Path(place), Case(words), process.returncode)]
        result += [f"ended by {number.name}: {fault}  <-  {' '.join(words)}" for fault in faults]
    return result


def kills(count: int, seed: int = 1) -> tuple[int, list[str]]:
    """Kill whole processes while they write; return in how many a file was being written, and every fault."""
    chance, result, hit = random.Random(seed), [], 0
    for i in range(count):
        words = LONG[i % 2]
        with tempfile.TemporaryDirectory() as place:
            process = subprocess.Popen(
                [sys.executable, "-c", CODE, *words], cwd=place, stdout=subprocess.DEVNULL
            )
            while process.poll() is None and not any(Path(place).iterdir()):
                time.sleep(0.002)
            time.sleep(chance.uniform(0.0, 0.3))
            process.kill()
            process.wait()
            left = [path.name for path in Path(place).iterdir()]
            hit += any(name.startswith(".out") for name in left)
            asked = Path(place, words[-1])
            if asked.exists() and (why := broken(asked)) is not None:
                result.append(f"killed: {asked.name} is not whole: {why}")
            # what was being written keeps its hidden name
            result += [f"killed: left {name}" for name in left if not name.startswith((".out-", "out."))]
    return hit, result
