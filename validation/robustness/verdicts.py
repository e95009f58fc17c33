"""Random catalogue mechanisms by every method: none rejected, no sound one missed, runs and verdicts agree.

Each is validated, then put through a swing anywhere inside its range, on any lap, by poses and by steps, and
through one that ends close to a dead centre; every run's own outcome is held against its verdict. And each is
shown to the check with a link 0.1 % long.

    python validation/robustness/verdicts.py [--count 800] [--seed 1] [--part K N] [--case NUMBER]

Each is drawn by its own number, so that `--part K N` runs every Nth and `--case` one alone.
"""

import argparse
import sys
import time as clock
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from random_catalog_mechanisms import SPEED, close_swing, rough_drive, rough_swing

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import AssemblyError, MechsimError
from mechsim.model.finding import POSITION_TOLERANCE
from mechsim.model.motion_laws import CrankProfile, within_range
from mechsim.simulation import Settings, simulate
from mechsim.studies.validate import case_of
from mechsim.verdict.crosscheck import crosscheck
from mechsim.verdict.quantities import stroke_of

# a link this many times as long is wrong
LONG = 1.001
# how near to a dead centre a swing may end, in [rad]
CLOSE = {"pose": 1e-5, "step": 1e-4}
# mechanisms between two lines that say how far the study has come
EVERY = 25


@dataclass
class Found:
    """What came out: how often each thing was tried, and every fault in a line."""

    tried: Counter[str] = field(default_factory=Counter)
    faults: dict[str, list[str]] = field(default_factory=dict)
    number: int = 0

    def fault(self, kind: str, text: str) -> None:
        print(f"FAULT {self.number} {kind}: {text}", flush=True)
        self.faults.setdefault(kind, []).append(text)


def study(numbers: Sequence[int], seed: int = 1) -> Found:
    """Return what came of the random mechanisms of these numbers."""
    result = Found()
    begin = clock.process_time()
    for done, result.number in enumerate(numbers):
        if done and done % EVERY == 0:
            print(f"{done} of {len(numbers)} after {clock.process_time() - begin:.0f} s", file=sys.stderr)
        random = np.random.default_rng((seed, result.number))
        drive = rough_drive(result.number, random)
        _validated(drive, result)
        for profile in (
            within_range(drive.mechanism, drive.crank_range(), SPEED),
            rough_swing(drive, random),
        ):
            for method in ("pose", "step"):
                _run(drive, profile, method, method, result)
        for method, nearest in CLOSE.items():
            profile = close_swing(drive, random, nearest)
            if profile is not None:
                _run(drive, profile, method, f"{method}, close", result)
        _long(drive, random, result)
    return result


def _validated(drive: ClosedForm, result: Found) -> None:
    result.tried["validated"] += 1
    try:
        case = case_of(drive)
    except MechsimError as error:
        result.fault("validated", f"refused: {error}; {drive}")
        return
    if not case.passed:
        result.fault("validated", f"{case.verdict.reason}; {drive}")


def _run(drive: ClosedForm, profile: CrankProfile, method: str, kind: str, result: Found) -> None:
    result.tried[kind] += 1
    try:
        settings = Settings() if method == "step" else None
        run = simulate(drive.mechanism, profile=profile, method=method, settings=settings)
        verdict = crosscheck(run, drive)
    except MechsimError as error:
        result.fault(kind, f"refused: {error}; {drive}")
        return
    if (run.outcome == "passed") != verdict.passed:
        result.fault(kind, f"run {run.outcome}, verdict {verdict.outcome}: {verdict.reason}; {drive}")


def _long(drive: ClosedForm, random: np.random.Generator, result: Found) -> None:
    """Show the check a mechanism with one length a thousandth too long, by poses and as if stepped."""
    lengths = [
        item.name
        for item in fields(drive)
        if item.metadata["unit"] == "m"
        and isinstance(item.default, float)
        and getattr(drive, item.name) != 0.0
    ]
    name = lengths[int(random.integers(len(lengths)))]
    wrong = replace(drive, **{name: LONG * getattr(drive, name)})
    try:
        profile = within_range(drive.mechanism, drive.crank_range(), SPEED)
        run = simulate(wrong.mechanism, profile=profile, method="pose")
        exact = drive.solve(run.motion.angle)
        # a length that nothing depends on, as of a guide left out, is no mistake
        moved = max(float(gap.max()) for gap in wrong.solve(run.motion.angle).position_errors(exact).values())
    except AssemblyError:
        return
    place = POSITION_TOLERANCE * stroke_of(exact)
    for kind, least, tolerance in (("pose", 1e-9 * place, None), ("step", 2.0 * place, place)):
        if moved > least:
            result.tried[f"0.1 % long, {kind}"] += 1
            if crosscheck(run.motion, drive, tolerance=tolerance).passed:
                result.fault(f"0.1 % long, {kind}", f"{name} passed, off by {moved:.2g} m; {drive}")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Random mechanisms: runs and verdicts agree, none refused.")
    parser.add_argument("--count", type=int, default=800)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--part", type=int, nargs=2, metavar=("K", "N"), default=(0, 1), help="each Nth from K on"
    )
    parser.add_argument("--case", type=int, help="one of them")
    asked = parser.parse_args(arguments)
    first, step = asked.part
    numbers = range(first, asked.count, step) if asked.case is None else [asked.case]
    result = study(numbers, asked.seed)
    print(f"{'tried':<18} {'times':>6} {'faults':>6}")
    for kind, times in result.tried.items():
        print(f"{kind:<18} {times:6} {len(result.faults.get(kind, [])):6}")
    return 1 if result.faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
