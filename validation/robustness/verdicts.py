"""Random catalogue mechanisms by every method: none rejected or failed, and runs agree with verdicts.

Each is validated, then moved through its range, a random swing inside it on any revolution, and a swing that
ends close to a dead centre, by poses and by steps. The outcome of every run must agree with its verdict. A
mechanism with one length 0.1 % too long must fail the check.

    python validation/robustness/verdicts.py [--count 800] [--seed 1] [--part K N] [--case NUMBER]

Each mechanism follows from its number: `--part K N` runs every Nth, and `--case` one alone.
"""

import argparse
import sys
import time as timer
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from random_catalog_mechanisms import SPEED, random_mechanism, random_swing, swing_near_dead_centre

from mechsim.compare.crosscheck import crosscheck
from mechsim.compare.quantities import stroke_of
from mechsim.errors import AssemblyError, MechsimError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import POSITION_TOLERANCE
from mechsim.mechanism.motion_laws import CrankProfile, within_range
from mechsim.simulation import Settings, simulate
from mechsim.studies.validate import case_of

# scale of the wrong length
WRONG_SCALE = 1.001
# smallest distance of the end of a swing from a dead centre, in [rad]
NEAREST = {"pose": 1e-5, "step": 1e-4}
# mechanisms between two progress lines
REPORT_EVERY = 25


@dataclass
class Results:
    """Number of checks and faults, by kind."""

    tried: Counter[str] = field(default_factory=Counter)
    faults: dict[str, list[str]] = field(default_factory=dict)
    number: int = 0

    def fault(self, kind: str, text: str) -> None:
        print(f"FAULT {self.number} {kind}: {text}", flush=True)
        self.faults.setdefault(kind, []).append(text)


def study(numbers: Sequence[int], seed: int = 1) -> Results:
    """Return the results of the random mechanisms with these numbers."""
    result = Results()
    start = timer.process_time()
    for completed, result.number in enumerate(numbers):
        if completed and completed % REPORT_EVERY == 0:
            print(
                f"{completed} of {len(numbers)} after {timer.process_time() - start:.0f} s", file=sys.stderr
            )
        random = np.random.default_rng((seed, result.number))
        solver = random_mechanism(result.number, random)
        check_validation(solver, result)
        for profile in (
            within_range(solver.mechanism, solver.crank_range(), SPEED),
            random_swing(solver, random),
        ):
            for method in ("pose", "step"):
                check_run(solver, profile, method, method, result)
        for method, nearest in NEAREST.items():
            profile = swing_near_dead_centre(solver, random, nearest)
            if profile is not None:
                check_run(solver, profile, method, f"{method}, close", result)
        check_wrong_length(solver, random, result)
    return result


def check_validation(solver: KinematicSolver, result: Results) -> None:
    result.tried["validated"] += 1
    try:
        case = case_of(solver)
    except MechsimError as error:
        result.fault("validated", f"rejected: {error}; {solver}")
        return
    if not case.passed:
        result.fault("validated", f"{case.verdict.reason}; {solver}")


def check_run(
    solver: KinematicSolver, profile: CrankProfile, method: str, kind: str, result: Results
) -> None:
    result.tried[kind] += 1
    try:
        settings = Settings() if method == "step" else None
        run = simulate(solver.mechanism, profile=profile, method=method, settings=settings)
        verdict = crosscheck(run, solver)
    except MechsimError as error:
        result.fault(kind, f"rejected: {error}; {solver}")
        return
    if (run.outcome == "passed") != verdict.passed:
        result.fault(kind, f"run {run.outcome}, verdict {verdict.outcome}: {verdict.reason}; {solver}")


def check_wrong_length(solver: KinematicSolver, random: np.random.Generator, result: Results) -> None:
    """Check a mechanism with one length 0.1 % too long, with the tolerances of poses and of steps."""
    lengths = [
        name
        for name, (value, unit) in solver.dimensions.items()
        if unit == "m" and "." not in name and value != 0.0
    ]
    name = lengths[int(random.integers(len(lengths)))]
    wrong = solver.with_parameters(**{name: WRONG_SCALE * getattr(solver, name)})
    try:
        profile = within_range(solver.mechanism, solver.crank_range(), SPEED)
        run = simulate(wrong.mechanism, profile=profile, method="pose")
        exact = solver.solve(run.motion.angle)
        # a length without effect, as of an omitted guide, is skipped
        largest = max(
            float(gap.max()) for gap in wrong.solve(run.motion.angle).position_errors(exact).values()
        )
    except AssemblyError:
        return
    allowed = POSITION_TOLERANCE * stroke_of(exact)
    for kind, threshold, tolerance in (("pose", 1e-9 * allowed, None), ("step", 2.0 * allowed, allowed)):
        if largest > threshold:
            result.tried[f"0.1 % long, {kind}"] += 1
            if crosscheck(run.motion, solver, tolerance=tolerance).passed:
                result.fault(f"0.1 % long, {kind}", f"{name} passed, off by {largest:.2g} m; {solver}")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        description="Random mechanisms: runs and verdicts agree, none is rejected."
    )
    parser.add_argument("--count", type=int, default=800)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--part", type=int, nargs=2, metavar=("K", "N"), default=(0, 1), help="every Nth mechanism from K on"
    )
    parser.add_argument("--case", type=int, help="one mechanism")
    options = parser.parse_args(arguments)
    first, step = options.part
    numbers = range(first, options.count, step) if options.case is None else [options.case]
    result = study(numbers, options.seed)
    print(f"{'check':<18} {'count':>6} {'faults':>6}")
    for kind, count in result.tried.items():
        print(f"{kind:<18} {count:6} {len(result.faults.get(kind, [])):6}")
    return 1 if result.faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
