"""Cost of small calls in processor time: an import, three commands, short solves.

Run: python validation/speed/small_costs.py   (medians in milliseconds; commands with compiled bytecode, as
pip installs it)
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import mechsim as ms

GALLERY = Path(__file__).resolve().parents[2] / "models" / "gallery"
ANGLES = np.linspace(0.0, 2.0 * np.pi, 100)
REPEATS = 30


def call_time(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the median processor time of a call in [ms]."""
    times: list[float] = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return 1e3 * statistics.median(times)


def command_time(bytecode: str, *command: str) -> float:
    """Return the median processor time of a command in [ms], after one that compiles what it imports.

    Args:
        bytecode: directory of compiled modules.
        command: arguments of Python.
    """
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = bytecode
    run = [sys.executable, *command]
    subprocess.run(run, check=True, capture_output=True, env=environment)
    times: list[float] = []
    for _ in range(5):
        before = os.times()
        subprocess.run(run, check=True, capture_output=True, env=environment)
        after = os.times()
        user, system = (
            after.children_user - before.children_user,
            after.children_system - before.children_system,
        )
        times.append(user + system)
    return 1e3 * statistics.median(times)


def main() -> None:
    """Print the costs."""
    commands = (["--help"], ["show", "four_bar"], ["check", str(GALLERY / "jansen.toml")])
    with tempfile.TemporaryDirectory() as bytecode:
        print(f"import mechsim           {command_time(bytecode, '-c', 'import mechsim'):8.1f} ms")
        for words in commands:
            label = " ".join(Path(word).name for word in words)
            print(f"mechsim {label:16} {command_time(bytecode, '-m', 'mechsim', *words):8.1f} ms")
    for name in ms.catalog.MECHANISMS:
        model = ms.catalog.make(name)
        print(f"solve {name:15} {call_time(lambda model=model: model.solve(ANGLES)):8.2f} ms")
    for name in ("jansen", "stephenson_six_bar", "watt_six_bar"):
        path = str(GALLERY / f"{name}.toml")
        load = call_time(lambda path=path: ms.load(path), 15)
        model = ms.load(path)
        first = call_time(lambda path=path: ms.load(path).solve(ANGLES), 15) - load
        again = call_time(lambda model=model: model.solve(ANGLES), 15)
        print(f"{name:20} load {load:8.2f} ms  first solve {first:8.2f} ms  again {again:8.2f} ms")


if __name__ == "__main__":
    main()
