"""Configurations per second of the closed form of the spatial four-bar, on one core.

OMP_NUM_THREADS=1 python validation/speed/closed_form_speed.py
"""

import timeit
from collections.abc import Callable
from statistics import median

import numpy as np

from mechsim import catalog

POSES = 200_000
# configurations per second: positions of points; with their rates
TARGETS = {"positions": 5e6, "motion(links=False)": 1e6}


def main() -> None:
    closed_form, angles = catalog.make("rssr"), np.linspace(0.0, 2 * np.pi, POSES)
    calls: dict[str, Callable[[], object]] = {
        "positions": lambda: closed_form.positions(angles),
        "motion(links=False)": lambda: closed_form.closed_form.motion(angles, 62.8, links=False),
        "solve": lambda: closed_form.solve(angles, 62.8),
    }
    for name, call in calls.items():
        target = f", target {TARGETS[name] / 1e6:.0f}" if name in TARGETS else ""
        # the first call fills caches
        seconds = median(timeit.repeat(call, number=1, repeat=10)[1:])
        print(f"rssr {name}: {POSES / seconds / 1e6:.2f} million poses a second{target}")


if __name__ == "__main__":
    main()
