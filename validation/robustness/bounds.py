"""Every bound of the verdict next to the worst error measured over random mechanisms, method by method.

A part near 1 would be exceeded soon; one below a hundredth needs its reason. "step" is what `validate` asks
of a stepped run; "step, own error" asks of places no more than the run's own worst error, so that the other
quantities show what they need next to it: a part of 0.7 of the joints' bound of ten times is seven times.
Every fourth mechanism is put through dynamics too, and one whose crank turns fully runs freely for a turn.

    python validation/robustness/bounds.py --count 200
"""

import argparse
import sys
import time as clock
from collections import defaultdict
from dataclasses import replace

import numpy as np
from random_catalog_mechanisms import SPEED, random_catalog_mechanisms

from mechsim import dynamics, load_profile
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import MechsimError
from mechsim.model.forces import Forces, Friction, Load
from mechsim.model.motion_laws import within_range
from mechsim.model.motors import ConstantTorque
from mechsim.simulation import Settings, simulate
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_free
from mechsim.studies.validate import case_of
from mechsim.verdict.checks import Check, Verdict
from mechsim.verdict.crosscheck import crosscheck

# on the last point, in [N]; in the crank's bearing, in [N m s]; and of the motor, in [N m]
PULL, DRAG, MOTOR = (0.2, -0.1, 0.0), 1e-5, 1e-3
# of the mechanisms, every so many are put through dynamics too
EVERY = 4
# steps a turn where a run is judged by its own error; of a free run the flywheel in [kg m2], and the error of
# the crank angle that one is asked to keep, in [rad]
ROUGH, FLYWHEEL, ASKED = 400, 1e-3, 1e-5
FREELY = {"free": None, "free, asked": ASKED}
# the run's own error is that by solved poses: from the closed form it differs by rounding
ROUNDED = 1.001
# mechanisms between two lines that say how far it has come
TOLD = 21

Parts = dict[tuple[str, str], list[tuple[float, str]]]


def parts(count: int, seed: int = 1) -> Parts:
    """Return method and quantity -> the part of its bound that each mechanism used, and the mechanism."""
    result: Parts = defaultdict(list)
    begin = clock.perf_counter()
    for i, drive in enumerate(random_catalog_mechanisms(np.random.default_rng(seed), count)):
        if i and i % TOLD == 0:
            print(f"{i} of {count} after {clock.perf_counter() - begin:.0f} s", file=sys.stderr)
        checks: list[Check] = []
        for judged in (
            _validated,
            _by_own_error,
            *((prescribed_checks, _free) if i // 7 % EVERY == 0 else ()),
        ):
            try:
                checks += judged(drive)
            except MechsimError:
                continue
        worst: dict[tuple[str, str], float] = {}
        for check in checks:
            key = check.method, check.kind
            worst[key] = max(worst.get(key, 0.0), check.fraction_of_tolerance or 0.0)
        for key, used in worst.items():
            result[key].append((used, drive.name))
    return result


def _validated(drive: ClosedForm) -> list[Check]:
    return list(case_of(drive).verdict.checks)


def _by_own_error(drive: ClosedForm) -> list[Check]:
    profile = within_range(drive.mechanism, drive.crank_range(), SPEED)
    run = simulate(drive, profile=profile, settings=Settings(steps_per_turn=ROUGH))
    if run.outcome != "passed":
        return []
    verdict = crosscheck(run.motion, drive, tolerance=ROUNDED * run.estimate)
    return _by_method(verdict, "step, own error")


def prescribed_checks(drive: ClosedForm) -> list[Check]:
    machine = dynamics.dynamic_model(drive, _forces(drive))
    profile = within_range(drive.mechanism, drive.crank_range(), SPEED)
    checks: list[Check] = []
    for method in ("pose", "step"):
        run = driven(machine.mechanism, machine.forces, profile=profile, method=method)
        checks += _by_method(crosscheck_driven(run, machine), f"{method}, dynamics")
    return checks


def _forces(drive: ClosedForm) -> Forces:
    """Return weights, a bearing that drags, and a pull on the last point."""
    last = list(drive.mechanism.points)[-1]
    return Forces(
        gravity=(0.0, -9.81, 0.0),
        friction=(Friction(drive.mechanism.driver, viscous=DRAG),),
        loads=(Load(last, load_profile.constant(PULL)),),
    )


def _free(drive: ClosedForm) -> list[Check]:
    if not drive.crank_range().full:
        return []
    forces = replace(_forces(drive), flywheel=FLYWHEEL, motor=ConstantTorque(MOTOR))
    machine = dynamics.dynamic_model(drive, forces)
    checks: list[Check] = []
    for method, tolerance in FREELY.items():
        run = dynamics.free_run(machine, speed=SPEED, turns=1.0, samples=61)
        checks += _by_method(crosscheck_free(run, machine, tolerance=tolerance), method)
    return checks


def _by_method(verdict: Verdict, method: str) -> list[Check]:
    return [replace(check, method=method) for check in verdict.checks]


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Bounds beside the errors measured over random mechanisms.")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args(arguments)
    print(f"{'method':<15} {'quantity':<32} {'median':>8} {'worst':>8}  of its bound, by")
    for (method, kind), used in sorted(parts(asked.count, asked.seed).items()):
        most, name = max(used)
        print(f"{method:<15} {kind:<32} {np.median([part for part, _ in used]):8.1e} {most:8.1e}  {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
