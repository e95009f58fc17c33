"""Time of the loop equations for whole motions, compared with limits; about 20 s.

The time is that of positions, rates and accelerations of all links over a revolution or motion law, in
microseconds per configuration: of the first solution, with assembly and path tracing, and of a repeated one
on the known path. Processor time of one core, medians over interleaved rounds. Exits with 1 if the first
exceeds its limit.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/loop_speed.py
"""

import sys
import time
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver

ROUNDS = 15


@dataclass(frozen=True)
class Case:
    """A mechanism, the number of configurations, and the limit of the time of each in [us]."""

    solver: KinematicSolver
    poses: int
    limit: float

    def angles(self):
        return np.linspace(0.0, self.solver.period, self.poses)


def by_loops(name, **options):
    solver = load(name, **options)
    return solver if solver.closed_form is None else KinematicSolver(solver.mechanism)


def main() -> None:
    legs = {f"l{i}": f"155mm + 10mm*sin(2*pi*t + {i})" for i in range(1, 7)}
    cases = (
        Case(by_loops("four_bar"), 100, 100.0),
        Case(by_loops("rssr"), 10_000, 30.0),
        Case(by_loops("stewart_gough", drive=legs, duration=1.0), 1000, 250.0),
        Case(by_loops("jansen"), 1000, 250.0),
    )
    first_times: list[list[float]] = [[] for _ in cases]
    repeated_times: list[list[float]] = [[] for _ in cases]
    for _ in range(ROUNDS):
        for case, first_time, repeated_time in zip(cases, first_times, repeated_times, strict=True):
            unsolved, angles = replace(case.solver), case.angles()
            for times in (first_time, repeated_time):
                start = time.process_time()
                unsolved.solve_along(angles)
                times.append(1e6 * (time.process_time() - start) / case.poses)
    for case, first_time, repeated_time in zip(cases, first_times, repeated_times, strict=True):
        print(
            f"{case.solver.name:<14} {case.poses:>6} configurations: {median(first_time):6.1f} us each, "
            f"repeated {median(repeated_time):6.1f}; limit {case.limit:g}"
        )
    sys.exit(any(median(times) > case.limit for case, times in zip(cases, first_times, strict=True)))


if __name__ == "__main__":
    main()
