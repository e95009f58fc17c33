"""Processor time of runs from an initial state, setup included, of this tree and of another, in turns.

The cases are those of issue 41: a released four-bar, Andrews' squeezer, a motor, the rssr, an event, a rod
joint and a friction with bristles. Medians over interleaved processes.

Run: python validation/speed/forward_runs.py [OTHER TREE]
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import mechsim as ms
from mechsim.mechanism.forces import Forces, Friction
from mechsim.mechanism.motors import DCMotor, Geared

TREE, ROUNDS, REPEATED = Path(__file__).parents[2], 3, 4
WEIGHT = (0.0, -9.81, 0.0)
MOTOR = Geared(DCMotor(12.0, 1.0, 0.02), 9.0)
BRISTLES = Friction("crank", coulomb=1e-3, bristle_stiffness=10.0, bristle_damping=1e-3)
RODS = str(ms.catalog.models() / "machines" / "peaucellier_rods.toml")


def cases() -> Iterator[tuple[str, Any, Forces, dict[str, Any]]]:
    """Yield a name, a mechanism, forces and settings."""
    from validation.published.a03_squeezer import forces, squeezer

    weight, four_bar = Forces(gravity=WEIGHT), ms.load("four_bar")
    yield "four_bar", four_bar, weight, {"duration": 1.0, "samples": 20, "tolerance": 1e-9}
    yield "squeezer", squeezer(), forces(), {"duration": 0.05, "samples": 20, "tolerance": 1e-10}
    yield "motor, 8 turns", four_bar, Forces(gravity=WEIGHT, motor=MOTOR), {"turns": 8}
    yield "rssr, 4 turns", ms.load("rssr"), weight, {"initial": {"crank.v": 62.8}, "turns": 4}
    yield "until", four_bar, weight, {"duration": 10.0, "until": "A.y=0.123"}
    yield "rods", ms.load(RODS, still=True), weight, {"duration": 0.3}
    yield "bristles", four_bar, Forces(gravity=WEIGHT, friction=(BRISTLES,)), {"duration": 0.05}


def measured() -> None:
    """Print the milliseconds of each case."""
    for name, source, forces, settings in cases():
        model, seconds = ms.dynamics.dynamic_model(source, forces), list[float]()
        for _ in range(REPEATED):
            start = time.process_time()
            ms.dynamics.run(model, **settings)
            seconds.append(time.process_time() - start)
        print(f"{name}|{1e3 * median(seconds)}")


def main(trees: list[str]) -> None:
    rows: dict[str, list[list[float]]] = {}
    for _ in range(ROUNDS):
        for k, tree in enumerate(trees):
            environment = os.environ | {"PYTHONPATH": tree, "OPENBLAS_NUM_THREADS": "1"}
            command = [sys.executable, __file__, "--measure"]
            text = subprocess.run(
                command, env=environment, stdout=subprocess.PIPE, text=True, check=True
            ).stdout
            for name, value in (line.split("|") for line in text.splitlines()):
                rows.setdefault(name, [[] for _ in trees])[k].append(float(value))
    for name, values in rows.items():
        print(f"{name:16}" + "".join(f"{median(each):10.2f} ms" for each in values), flush=True)


if __name__ == "__main__":
    measured() if sys.argv[1:] == ["--measure"] else main([str(TREE), *sys.argv[1:]])
