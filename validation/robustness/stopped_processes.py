"""Processes that are stopped by signals, or killed while they write."""

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from command_outcomes import Case, file_defect, file_faults, output_faults

PIPES: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
CODE = "from mechsim.cli import main; import sys; sys.argv = ['mechsim', *sys.argv[1:]]; main()"

# the same, with a line when the command starts
READY_CODE = CODE.replace("main()", "print('ready', flush=True); main()")

# commands that write files and are long enough to be interrupted
SCENE = Path(__file__).resolve().parents[2] / "models" / "four_bar.xml"
RUN = f"{SCENE} --drive crank=600rpm --duration 0.2 --tolerance 1um"
COMMANDS = tuple(
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
        f"validate {SCENE} --drive crank=600rpm --duration 2",
    )
)

# so many of them end within about two seconds
FAST = 5
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def default_signals() -> None:
    """Restore the default handlers of signals, which background shells and nohup ignore."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_DFL)


def interrupts(count: int, seed: int = 1) -> list[str]:
    """Stop processes by Ctrl-C, SIGTERM or SIGHUP after random times; return all faults."""
    chance, result = random.Random(seed), []
    for i in range(count):
        words, number = COMMANDS[i % len(COMMANDS)], SIGNALS[(i + i // len(COMMANDS)) % len(SIGNALS)]
        with tempfile.TemporaryDirectory() as folder:
            process = subprocess.Popen(
                [sys.executable, "-c", READY_CODE, *words],
                cwd=folder,
                text=True,
                preexec_fn=default_signals,
                **PIPES,
            )
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(chance.uniform(0.0, 5.0 if i % len(COMMANDS) >= FAST else 1.5))
            process.send_signal(number)
            output = process.communicate()[1]
            # the output is that of Ctrl-C, whose exit code is 2
            code = 2 if process.returncode == 128 + number else process.returncode
            # before a command starts and after its end the system stops the process without a message
            message = (output.splitlines() or [""])[-1]
            problems = [] if process.returncode == -number else output_faults(code, message)
            faults = [*problems, *file_faults(Path(folder), Case(words), process.returncode)]
        result += [f"stopped by {number.name}: {fault}  <-  {' '.join(words)}" for fault in faults]
    return result


def kills(count: int, seed: int = 1) -> tuple[int, list[str]]:
    """Kill processes while they write; return how many were writing a file, and all faults."""
    chance, result, writing = random.Random(seed), [], 0
    for i in range(count):
        words = COMMANDS[i % 2]
        with tempfile.TemporaryDirectory() as folder:
            process = subprocess.Popen(
                [sys.executable, "-c", CODE, *words], cwd=folder, stdout=subprocess.DEVNULL
            )
            while process.poll() is None and not any(Path(folder).iterdir()):
                time.sleep(0.002)
            time.sleep(chance.uniform(0.0, 0.3))
            process.kill()
            process.wait()
            names = [path.name for path in Path(folder).iterdir()]
            writing += any(name.startswith(".out") for name in names)
            output = Path(folder, words[-1])
            if output.exists() and (defect := file_defect(output)) is not None:
                result.append(f"killed: {output.name} is incomplete: {defect}")
            # an incomplete file keeps its hidden name
            result += [f"killed: left {name}" for name in names if not name.startswith((".out-", "out."))]
    return writing, result
