"""Trace every assembly as closed curves: catalogue, gallery, and linkages with change points or nearly so.

    python validation/robustness/assembly_curves.py [--count 40]

References: for the catalogue the closed form of every assembly, at poses farther than 1e-3 from a singular
one. For the gallery the constraint equations of all joints, which are independent of the spanning tree that
the tracer uses, and the coupling equations at the multi-turn values of the curve. A pose is wrong if it
deviates by more than 1e-10 of the characteristic length. Random four-bars with change points must have
branch points there and nowhere else. Four-bars that miss a change point by 1e-12 to 1e-3 of a length must
have none and keep the sign of their assembly along the curve.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from change_points import NAMES, random_linkages

from mechsim import catalog, loops
from mechsim.errors import MechsimError
from mechsim.io import gallery
from mechsim.io.readers import load
from mechsim.kinematics.continuation.assembly_curve import AssemblyCurve, CurvePoses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics.arrays import REVOLUTION
from mechsim.studies.trace import trace

# relative to the characteristic length; conditioning below which a pose is singular; samples of a curve
ERROR_LIMIT, MIN_CONDITIONING, SAMPLES = 1e-10, 1e-3, 24


@dataclass(frozen=True)
class Row:
    """Results of one mechanism."""

    name: str
    curves: int
    rarest: float
    turning_points: int
    branch_points: int
    error: float
    seconds: float


# parameters for which the crank only swings
SWINGING = {
    "four_bar": {"rocker": 0.035},
    "slider_crank": {"rod": 0.045},
    "rssr": {"rocker": 0.009},
    "rrsrr": {"link": 0.055},
}
# four-bars with change points
COLLINEAR = {
    "parallelogram": {"ground": 0.1, "coupler": 0.1, "crank": 0.04, "rocker": 0.04},
    "kite": {"ground": 0.1, "rocker": 0.1, "crank": 0.04, "coupler": 0.04},
}


def solvers() -> Iterator[tuple[str, KinematicSolver]]:
    """Yield catalogue mechanisms (default, swinging, collinear), then gallery mechanisms of one driver."""
    for name in catalog.MECHANISMS:
        default = catalog.make(name)
        for design_name, parameters in {
            "": {},
            " swinging": SWINGING.get(name, {}),
            **(COLLINEAR if name == "four_bar" else {}),
        }.items():
            if parameters or not design_name:
                yield (
                    f"{name} {design_name}".replace("  ", " ").strip(),
                    default.with_parameters(**parameters),
                )
    for name, path in gallery.files().items():
        user_solver = load(str(path))
        if len(user_solver.mechanism.drivers) == 1:
            yield name, user_solver


def curve_error(solver: KinematicSolver, curve: AssemblyCurve) -> float:
    """Return the largest error of the poses of a curve relative to the characteristic length."""
    poses, length = curve.samples(SAMPLES + 1), solver.mechanism.characteristic_length
    # poses do not determine the revolutions of a gear, so couplings are checked on joint values
    lengths, angles = loops.residual_norms(
        replace(solver.mechanism, gears=(), couplings=()), poses.poses, None
    )
    largest = max(float(lengths.max()) / length, float(angles.max()), *coupling_errors(curve, poses))
    if solver.closed_form is not None:
        regular = loops.conditioning(solver.mechanism, poses.poses) > MIN_CONDITIONING
        for k in np.flatnonzero(regular):
            assemblies = solver.assembly_points(float(poses.angle[k]))
            errors = [
                max(float(np.linalg.norm(p - poses.points[point][k])) for point, p in points.items())
                for _, points in assemblies
            ]
            largest = max(largest, min(errors, default=np.inf) / length)
    return largest


def coupling_errors(curve: AssemblyCurve, poses: CurvePoses) -> list[float]:
    """Return the residual of each coupling, in [rad] or relative to the characteristic length."""
    values = {column.coordinate: poses.joints[column.name] for column in curve.joints.columns}
    result = [0.0]
    for law in curve.mechanism.laws:
        left, right = (
            sum(weight * values[name] for name, weight in terms.items())
            for terms in (law.left_terms, law.right_terms)
        )
        residual = left - law.zeros[0] - law.polynomial(np.asarray(right))[0]
        if law.turns:
            residual = residual - REVOLUTION * np.round(residual / REVOLUTION)
        is_length = any(curve.mechanism.unit(name) == "m" for name in law.left_terms)
        result.append(
            float(np.abs(residual).max()) / (curve.mechanism.characteristic_length if is_length else 1.0)
        )
    return result


def trace_row(name: str, solver: KinematicSolver) -> Row:
    """Return the results of one mechanism."""
    start = time.process_time()
    result = trace(solver)
    turning_points = sum(len(curve.turning_points) for curve in result.curves)
    seconds = time.process_time() - start
    rarest = min(curve.starts_ended for curve in result.curves) / result.starts
    error = max(curve_error(solver, curve) for curve in result.curves)
    return Row(name, len(result.curves), rarest, turning_points, len(result.branch_points), error, seconds)


def check_change_points(count: int, close: bool, seed: int = 11) -> tuple[int, list[str]]:
    """Return how many random linkages are traced correctly, and a message for each other one."""
    failures: list[str] = []
    for lengths in random_linkages(count, close, seed):
        solver = catalog.make("four_bar", **dict(zip(NAMES, lengths, strict=True)))
        try:
            result = trace(solver, starts=8)
        except MechsimError as error:
            failures.append(f"{lengths}: {error}")
            continue
        expected = 0 if close else len(solver.change_points())
        largest = max(curve_error(solver, curve) for curve in result.curves)
        signs = [np.sign(solver.assembly_sign(curve.samples(73).points)) for curve in result.curves]
        sign_changed = close and any(len(set(sign)) > 1 for sign in signs)
        if (
            len(result.branch_points) != expected
            or not largest <= ERROR_LIMIT
            or sign_changed
            or result.left_out
        ):
            failures.append(
                f"{lengths}: {len(result.branch_points)} of {expected} branch points, "
                f"error {largest:.1e}{', sign changed' * sign_changed}"
            )
    return count - len(failures), failures


def main() -> int:
    """Print the table and the counts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=40)
    options = parser.parse_args()
    print("| mechanism | curves | rarest start | turning points | branch points | error | CPU s |")
    print("|---|---|---|---|---|---|---|")
    failures = 0
    for name, solver in solvers():
        result = trace_row(name, solver)
        failures += not result.error <= ERROR_LIMIT
        print(
            f"| {name} | {result.curves} | {result.rarest:.0%} | {result.turning_points} "
            f"| {result.branch_points} | {result.error:.0e} | {result.seconds:.1f} |",
            flush=True,
        )
    for close in (False, True):
        correct, messages = check_change_points(options.count, close)
        label = "near change point" if close else "change point"
        print(f"{label}: {correct} of {options.count} correct", *messages, sep="\n  ")
        failures += len(messages)
    return int(failures > 0)


if __name__ == "__main__":
    raise SystemExit(main())
