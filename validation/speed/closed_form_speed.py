"""Configurations per second of the closed form of the spatial four-bar, on one core.

OMP_NUM_THREADS=1 python validation/speed/closed_form_speed.py
"""

import time
from collections.abc import Callable
from statistics import median

import numpy as np

from mechsim import catalog

POSES = 200_000
# configurations per second: positions of points; with their rates
TARGETS = {"positions": 5e6, "motion(links=False)": 1e6}


def poses_per_second(call: Callable[[], object], repeats: int = 9) -> float:
    """Return the median over repeats, after one call that fills caches."""
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return POSES / median(times)


def main() -> None:
    closed_form = catalog.make("rssr")
    angles = np.linspace(0.0, 2 * np.pi, POSES)
    calls: dict[str, Callable[[], object]] = {
        "positions": lambda: closed_form.positions(angles),
        "motion(links=False)": lambda: closed_form.closed_form.motion(angles, 62.8, links=False),
        "solve": lambda: closed_form.solve(angles, 62.8),
    }
    for name, call in calls.items():
        target = f", target {TARGETS[name] / 1e6:.0f}" if name in TARGETS else ""
        print(f"rssr {name}: {poses_per_second(call) / 1e6:.2f} million poses a second{target}")


if __name__ == "__main__":
    main()
