"""What mechsim adds to bare stepping in C, in time and in memory.

Time: 100,000 steps of the same model with the same settings, by one bare `Batch.rollout` that records
nothing, by mechsim's stepping loop, and by the whole of `simulate` with its verdict on every recorded
pose; medians over interleaved rounds. Wanted: stepping within 5 % of bare. Memory: a run of a million
steps of which 72 instants are recorded, by tracemalloc and by the process.

Run: python validation/speed/step_overhead.py
"""

import copy
import resource
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


def main() -> None:
    mechanism = catalog.make("rssr").mechanism
    loops = read_loops(assembled(mechanism, Scene()).compile())
    start = loops.model.qpos0
    rates = SPEED * loop_jacobian.tangent(loops, loops.linearise(start[None])[1])[0]
    profile = constant(SPEED, TURNS, float(start[loops.crank_address]))

    def fresh() -> ModelLoops:
        return read_loops(copy.copy(loops.model))

    def bare() -> None:
        own = fresh()
        SETTINGS.apply(own, SETTINGS.timestep(SPEED))
        sims = batch.Batch(own.model, 1, 1)
        sims.bind("qpos")[:], sims.bind("qvel")[:] = start, rates
        sims.rollout(STEPS, record=())

    def wrapped() -> None:
        step(fresh(), SETTINGS, profile, (start, rates), STEPS, STEPS // TURNS // 72)

    def whole(samples: int | None) -> Callable[[], None]:
        def run() -> None:
            simulate(mechanism, speed=SPEED, turns=TURNS, settings=SETTINGS, samples=samples)

        return run

    ways: dict[str, Callable[[], None]] = {
        "bare rollout in C": bare,
        "mechsim's stepping": wrapped,
        "simulate, 72 samples": whole(72),
        "simulate, 7,200 samples": whole(7200),
    }
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, direction in ways.items():
            begin = time.process_time()
            direction()
            times[name].append(time.process_time() - begin)
    for name, spent in times.items():
        ratio = median(a / b for a, b in zip(spent, times["bare rollout in C"], strict=True))
        each, more = 1e6 * median(spent) / STEPS, 100.0 * (ratio - 1.0)
        print(f"{name:<24} {each:6.2f} us a step, {more:+6.1f} % beside bare")

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    run = simulate(mechanism, speed=SPEED, turns=1000, samples=72, settings=SETTINGS)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    print(f"{run.steps:,} steps: peak {peak / 1e6:.2f} MB of Python's, process {grown / 1024:+.1f} MB")


if __name__ == "__main__":
    main()
