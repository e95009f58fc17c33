"""Is a changed assembly always seen, and never where there is none? Runs that pass close to singular poses.

    python validation/robustness/assembly_detector.py [--runs 1200] [--seed 7]

Random mechanisms whose crank just turns fully: one length is moved until it is 1e-2 ... 1e-14 of itself from
where the crank would stop. The run starts half a turn away. They are stepped with 10 to 400 steps a turn,
hard and soft loops, several integrators: some stay, some jump, some tear their loops open.

Truth: both closed forms at the crank angles simulated. A run is in the other assembly if it comes
within a tenth of the way between them at two records in a row, its loops not torn open by half that
way, where they are a twentieth of their farthest apart or more; it is in its own if it stays within a
third of the way wherever they are a hundredth apart or more. The rest, loops torn open mostly, is in
neither, and not counted. Both detectors are compared with that: the simulator's own, which knows no
closed form, and the check's. The exit code is 1 if either has a false alarm or a miss.
"""

import argparse
import collections
import sys
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog import FourBar, Rrsrr, Rssr, SliderCrank
from mechsim.analytic.catalog.two_branch import TwoBranchForm
from mechsim.errors import MechsimError
from mechsim.model.motion import Motion
from mechsim.simulation import Settings, simulate
from mechsim.verdict.crosscheck import crosscheck

Array = NDArray[np.float64]
# the length that is moved until the crank only just passes
CRITICAL = {"four_bar": "coupler", "slider_crank": "rod", "rssr": "coupler", "rrsrr": "link"}
# how far apart both assemblies must be, next to their farthest: to be surely reported apart, to be at all
APART, BARELY = 0.05, 0.01
# parts of the way between them within which a run is in the other, and in its own
THERE, HERE = 0.1, 1.0 / 3.0


def near_singular(random: np.random.Generator) -> TwoBranchForm:
    """Return a random mechanism whose crank turns fully, but only just, past an almost dead centre."""
    kinds = (FourBar, SliderCrank, Rssr, Rrsrr)
    while True:
        kind = kinds[random.integers(len(kinds))]
        drive = kind(branch=int(random.choice([1, -1])))
        values = {}
        for name in ("ground", "crank", "coupler", "rocker", "rod", "link"):
            if hasattr(drive, name):
                values[name] = getattr(drive, name) * random.uniform(0.7, 1.4)
        drive = replace(drive, **values)
        name = CRITICAL[drive.name]
        moved = _to_the_brink(drive, name, 10.0 ** random.uniform(-14.0, -2.0))
        if moved is not None:
            return moved


def _to_the_brink(drive: TwoBranchForm, name: str, slack: float) -> TwoBranchForm | None:
    """Return the drive with a length changed so that the crank just turns fully, or None."""
    length = getattr(drive, name)

    def full(factor: float) -> bool:
        return replace(drive, **{name: factor * length}).crank_range().full

    if not full(1.0):
        return None
    for inside, outside in ((1.0, 0.3), (1.0, 3.0)):
        if full(outside):
            continue
        for _ in range(60):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if full(middle) else (inside, middle)
        factor = inside + slack * np.sign(inside - outside)
        moved = replace(drive, **{name: factor * length})
        return moved if moved.crank_range().full else None
    return None


def truth(drive: TwoBranchForm, motion: Motion) -> str:
    """Return "own", "other" or "neither", from the closed forms of both assemblies."""
    points = {name: point.position for name, point in motion.points.items()}
    own, other = drive.positions(motion.angle), replace(drive, branch=-drive.branch).positions(motion.angle)

    def far(a: dict[str, Array], b: dict[str, Array]) -> Array:
        return np.max([np.linalg.norm(a[name] - b[name], axis=1) for name in own], axis=0)

    gap, e_own, e_other = far(own, other), far(points, own), far(points, other)
    # with its loops torn open by half that way a run is in no assembly, wherever its points pass
    assert motion.closure is not None
    there = (e_other < THERE * gap) & (gap >= APART * gap.max()) & (motion.closure < 0.5 * gap)
    if (there[1:] & there[:-1]).any():
        return "other"
    return "own" if (e_own < HERE * gap)[gap >= BARELY * gap.max()].all() else "neither"


def random_settings(random: np.random.Generator) -> Settings:
    steps = int(10.0 ** random.uniform(1.0, 2.6))
    integrator = str(random.choice(["RK4", "RK4", "implicitfast", "Euler"]))
    if random.random() < 0.5:
        return Settings(steps_per_turn=steps, integrator=integrator)
    compliance = float(10.0 ** random.uniform(-8.0, 0.0))
    return Settings(steps_per_turn=steps, integrator=integrator, compliance=compliance, constant_steps=2.0)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="False alarms and misses of the changed-assembly detectors.")
    parser.add_argument("--runs", type=int, default=1200)
    parser.add_argument("--seed", type=int, default=7)
    asked = parser.parse_args(arguments)
    random = np.random.default_rng(asked.seed)
    counts: collections.Counter[tuple[str, str, str]] = collections.Counter()
    wrong: list[str] = []
    judged = 0
    while judged < asked.runs:
        drive, settings = near_singular(random), random_settings(random)
        closest = _closest(drive)
        try:
            run = simulate(_started(drive, closest + np.pi), speed=10.0, settings=settings)
        except MechsimError as error:
            counts["refused", str(error).split(":")[1][:40], ""] += 1
            continue
        if run.outcome == "diverged":
            counts["diverged", "", ""] += 1
            continue
        verdict = crosscheck(run.motion, drive)
        known = truth(drive, run.motion)
        counts[known, run.outcome, verdict.outcome] += 1
        if known == "neither":
            continue
        judged += 1
        observed = {"simulator": run.outcome, "judge": verdict.outcome}
        for who, outcome in observed.items():
            if (outcome == "changed assembly") != (known == "other"):
                wrong.append(f"{who} said {outcome}, truth {known}: {drive} {settings}")
    print("truth     simulator         judge             runs")
    for (known, own, judge), count in sorted(counts.items()):
        print(f"{known:<9} {own:<17} {judge:<17} {count}")
    print(f"{judged} runs judged, {len(wrong)} false alarms and misses")
    for line in wrong[:12]:
        print(line)
    return 1 if wrong else 0


def _closest(drive: TwoBranchForm) -> float:
    angles = np.linspace(-np.pi, np.pi, 2000)
    return float(angles[np.argmin(drive.discriminant(angles))])


def _started(drive: TwoBranchForm, angle: float):
    """Return the mechanism with its start at a crank angle."""
    from mechsim.model.links import Pose

    motion = drive.solve([angle])
    guess = {name: Pose(link.position[0], link.rotation[0]) for name, link in motion.links.items()}
    return drive.mechanism.with_guess(guess, angle)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
