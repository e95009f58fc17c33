"""Time and memory that mechsim adds to bare stepping in C.

Time: 100,000 steps of the same model with the same settings, by one bare `Batch.rollout` that records
nothing, by mechsim's stepping loop, and by `simulate` with its checks of every recorded instant; medians over
interleaved rounds. Target: stepping within 5 % of bare. Memory: a run of a million steps that records 72
instants, by tracemalloc and by the process.

Run: python validation/speed/step_overhead.py [ROUNDS [TURNS OF THE LONG RUN]]
"""

import copy
import resource
import sys
import time
import tracemalloc
from collections.abc import Callable
from statistics import median

import numpy as np
from mujoco import batch

from mechsim import catalog
from mechsim.model.scene import Scene
from mechsim.simulation import Settings, constant, loop_jacobian, simulate
from mechsim.simulation.model_loops import ModelLoops, read_loops
from mechsim.simulation.source import assembled
from mechsim.simulation.stepping import step

SPEED = 20.0 * np.pi
STEPS, TURNS = 100_000, 100
SETTINGS = Settings(steps_per_turn=STEPS // TURNS)
ROUNDS = 5


def main(rounds: int = ROUNDS, turns: int = 1000) -> None:
    mechanism = catalog.make("rssr").mechanism
    loops = read_loops(assembled(mechanism, Scene()).compile())
    start = loops.model.qpos0
    rates = SPEED * loop_jacobian.tangent(loops, loops.linearise(start[None])[1])[0]
    profile = constant(SPEED, TURNS, float(start[loops.crank_address]))

    def copied() -> ModelLoops:
        return read_loops(copy.copy(loops.model))

    def bare_rollout() -> None:
        copied_loops = copied()
        SETTINGS.apply(copied_loops, SETTINGS.timestep(SPEED))
        sims = batch.Batch(copied_loops.model, 1, 1)
        sims.bind("qpos")[:], sims.bind("qvel")[:] = start, rates
        sims.rollout(STEPS, record=())

    def mechsim_stepping() -> None:
        step(copied(), SETTINGS, profile, (start, rates), STEPS, STEPS // TURNS // 72)

    def simulated_run(samples: int | None) -> Callable[[], None]:
        def run() -> None:
            simulate(mechanism, speed=SPEED, turns=TURNS, settings=SETTINGS, samples=samples)

        return run

    runs: dict[str, Callable[[], None]] = {
        "bare rollout in C": bare_rollout,
        "mechsim's stepping": mechsim_stepping,
        "simulate, 72 samples": simulated_run(72),
        "simulate, 7,200 samples": simulated_run(7200),
    }
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run_once in runs.items():
            begin = time.process_time()
            run_once()
            times[name].append(time.process_time() - begin)
    for name, seconds in times.items():
        ratio = median(a / b for a, b in zip(seconds, times["bare rollout in C"], strict=True))
        per_step, overhead = 1e6 * median(seconds) / STEPS, 100.0 * (ratio - 1.0)
        print(f"{name:<24} {per_step:6.2f} us a step, {overhead:+6.1f} % relative to bare")

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    run = simulate(mechanism, speed=SPEED, turns=turns, samples=72, settings=SETTINGS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(f"{run.steps:,} steps: peak {peak / 1e6:.2f} MB in Python, process {growth / 1024:+.1f} MB")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
