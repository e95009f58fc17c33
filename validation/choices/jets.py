"""Cost of rates by jets: configurations per second of every mechanism, compared with another checkout.

python validation/choices/jets.py --against DIR [--rounds N]

DIR is a checkout that derives rates by hand, such as `git worktree add DIR c5b5cd2`. Both run in turn,
each in its own process on one core, so that other load affects both equally; figures
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

ROOT = Path(__file__).parents[2]
POSES = 100_000
# mechanisms that need fewer poses for a steady figure: their roots are found numerically
SLOW = {"looper": 20_000, "warp_knitter": 20_000}


def speeds() -> dict[str, float]:
    """Return million poses a second of the mechsim that is imported: places, rates of points, everything."""
    result: dict[str, float] = {}
    for name in catalog.MECHANISMS:
        closed_form, count = catalog.make(name), SLOW.get(name, POSES)
        angles = np.linspace(0.0, 2.0 * np.pi, count)
        calls: dict[str, Callable[[], object]] = {
            "places": lambda: closed_form.positions(angles),  # noqa: B023
            "rates": lambda: closed_form.solve_along(angles, 62.8, links=False),  # noqa: B023
            "all": lambda: closed_form.solve(angles, 62.8),  # noqa: B023
        }
        for kind, call in calls.items():
            call()
            times: list[float] = []
            for _ in range(3):
                start = time.process_time()
                call()
                times.append(time.process_time() - start)
            result[f"{name} {kind}"] = count / median(times) / 1e6
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--against", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--once", action="store_true")
    options = parser.parse_args()
    if options.once:
        print(json.dumps(speeds()))
        return
    routes = {"current": ROOT} | ({"other": options.against} if options.against else {})
    result: dict[tuple[str, str], list[float]] = defaultdict(list)
    for _ in range(options.rounds):
        for route, path in routes.items():
            environment = {**os.environ, "PYTHONPATH": str(path), "OMP_NUM_THREADS": "1"}
            call = [sys.executable, __file__, "--once"]
            output = subprocess.run(call, env=environment, capture_output=True, text=True, check=True).stdout
            for key, value in json.loads(output).items():
                result[route, key].append(value)
    print("| mechanism | " + " | ".join(f"{kind}" for kind in ("places", "rates of points", "all")) + " |")
    print("|---|---|---|---|")
    for name in catalog.MECHANISMS:
        columns = []
        for kind in ("places", "rates", "all"):
            key = f"{name} {kind}"
            current = median(result["current", key])
            other = result.get(("other", key))
            columns.append(f"{median(other):.2f} to {current:.2f}" if other else f"{current:.2f}")
        print(f"| {name} | {' | '.join(columns)} |")


if __name__ == "__main__":
    main()
