"""How long the loop equations take for whole motions, next to what was asked of them; about 20 s.

Places, rates and accelerations of all links over one turn or program, in microseconds a pose: of a mechanism
put together, checked and followed from its description, and of the same again, its path known. Processor
time of one core, medians over interleaved rounds. Ends with 1 where the first exceeds what was asked.

Run: OPENBLAS_NUM_THREADS=1 python validation/speed/loop_speed.py
"""

import sys
import time
from dataclasses import dataclass, replace
from statistics import median

import numpy as np

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.subjects.readers import load

ROUNDS = 15


@dataclass(frozen=True)
class Asked:
    """A motion: of what, how many poses of it, and the time asked for in [us] a pose."""

    form: LoopForm
    poses: int
    bound: float

    def angles(self):
        return np.linspace(0.0, self.form.period, self.poses)


def by_loops(name, **asked):
    form = load(name, **asked)
    return form if isinstance(form, LoopForm) else LoopForm(form.mechanism)


def main() -> None:
    legs = {f"l{i}": f"155mm + 10mm*sin(2*pi*t + {i})" for i in range(1, 7)}
    asked = (
        Asked(by_loops("four_bar"), 100, 100.0),
        Asked(by_loops("rssr"), 10_000, 30.0),
        Asked(by_loops("stewart_gough", drive=legs, duration=1.0), 1000, 250.0),
        Asked(by_loops("jansen"), 1000, 250.0),
    )
    whole: list[list[float]] = [[] for _ in asked]
    known: list[list[float]] = [[] for _ in asked]
    for _ in range(ROUNDS):
        for item, first, again in zip(asked, whole, known, strict=True):
            fresh, angles = replace(item.form), item.angles()
            for spent in (first, again):
                begin = time.process_time()
                fresh.solve_along(angles)
                spent.append(1e6 * (time.process_time() - begin) / item.poses)
    for item, first, again in zip(asked, whole, known, strict=True):
        print(
            f"{item.form.name:<14} {item.poses:>6} poses: {median(first):6.1f} us a pose, the path known "
            f"{median(again):6.1f}; asked {item.bound:g}"
        )
    sys.exit(any(median(first) > item.bound for item, first in zip(asked, whole, strict=True)))


if __name__ == "__main__":
    main()
