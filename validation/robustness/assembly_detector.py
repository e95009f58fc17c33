"""Count missed and false detections of a changed assembly in runs that pass close to singular poses.

    python validation/robustness/assembly_detector.py [--runs 1200] [--seed 7]

Each random mechanism has a crank that just rotates fully: one length is 1e-2 to 1e-14 of itself from the
value that stops the crank. The run starts half a revolution away, with 10 to 400 steps a revolution, stiff
or compliant loops and several integrators. Some runs stay in their assembly, some change it, and in some the
loop-closure error is large.

Reference: the closed forms of both assemblies at the simulated crank angles. Span is the distance
between the assemblies. A run is in the other assembly if it comes within a tenth of the span in two
consecutive records with a loop-closure error below half of it, where the separation is at least a twentieth
of its maximum. It is in its own assembly if it stays within a third of the span wherever that is at
least a hundredth of its maximum. Other runs are in neither assembly and are not counted. Two detectors are
compared with the reference: the simulator's, which knows no closed form, and the check's. The exit code is
1 if either has a false alarm or a miss.
"""

import argparse
import collections
import sys

import numpy as np
from numpy.typing import NDArray

from mechsim import catalog
from mechsim.compare.crosscheck import crosscheck
from mechsim.errors import MechsimError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import Motion
from mechsim.simulation import Settings, simulate

Array = NDArray[np.float64]
# the length that is changed until the crank just rotates fully
CRITICAL = {"four_bar": "coupler", "slider_crank": "rod", "rssr": "coupler", "rrsrr": "link"}
# smallest span of the assemblies, relative to the largest: for the other assembly, for the own one
MIN_SPAN, ANY_SPAN = 0.05, 0.01
# fraction of the span within which a run is in the other assembly, and in its own
NEAR_OTHER, NEAR_OWN = 0.1, 1.0 / 3.0


def near_singular(random: np.random.Generator) -> KinematicSolver:
    """Return a random mechanism whose crank just rotates fully, past an almost dead centre."""
    names = ("four_bar", "slider_crank", "rssr", "rrsrr")
    while True:
        name = names[random.integers(len(names))]
        linkage = catalog.make(name, branch=int(random.choice([1, -1])))
        lengths = {}
        for length_name in ("ground", "crank", "coupler", "rocker", "rod", "link"):
            if hasattr(linkage, length_name):
                lengths[length_name] = getattr(linkage, length_name) * random.uniform(0.7, 1.4)
        linkage = linkage.with_parameters(**lengths)
        length_name = CRITICAL[linkage.name]
        result = just_rotating(linkage, length_name, 10.0 ** random.uniform(-14.0, -2.0))
        if result is not None:
            return result


def just_rotating(linkage: KinematicSolver, length_name: str, slack: float) -> KinematicSolver | None:
    """Return the linkage with one length changed so that the crank just rotates fully, or None."""
    length = getattr(linkage, length_name)

    def rotates_fully(factor: float) -> bool:
        return linkage.with_parameters(**{length_name: factor * length}).crank_range().full

    if not rotates_fully(1.0):
        return None
    for rotating, blocked in ((1.0, 0.3), (1.0, 3.0)):
        if rotates_fully(blocked):
            continue
        for _ in range(60):
            middle = 0.5 * (rotating + blocked)
            rotating, blocked = (middle, blocked) if rotates_fully(middle) else (rotating, middle)
        factor = rotating + slack * np.sign(rotating - blocked)
        result = linkage.with_parameters(**{length_name: factor * length})
        return result if result.crank_range().full else None
    return None


def reference_assembly(linkage: KinematicSolver, motion: Motion) -> str:
    """Return "own", "other" or "neither", from the closed forms of both assemblies."""
    points = {name: point.position for name, point in motion.points.items()}
    own, other = (
        linkage.positions(motion.angle),
        linkage.with_parameters(branch=-linkage.branch).positions(motion.angle),
    )

    def distance(a: dict[str, Array], b: dict[str, Array]) -> Array:
        return np.max([np.linalg.norm(a[name] - b[name], axis=1) for name in own], axis=0)

    span, own_error, other_error = distance(own, other), distance(points, own), distance(points, other)
    # a run with a loop-closure error of half the span is in no assembly
    assert motion.closure is not None
    in_other = (
        (other_error < NEAR_OTHER * span) & (span >= MIN_SPAN * span.max()) & (motion.closure < 0.5 * span)
    )
    if (in_other[1:] & in_other[:-1]).any():
        return "other"
    return "own" if (own_error < NEAR_OWN * span)[span >= ANY_SPAN * span.max()].all() else "neither"


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
    options = parser.parse_args(arguments)
    random = np.random.default_rng(options.seed)
    counts: collections.Counter[tuple[str, str, str]] = collections.Counter()
    failures: list[str] = []
    compared = 0
    while compared < options.runs:
        linkage, settings = near_singular(random), random_settings(random)
        angle = closest_angle(linkage)
        try:
            run = simulate(start_at(linkage, angle + np.pi), speed=10.0, settings=settings)
        except MechsimError as error:
            counts["rejected", str(error).split(":")[1][:40], ""] += 1
            continue
        if run.outcome == "diverged":
            counts["diverged", "", ""] += 1
            continue
        verdict = crosscheck(run.motion, linkage)
        expected = reference_assembly(linkage, run.motion)
        counts[expected, run.outcome, verdict.outcome] += 1
        if expected == "neither":
            continue
        compared += 1
        outcomes = {"simulator": run.outcome, "check": verdict.outcome}
        for detector, outcome in outcomes.items():
            if (outcome == "changed assembly") != (expected == "other"):
                failures.append(f"{detector} reports {outcome}, reference {expected}: {linkage} {settings}")
    print("reference simulator         check             runs")
    for (expected, simulator, check), count in sorted(counts.items()):
        print(f"{expected:<9} {simulator:<17} {check:<17} {count}")
    print(f"{compared} runs compared, {len(failures)} false alarms and misses")
    for line in failures[:12]:
        print(line)
    return 1 if failures else 0


def closest_angle(linkage: KinematicSolver) -> float:
    angles = np.linspace(-np.pi, np.pi, 2000)
    return float(angles[np.argmin(linkage.closed_form.discriminant(angles))])


def start_at(linkage: KinematicSolver, angle: float):
    """Return the mechanism with its start at a crank angle."""
    from mechsim.mechanism.links import Pose

    motion = linkage.solve([angle])
    guess = {name: Pose(link.position[0], link.rotation[0]) for name, link in motion.links.items()}
    return linkage.mechanism.with_guess(guess, angle)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
