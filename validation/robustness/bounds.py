"""Every bound of the verdict beside the worst error measured over random mechanisms, road by road.

A part near 1 would be exceeded soon; one below a hundredth needs its reason.

    python validation/robustness/bounds.py --count 200
"""

import argparse
import sys
from collections import defaultdict
from dataclasses import replace

import numpy as np
from rough_drives import SPEED, rough_drives

from mechsim import dynamics
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import MechsimError
from mechsim.model.crank_profile import within_range
from mechsim.model.forces import Forces
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven
from mechsim.studies.validate import validate
from mechsim.verdict.checks import Check

WEIGHT = Forces(gravity=(0.0, -9.81, 0.0))
# of the mechanisms, every so many are put through dynamics too
EVERY = 4

Parts = dict[tuple[str, str], list[tuple[float, str]]]


def parts(count: int, seed: int = 1) -> Parts:
    """Return road and quantity -> the part of its bound that each mechanism used, and the mechanism."""
    found: Parts = defaultdict(list)
    for i, drive in enumerate(rough_drives(np.random.default_rng(seed), count)):
        try:
            checks = list(validate(drive).checks)
            if i // 7 % EVERY == 0:
                checks += _dynamics(drive)
        except MechsimError:
            continue
        worst: dict[tuple[str, str], float] = {}
        for check in checks:
            key = check.road, check.kind
            worst[key] = max(worst.get(key, 0.0), check.used or 0.0)
        for key, used in worst.items():
            found[key].append((used, drive.name))
    return found


def _dynamics(drive: ClosedForm) -> list[Check]:
    machine = dynamics.machine(drive, WEIGHT)
    profile = within_range(drive.mechanism, drive.crank_range(), SPEED)
    checks: list[Check] = []
    for method in ("pose", "step"):
        run = driven(machine.mechanism, machine.forces, profile=profile, method=method)
        verdict = crosscheck_driven(run, machine)
        checks += [_on_road(check, f"{method}, dynamics") for check in verdict.checks]
    return checks


def _on_road(check: Check, road: str) -> Check:
    return replace(check, road=road)


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Bounds beside the errors measured over random mechanisms.")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(arguments)
    print(f"{'road':<15} {'quantity':<32} {'median':>8} {'worst':>8}  of its bound, by")
    for (road, kind), used in sorted(parts(asked.count, asked.seed).items()):
        most, name = max(used)
        print(f"{road:<15} {kind:<32} {np.median([part for part, _ in used]):8.1e} {most:8.1e}  {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
