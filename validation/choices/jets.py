"""What rates by jets cost: poses a second of every mechanism, next to those of another checkout.

python validation/choices/jets.py --against DIR [--rounds N]

DIR is a checkout that derives rates by hand, such as `git worktree add DIR c5b5cd2`. Both are run in turns,
each in a process of its own on one core, so that what else the machine does weighs on both alike; figures
are medians over the rounds, in million poses a second of processor time.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np

from mechsim import catalog

HERE = Path(__file__).parents[2]
POSES = 100_000
# mechanisms that need fewer poses for a steady figure: their roots are found numerically
SLOW = {"looper": 20_000, "warp_knitter": 20_000}


def speeds() -> dict[str, float]:
    """Return million poses a second of the mechsim that is imported: places, rates of points, everything."""
    result: dict[str, float] = {}
    for name in catalog.DRIVES:
        drive, count = catalog.make(name), SLOW.get(name, POSES)
        angles = np.linspace(0.0, 2.0 * np.pi, count)
        calls: dict[str, Callable[[], object]] = {
            "places": lambda: drive.positions(angles),  # noqa: B023
            "rates": lambda: drive.solve(angles, 62.8, links=False),  # noqa: B023
            "all": lambda: drive.solve(angles, 62.8),  # noqa: B023
        }
        for what, call in calls.items():
            call()
            times: list[float] = []
            for _ in range(3):
                began = time.process_time()
                call()
                times.append(time.process_time() - began)
            result[f"{name} {what}"] = count / median(times) / 1e6
    return result


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    asked.add_argument("--against", type=Path)
    asked.add_argument("--rounds", type=int, default=7)
    asked.add_argument("--once", action="store_true")
    given = asked.parse_args()
    if given.once:
        print(json.dumps(speeds()))
        return
    routes = {"here": HERE} | ({"there": given.against} if given.against else {})
    result: dict[tuple[str, str], list[float]] = defaultdict(list)
    for _ in range(given.rounds):
        for route, path in routes.items():
            environment = {**os.environ, "PYTHONPATH": str(path), "OMP_NUM_THREADS": "1"}
            call = [sys.executable, __file__, "--once"]
            output = subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout
            for key, value in json.loads(output).items():
                result[route, key].append(value)
    print("| mechanism | " + " | ".join(f"{what}" for what in ("places", "rates of points", "all")) + " |")
    print("|---|---|---|---|")
    for name in catalog.DRIVES:
        cells = []
        for what in ("places", "rates", "all"):
            key = f"{name} {what}"
            here = median(result["here", key])
            there = result.get(("there", key))
            cells.append(f"{median(there):.2f} to {here:.2f}" if there else f"{here:.2f}")
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
