"""Cost of small calls: processor time of an import and of `show`, time of short solves.

Run: python validation/speed/small_costs.py   (best of several, in milliseconds)
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import mechsim as ms

GALLERY = Path(__file__).resolve().parents[2] / "models" / "gallery"
ANGLES = np.linspace(0.0, 2.0 * np.pi, 100)
REPEATS = 30


def best(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest time of a call in [ms]."""
    times: list[float] = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def processor(*command: str) -> float:
    """Return the processor time of a command in [ms], the least of five."""
    times: list[float] = []
    for _ in range(5):
        before = os.times()
        subprocess.run([sys.executable, *command], check=True, capture_output=True)
        after = os.times()
        user, system = (
            after.children_user - before.children_user,
            after.children_system - before.children_system,
        )
        times.append(user + system)
    return 1e3 * min(times)


def main() -> None:
    """Print the costs."""
    print(f"import mechsim        {processor('-c', 'import mechsim'):8.1f} ms processor time")
    print(f"mechsim show four_bar {processor('-m', 'mechsim', 'show', 'four_bar'):8.1f} ms processor time")
    for name in ms.catalog.DRIVES:
        model = ms.catalog.make(name)
        print(f"solve {name:15} {best(lambda model=model: model.solve(ANGLES)):8.2f} ms")
    for name in ("jansen", "stephenson_six_bar", "watt_six_bar"):
        path = str(GALLERY / f"{name}.toml")
        load = best(lambda path=path: ms.load(path), 5)
        model = ms.load(path)
        first = best(lambda path=path: ms.load(path).solve(ANGLES), 5) - load
        again = best(lambda model=model: model.solve(ANGLES), 5)
        print(f"{name:20} load {load:8.2f} ms  first solve {first:8.2f} ms  again {again:8.2f} ms")


if __name__ == "__main__":
    main()
