"""Time of the loop equations for whole motions, compared with limits, and of those solved in a band; 30 s.

The time is that of positions, rates and accelerations of all links over a revolution or motion law, in
microseconds per configuration: of the first solution, with assembly and path tracing, and of a repeated one
on the known path. Processor time of one core, medians over interleaved rounds. Exits with 1 if the first
exceeds its limit.

Rows of four-bars are solved by dense matrices and in a band (`MIN_UNKNOWNS` of the loop solver: importing
scipy for the band takes about 150 ms), and nine random systems of 200 unknowns in bands whose width is a
fraction of their number (`MIN_RATIO`).

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/loop_speed.py
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "published"))

from a02_four_bars import chain

from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics import banded, loop_solver

ROUNDS, UNKNOWNS = 15, 200


def by_loops(name, **options):
    solver = load(name, **options)
    return solver if solver.closed_form is None else KinematicSolver(solver.mechanism)


def seconds(run: Callable[..., object], *arguments: object) -> float:
    start = time.process_time()
    run(*arguments)
    return time.process_time() - start


def main() -> None:
    legs = {f"l{i}": f"155mm + 10mm*sin(2*pi*t + {i})" for i in range(1, 7)}
    # the mechanism, the number of configurations, and the limit of the time of each in [us]
    cases = (
        (by_loops("four_bar"), 100, 100.0),
        (by_loops("rssr"), 10_000, 30.0),
        (by_loops("stewart_gough", drive=legs, duration=1.0), 1000, 250.0),
        (by_loops("jansen"), 1000, 250.0),
    )
    times: list[list[tuple[float, float]]] = [[] for _ in cases]
    for _ in range(ROUNDS):
        for (solver, poses, _), own in zip(cases, times, strict=True):
            unsolved, angles = replace(solver), np.linspace(0.0, solver.period, poses)
            first, repeated = (seconds(unsolved.solve_along, angles) for _ in range(2))
            own.append((1e6 * first / poses, 1e6 * repeated / poses))
    medians = np.median(times, 1)
    for (solver, poses, limit), (first, repeated) in zip(cases, medians, strict=True):
        print(
            f"{solver.name:<14} {poses:>6} configurations: {first:6.1f} us each, "
            f"repeated {repeated:6.1f}; limit {limit:g}"
        )
    print_bands()
    sys.exit(any(first > limit for (_, _, limit), (first, _) in zip(cases, medians, strict=True)))


def print_bands() -> None:
    for count in (12, 25, 50, 100):
        row, angles = KinematicSolver(chain(count)), np.pi / 2.0 - np.linspace(0.0, 0.3, 100)
        by_method: list[list[float]] = [[], []]
        for i in [0, 1] * 4:
            loop_solver.MIN_UNKNOWNS = (10_000, 1)[i]
            by_method[i].append(1e3 * seconds(replace(row).solve_along, angles))
        dense, own = (median(each[1:]) for each in by_method)
        print(f"{2 * count:>4} unknowns, 100 configurations: dense {dense:5.0f} ms, in a band {own:5.0f} ms")
    banded.MIN_RATIO, number, every = 0, np.random.default_rng(0), np.arange(UNKNOWNS)
    for ratio in (2, 4, 8, 16):
        i, j = np.nonzero(np.abs(np.subtract.outer(every, every)) <= UNKNOWNS // ratio // 2)
        values = number.standard_normal((len(i), 9)) + UNKNOWNS * (i == j)[:, None]
        order = banded.band(banded.SparseMatrices(i, j, values, (UNKNOWNS, UNKNOWNS)), every, every)
        matrices, right = banded.BandedSystems(order, values[order.entries]), np.ones((9, UNKNOWNS))
        dense = matrices.dense
        ratios = [
            seconds(replace(matrices).solution, right) / seconds(np.linalg.solve, dense, right[..., None])
            for _ in range(ROUNDS)
        ]
        print(f"{UNKNOWNS} unknowns, {ratio:>2} times the width: {median(ratios):.2f} of the time of numpy")


if __name__ == "__main__":
    main()
