"""Cost of a stepped sweep relative to bare `mujoco.batch`: 10,000 turns of `four_bar`, RK4, 100 steps each.

Bare is one batch of as many simulations of one model, on all cores, that records joint positions. It changes
no dimension, closes no initial configuration, and measures and checks nothing. Both run in turn in one
process; ratios are of their medians. Target: at most 1.2.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/sweep_speed.py [designs] [rounds]
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

SPEED, STEPS, TARGET = 62.8, 100, 1.2
SPANS = {"crank": (0.029, 0.035), "coupler": (0.085, 0.095)}
SETTINGS = Settings(steps_per_turn=STEPS, jacobian="dense")
MEASURES = {"range:rocker": "range:rocker", "stroke of a point": "stroke:C", "acceleration": "max:C.a"}


def bare_model() -> tuple[ModelLoops, tuple[np.ndarray, np.ndarray]]:
    """Return a model set up for stepping, and the state in which it starts."""
    closed = from_source(ms.catalog.make("four_bar"))
    profile = ms.simulation.constant(SPEED, 1.0, closed.angle)
    loops = replace(closed.loops, model=copy.copy(closed.loops.model))
    SETTINGS.apply(loops, profile.duration / STEPS)
    return loops, first_state(closed, profile)


def wall_and_cpu(call: Callable[[], object]) -> tuple[float, float]:
    """Return wall and processor time in [s]."""
    wall, processor = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - wall, time.process_time() - processor


def main() -> None:
    designs, rounds = (int(text) for text in (*sys.argv[1:], *("10000", "5")[len(sys.argv) - 1 :]))
    loops, (qpos, qvel) = bare_model()

    def bare_rollout() -> None:
        sims = batch.Batch(loops.model, designs)
        sims.bind("qpos")[:], sims.bind("qvel")[:] = qpos, qvel
        sims.rollout(STEPS, record=("qpos",))

    def sweep(measure: str, count: int = designs) -> None:
        result = ms.sweep("four_bar", SPANS, measure, sample=f"sobol:{count}", settings=SETTINGS, speed=SPEED)
        assert (result["outcome"] == "passed").all()

    runs = {"bare": bare_rollout}
    runs |= {name: lambda item=item: sweep(item) for name, item in MEASURES.items()}
    # load libraries before timing
    sweep("range:rocker", 64)
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            times[name].append(wall_and_cpu(run))
    bare_time = np.median(times["bare"], axis=0)
    print(f"{designs:,} designs, medians of {rounds} rounds")
    for name, result in times.items():
        wall, cpu = np.median(result, axis=0)
        print(
            f"{name:<20} wall {wall:7.2f} s ({wall / bare_time[0]:.2f} of bare), processor {cpu:7.2f} s "
            f"({cpu / bare_time[1]:.2f} of bare), {1e6 * cpu / designs:.0f} us a design"
        )
    print(f"target: {TARGET} of bare for {next(iter(MEASURES))}")


if __name__ == "__main__":
    main()
