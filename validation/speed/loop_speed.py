"""Time of the loop equations for whole motions, compared with limits, and of those solved in a band; 30 s.

The time is that of positions, rates and accelerations of all links over a revolution or motion law, in
microseconds per configuration: of the first solution, with assembly and path tracing, and of a repeated one
on the known path. Processor time of one core, medians over interleaved rounds. Exits with 1 if the first
exceeds its limit.

Rows of four-bars are solved by dense matrices and in a band (`MIN_UNKNOWNS` of the loop solver: importing
scipy for the band takes about 150 ms), and nine random systems of 200 unknowns in bands whose width is a
fraction of their number (`MIN_RATIO`). Solutions of least norm are those of 1 and 50 chains, by
pseudo-inverses and by an augmented band (`SPARSE`). Forces along a row of 100 four-bars are evaluated for as
many states together as have `LINK_STATES` links; reactions of mechanisms with 3 and 7 links are solved by a
dense matrix, or in blocks above `DENSE_LINKS`.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/loop_speed.py
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from statistics import median
from timeit import timeit

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "published"))

from a02_four_bars import chain

from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import linearization, prescribed, reactions, statics
from mechsim.kinetics.model import dynamic_model
from mechsim.numerics import banded, loop_solver
from mechsim.numerics.rank import least_norm

ROUNDS, UNKNOWNS = 15, 200


def seconds(run: Callable[..., object], *arguments: object) -> float:
    return timeit(lambda: run(*arguments), timer=time.process_time, number=1)


def relative_time(own: Callable[[], object], other: Callable[[], object]) -> float:
    return median(seconds(own) / seconds(other) for _ in range(ROUNDS))


def microseconds(solver: KinematicSolver, poses: int) -> list[float]:
    unsolved, angles = replace(solver), np.linspace(0.0, solver.period, poses)
    return [1e6 * seconds(unsolved.solve_along, angles) / poses for _ in range(2)]


def main() -> None:
    legs = {f"l{i}": f"155mm + 10mm*sin(2*pi*t + {i})" for i in range(1, 7)}
    # the mechanism, the number of configurations, and the limit of the time of each in [us]
    cases = (
        (KinematicSolver(load("four_bar").mechanism), 100, 100.0),
        (KinematicSolver(load("rssr").mechanism), 10_000, 30.0),
        (load("stewart_gough", drive=legs, duration=1.0), 1000, 250.0),
        (load("jansen"), 1000, 250.0),
    )
    medians = np.median([[microseconds(*case[:2]) for case in cases] for _ in range(ROUNDS)], 0)
    for (solver, poses, limit), (first, repeated) in zip(cases, medians, strict=True):
        print(
            f"{solver.name:<14} {poses:>6}: {first:6.1f} us each, repeated {repeated:6.1f}; limit {limit:g}"
        )
    print_bands()
    print_forces()
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
    right = np.ones((9, UNKNOWNS))
    for ratio in (2, 4, 8, 16):
        i, j = np.nonzero(np.abs(np.subtract.outer(every, every)) <= UNKNOWNS // ratio // 2)
        values = number.standard_normal((len(i), 9)) + UNKNOWNS * (i == j)[:, None]
        order = banded.band(banded.SparseMatrices(i, j, values, (UNKNOWNS, UNKNOWNS)), every, every)
        systems = banded.BandedSystems(order, values[order.entries])
        dense = partial(np.linalg.solve, systems.dense, right[..., None])
        own = relative_time(lambda systems=systems: replace(systems).solution(right), dense)
        print(f"{UNKNOWNS} unknowns, {ratio:>2} times the width: {own:.2f} of the time of numpy")
    for count, n in ((20, 1), (20, 50), (40, 1), (60, 1)):
        chains = np.triu(np.tril(number.standard_normal((n, count, count)), 2), -2)[:, 1:]
        sparse = partial(banded.entries_of(chains).least_norm, chains[..., 0], {}, None, regular=True)
        own = relative_time(sparse, partial(least_norm, chains, chains[..., 0]))
        print(f"{count} unknowns, {n:>2} least solutions: {own:.2f} of the time of pseudo-inverses")


def print_forces() -> None:
    equations, q = statics.prepared_equations(KinematicSolver(chain(100)), None, {})
    basis = linearization.independent_rates(equations, q)[None].repeat(200, 0)
    for linearization.LINK_STATES in (1000, 10_000, 100_000):
        own = median(seconds(linearization.reduced_forces, equations, q.repeated(200), basis) for _ in "1234")
        print(f"{linearization.LINK_STATES:>6} links at once: {1e3 * own:.0f} ms for forces of 200 states")
    for name, n in product(("four_bar", "jansen"), (4, 400)):
        run = partial(prescribed, dynamic_model(load(name)), np.linspace(0.0, 0.1, n), speed=1.0)
        for reactions.DENSE_LINKS in (1000, 0):
            own = median(seconds(run) for _ in range(ROUNDS))
            print(f"{name}, {n} instants, dense up to {reactions.DENSE_LINKS} links: {1e3 * own:.1f} ms")


if __name__ == "__main__":
    main()
