"""Are MuJoCo's solved poses ever in another assembly?

    python validation/robustness/solved_poses.py [--runs 200] [--seed 5]

Linkages whose cranks just pass an almost dead centre, and sound ones of every kind. Truth: the closed form
at 181 crank angles of a turn; an error above a ten-thousandth of the longest link is another assembly. The
exit code is 1 if there was any.
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
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.poses import follow
from mechsim.simulation.source import assembled

sys.path.append(str(Path(__file__).parents[1] / "choices"))
import random_mechanisms
from assembly_detector import near_singular

TURN = 2.0 * np.pi
ELSEWHERE = 1e-4


def linkages(random: np.random.Generator, count: int) -> Iterator[tuple[str, ClosedForm]]:
    """Yield what is tried, with the group it belongs to."""
    for _ in range(count):
        yield "almost dead centre", near_singular(random)
    for drive in random_mechanisms.drives(random, count):
        yield f"sound {drive.name}", drive


def tried(drive: ClosedForm) -> tuple[str, float]:
    """Return whether poses were solved, and the worst error of a tracked point in lengths of the model."""
    loops = read_loops(assembled(drive.mechanism, Scene(level="pose")).compile())
    start = loops.model.qpos0
    angles = start[loops.crank_address] + np.linspace(0.0, TURN, 181)
    try:
        places = loops.posed.site_positions(follow.follow(loops, start, angles))
    except MechsimError:
        return "rejected", 0.0
    exact = drive.positions(angles)
    error = max(np.abs(places[:, loops.model.site(name).id] - exact[name]).max() for name in exact)
    return "solved", float(error) / loops.characteristic_length


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Solved poses, right or wrong.")
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=5)
    asked = parser.parse_args(arguments)
    counts: Counter[tuple[str, str]] = Counter()
    worst, wrong = 0.0, 0
    for group, drive in linkages(np.random.default_rng(asked.seed), asked.runs):
        how, error = tried(drive)
        counts[group, how] += 1
        worst, wrong = max(worst, error), wrong + (error > ELSEWHERE)
    for (group, how), count in sorted(counts.items()):
        print(f"{group:<20} {how:<9} {count}")
    print(f"{wrong} in another assembly; worst error {worst:.1e} of the longest link")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
