"""How many poses a second the closed form of the spatial four-bar gives on one core.

OMP_NUM_THREADS=1 python validation/speed/closed_form_speed.py
"""

import time
from collections.abc import Callable
from statistics import median

import numpy as np

from mechsim import catalog

POSES = 200_000
# wanted poses a second: places of points; their rates too
TARGETS = {"positions": 5e6, "solve(links=False)": 1e6}


def poses_per_second(call: Callable[[], object], repeats: int = 9) -> float:
    """Return the median over repeats, after one call that warms caches."""
    call()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return POSES / median(times)


def main() -> None:
    drive = catalog.make("rssr")
    angles = np.linspace(0.0, 2 * np.pi, POSES)
    calls: dict[str, Callable[[], object]] = {
        "positions": lambda: drive.positions(angles),
        "solve(links=False)": lambda: drive.solve(angles, 62.8, links=False),
        "solve": lambda: drive.solve(angles, 62.8),
    }
    for name, call in calls.items():
        wanted = f", wanted {TARGETS[name] / 1e6:.0f}" if name in TARGETS else ""
        print(f"rssr {name}: {poses_per_second(call) / 1e6:.2f} million poses a second{wanted}")


if __name__ == "__main__":
    main()
