"""Time of the configurations of a revolution solved in MuJoCo, in microseconds each.

The path is traced from one closed state, interpolated at the crank angles and closed to rounding; medians
over interleaved rounds. Target for 1,000 configurations of the spatial four-bar: 10.

Run: python validation/speed/pose_speed.py
"""

import time
from statistics import median

import numpy as np

from mechsim import catalog
from mechsim.mechanism.scene import Scene
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.poses import follow
from mechsim.simulation.source import assembled

NAMES = ("rssr", "four_bar", "slider_crank")
COUNTS = (100, 1000, 10_000)
ROUNDS = 15


def main() -> None:
    models = {name: assembled(catalog.make(name).mechanism, Scene(level="pose")).compile() for name in NAMES}
    loops = {name: read_loops(model) for name, model in models.items()}
    times: dict[tuple[str, int], list[float]] = {(name, n): [] for name in NAMES for n in COUNTS}
    for _ in range(ROUNDS):
        for name, n in times:
            model_loops = loops[name]
            start = model_loops.model.qpos0
            angles = start[model_loops.crank_address] + np.linspace(0.0, 2.0 * np.pi, n)
            begin = time.perf_counter()
            follow.follow(model_loops, start, angles)
            times[name, n].append(time.perf_counter() - begin)
    for (name, n), seconds in times.items():
        middle, best = (1e6 * each / n for each in (median(seconds), min(seconds)))
        print(f"{name:<13} {n:>6} configurations: {middle:6.2f} us each, at best {best:6.2f}")


if __name__ == "__main__":
    main()
