"""Solved poses of MuJoCo in another assembly.

    python validation/robustness/solved_poses.py [--runs 200] [--seed 5]

The linkages have cranks that just pass an almost dead centre, or are regular ones. Reference: the closed
form at 181 crank angles of a revolution; an error above 1e-4 of the longest link is another assembly.
The exit code is 1 if there was any.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import MechsimError
from mechsim.model.scene import Scene
from mechsim.numerics.angles import REVOLUTION
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.poses import follow
from mechsim.simulation.source import assembled

sys.path.append(str(Path(__file__).parents[1] / "choices"))
import random_mechanisms
from assembly_detector import near_singular

OTHER_ASSEMBLY = 1e-4


def linkages(random: np.random.Generator, count: int) -> Iterator[tuple[str, ClosedForm]]:
    """Yield linkages with the group they belong to."""
    for _ in range(count):
        yield "almost dead centre", near_singular(random)
    for linkage in random_mechanisms.drives(random, count):
        yield f"regular {linkage.name}", linkage


def solve_poses(linkage: ClosedForm) -> tuple[str, float]:
    """Return the outcome, and the largest error of a tracked point in lengths of the model."""
    loops = read_loops(assembled(linkage.mechanism, Scene(level="pose")).compile())
    start = loops.model.qpos0
    angles = start[loops.crank_address] + np.linspace(0.0, REVOLUTION, 181)
    try:
        positions = loops.posed.site_positions(follow.follow(loops, start, angles))
    except MechsimError:
        return "rejected", 0.0
    exact = linkage.positions(angles)
    error = max(np.abs(positions[:, loops.model.site(name).id] - exact[name]).max() for name in exact)
    return "solved", float(error) / loops.characteristic_length


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Solved poses in another assembly.")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=5)
    options = parser.parse_args(arguments)
    counts: Counter[tuple[str, str]] = Counter()
    worst, wrong_count = 0.0, 0
    for group, linkage in linkages(np.random.default_rng(options.seed), options.runs):
        outcome, error = solve_poses(linkage)
        counts[group, outcome] += 1
        worst, wrong_count = max(worst, error), wrong_count + (error > OTHER_ASSEMBLY)
    for (group, outcome), count in sorted(counts.items()):
        print(f"{group:<20} {outcome:<9} {count}")
    print(f"{wrong_count} in another assembly; worst error {worst:.1e} of the longest link")
    return 1 if wrong_count else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
