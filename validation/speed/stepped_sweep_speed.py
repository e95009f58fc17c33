"""What a stepped sweep costs next to bare `mujoco.batch`: 10,000 turns of `four_bar`, RK4, 100 steps each.

Bare is one batch of as many simulations of one model, on all cores, recording joint positions: no design of
its own, no start closed, nothing measured, nothing judged. Both run in turn in one process; ratios are of
their medians. Wanted: 1.2 at most.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/stepped_sweep_speed.py [designs] [rounds]
"""

import copy
import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from mujoco import batch

import mechsim as ms
from mechsim.simulation import Settings
from mechsim.simulation.driven_run import first_state
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.source import from_source

SPEED, STEPS, WANTED = 62.8, 100, 1.2
SPANS = {"crank": (0.029, 0.035), "coupler": (0.085, 0.095)}
SETTINGS = Settings(steps_per_turn=STEPS, jacobian="dense")
MEASURES = {"range:rocker": "range:rocker", "stroke of a point": "stroke:C", "acceleration": "max:C.a"}


def bare() -> tuple[ModelLoops, tuple[np.ndarray, np.ndarray]]:
    """Return a model set up for stepping, and the state in which it starts."""
    closed = from_source(ms.catalog.make("four_bar"))
    profile = ms.simulation.constant(SPEED, 1.0, closed.angle)
    loops = replace(closed.loops, model=copy.copy(closed.loops.model))
    SETTINGS.apply(loops, profile.duration / STEPS)
    return loops, first_state(closed, profile)


def timed(what: Callable[[], object]) -> tuple[float, float]:
    """Return wall and processor time in [s]."""
    wall, busy = time.perf_counter(), time.process_time()
    what()
    return time.perf_counter() - wall, time.process_time() - busy


def main() -> None:
    designs, rounds = (int(item) for item in (*sys.argv[1:], *("10000", "5")[len(sys.argv) - 1 :]))
    loops, (qpos, qvel) = bare()

    def stepped() -> None:
        sims = batch.Batch(loops.model, designs)
        sims.bind("qpos")[:], sims.bind("qvel")[:] = qpos, qvel
        sims.rollout(STEPS, record=("qpos",))

    def swept(measure: str, count: int = designs) -> None:
        result = ms.sweep("four_bar", SPANS, measure, sample=f"sobol:{count}", settings=SETTINGS, speed=SPEED)
        assert (result["outcome"] == "passed").all()

    runs = {"bare": stepped} | {name: lambda item=item: swept(item) for name, item in MEASURES.items()}
    # libraries are loaded once
    swept("range:rocker", 64)
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            times[name].append(timed(run))
    base = np.median(times["bare"], axis=0)
    print(f"{designs:,} designs, medians of {rounds} rounds")
    for name, result in times.items():
        wall, busy = np.median(result, axis=0)
        print(
            f"{name:<20} wall {wall:7.2f} s ({wall / base[0]:.2f} of bare), processor {busy:7.2f} s "
            f"({busy / base[1]:.2f} of bare), {1e6 * busy / designs:.0f} us a design"
        )
    print(f"wanted: {WANTED} of bare for {next(iter(MEASURES))}")


if __name__ == "__main__":
    main()
