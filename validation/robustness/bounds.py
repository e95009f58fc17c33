"""Largest fraction of each tolerance of the verdict that random mechanisms use, method by method.

A fraction near 1 would soon be exceeded; one below a hundredth needs a reason. "step" uses the tolerances
of `validate`. "step, own error" sets the position tolerance to the run's own error, so that the other
fractions show errors relative to it: 0.7 of the joint tolerance of ten times is an error of seven times.
Dynamics is checked for every fourth mechanism, with a free run of one revolution if its crank rotates fully.

    python validation/robustness/bounds.py --count 200
"""

import argparse
import sys
import time as timer
from collections import defaultdict
from dataclasses import replace

import numpy as np
from random_catalog_mechanisms import SPEED, random_mechanism

from mechsim import dynamics, load_profile
from mechsim.compare.checks import Check, Verdict
from mechsim.compare.crosscheck import crosscheck
from mechsim.errors import MechsimError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics.initial_state import InitialValues
from mechsim.mechanism.forces import Forces, Friction, Load
from mechsim.mechanism.motion_laws import within_range
from mechsim.mechanism.motors import ConstantTorque
from mechsim.simulation import Settings, simulate
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_forward
from mechsim.studies.validate import case_of

# load on the last point in [N], friction of the crank in [N m s], motor torque in [N m]
LOAD, VISCOUS, MOTOR = (0.2, -0.1, 0.0), 1e-5, 1e-3
# dynamics is checked for every so many mechanisms
DYNAMICS_EVERY = 4
# steps a revolution of runs compared with their own error; flywheel of a free run in [kg m2]
COARSE_STEPS, FLYWHEEL = 400, 1e-3
# the run's own error is relative to solved poses, which differ from the closed form by rounding
ROUNDING_FACTOR = 1.001
# mechanisms between two progress lines
REPORT_EVERY = 21

Fractions = dict[tuple[str, str], list[tuple[float, str]]]


def tolerance_fractions(count: int, seed: int = 1) -> Fractions:
    """Return method and quantity -> the fraction of the tolerance that each mechanism used, and its name."""
    result: Fractions = defaultdict(list)
    start = timer.perf_counter()
    random = np.random.default_rng(seed)
    for number in range(count):
        solver = random_mechanism(number, random)
        if number and number % REPORT_EVERY == 0:
            print(f"{number} of {count} after {timer.perf_counter() - start:.0f} s", file=sys.stderr)
        checks: list[Check] = []
        for method_checks in (
            validation_checks,
            own_error_checks,
            *((prescribed_checks, free_run_checks) if number // 7 % DYNAMICS_EVERY == 0 else ()),
        ):
            try:
                checks += method_checks(solver)
            except MechsimError:
                continue
        worst: dict[tuple[str, str], float] = {}
        for check in checks:
            key = check.method, check.kind
            worst[key] = max(worst.get(key, 0.0), check.fraction_of_tolerance or 0.0)
        for key, fraction in worst.items():
            result[key].append((fraction, solver.name))
    return result


def validation_checks(solver: KinematicSolver) -> list[Check]:
    return list(case_of(solver).verdict.checks)


def own_error_checks(solver: KinematicSolver) -> list[Check]:
    profile = within_range(solver.mechanism, solver.crank_range(), SPEED)
    run = simulate(solver, profile=profile, settings=Settings(steps_per_turn=COARSE_STEPS))
    if run.outcome != "passed":
        return []
    verdict = crosscheck(run.motion, solver, tolerance=ROUNDING_FACTOR * run.estimate)
    return with_method(verdict, "step, own error")


def prescribed_checks(solver: KinematicSolver) -> list[Check]:
    model = dynamics.dynamic_model(solver, applied_forces(solver))
    profile = within_range(solver.mechanism, solver.crank_range(), SPEED)
    checks: list[Check] = []
    for method in ("pose", "step"):
        run = driven(model.mechanism, model.forces, profile=profile, method=method)
        checks += with_method(crosscheck_driven(run, model), f"{method}, dynamics")
    return checks


def applied_forces(solver: KinematicSolver) -> Forces:
    """Return gravity, viscous bearing friction and a load on the last point."""
    last = list(solver.mechanism.points)[-1]
    return Forces(
        gravity=(0.0, -9.81, 0.0),
        friction=(Friction(solver.mechanism.driver, viscous=VISCOUS),),
        loads=(Load(last, load_profile.constant(LOAD)),),
    )


def free_run_checks(solver: KinematicSolver) -> list[Check]:
    if not solver.crank_range().full:
        return []
    forces = replace(applied_forces(solver), flywheel=FLYWHEEL, motor=ConstantTorque(MOTOR))
    model = dynamics.dynamic_model(solver, forces)
    name = solver.mechanism.crank.name
    run = dynamics.run(model, initial={f"{name}.v": SPEED}, turns=1.0, samples=60)
    return with_method(crosscheck_forward(run, model, InitialValues({}, {name: SPEED})), "free")


def with_method(verdict: Verdict, method: str) -> list[Check]:
    return [replace(check, method=method) for check in verdict.checks]


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description="Fraction of each tolerance used by random mechanisms.")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    print(f"{'method':<15} {'quantity':<32} {'median':>8} {'worst':>8}  of its tolerance, by")
    for (method, kind), fractions in sorted(tolerance_fractions(options.count, options.seed).items()):
        largest, name = max(fractions)
        median = np.median([value for value, _ in fractions])
        print(f"{method:<15} {kind:<32} {median:8.1e} {largest:8.1e}  {name}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
