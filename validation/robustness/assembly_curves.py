"""Every assembly as closed curves: catalogue and gallery in a table, linkages that lie in line or nearly so.

    python validation/robustness/assembly_curves.py [--count 40] [--picture FILE.png]

Truths: the closed form of a mechanism of the catalogue, in all its assemblies, at every pose that is not
within 1e-3 of a singular one; for the gallery the rows of all joints, which share nothing with the tree in
whose coordinates curves are walked, and what couplings ask for at the turns that the curve counts. A pose
farther off than 1e-10 of the size is wrong. Random four-bars with change points must meet there and nowhere
else; near ones, which miss a change point by 1e-12 to 1e-3 of a length, must meet nowhere and keep the
sign of their assembly all the way.
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from change_points import NAMES, random_linkages

from mechsim import catalog, loops
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import MechsimError
from mechsim.numerics.angles import REVOLUTION
from mechsim.pictures import plots
from mechsim.report.assemblies import assembly_table, curve_tables
from mechsim.studies.extremes.special_designs import special_designs
from mechsim.subjects import gallery
from mechsim.subjects.readers import load
from mechsim.theory.continuation.assembly_curve import AssemblyCurve, CurvePoses
from mechsim.theory.continuation.mechanism_trace import trace

WRONG, CLEAR, SAMPLES = 1e-10, 1e-3, 24


@dataclass(frozen=True)
class Row:
    """What came of one mechanism."""

    name: str
    curves: int
    rarest: float
    turning: int
    branch_points: int
    worst: float
    seconds: float


def subjects() -> Iterator[tuple[str, KinematicSolver]]:
    """Yield the catalogue, as it stands, with cranks that swing, and laid flat; then the gallery's cranks."""
    for name, kind in catalog.DRIVES.items():
        own = catalog.make(name)
        for case, changed in {
            "": {},
            " swinging": special_designs(kind.name).swinging,
            **special_designs(kind.name).change_points,
        }.items():
            if changed or not case:
                yield f"{name} {case}".replace("  ", " ").strip(), replace(own, **changed)
    for name, path in gallery.files().items():
        form = load(str(path))
        if len(form.mechanism.drivers) == 1:
            yield name, form


def gap(drive: KinematicSolver, curve: AssemblyCurve) -> float:
    """Return how far the poses of a curve are from the truth, in parts of the size."""
    poses, size = curve.samples(SAMPLES + 1), drive.mechanism.characteristic_length
    # with several turns of a wheel on a crank's, poses alone do not tell what a coupling asks for
    gaps, turned = loops.residual_norms(replace(drive.mechanism, gears=(), couplings=()), poses.poses, None)
    worst = max(float(gaps.max()) / size, float(turned.max()), *off_laws(curve, poses))
    if isinstance(drive, ClosedForm):
        clear = loops.conditioning(drive.mechanism, poses.poses) > CLEAR
        for k in np.flatnonzero(clear):
            listed = drive.assembly_points(float(poses.angle[k]))
            apart = [
                max(float(np.linalg.norm(at - poses.points[name][k])) for name, at in points.items())
                for _, points in listed
            ]
            worst = max(worst, min(apart, default=np.inf) / size)
    return worst


def off_laws(curve: AssemblyCurve, poses: CurvePoses) -> list[float]:
    """Return how far the joints are from what each coupling asks for, in [rad] or parts of the size."""
    values = {column.coordinate: poses.joints[column.name] for column in curve.joints.columns}
    result = [0.0]
    for law in curve.mechanism.laws:
        left, right = (
            sum(weight * values[name] for name, weight in terms.items())
            for terms in (law.left_terms, law.right_terms)
        )
        off = left - law.zeros[0] - law.polynomial(np.asarray(right))[0]
        if law.turns:
            off = off - REVOLUTION * np.round(off / REVOLUTION)
        slides = any(curve.mechanism.unit(name) == "m" for name in law.left_terms)
        result.append(float(np.abs(off).max()) / (curve.mechanism.characteristic_length if slides else 1.0))
    return result


def row(name: str, drive: KinematicSolver) -> Row:
    """Return what comes of one mechanism."""
    start = time.process_time()
    result = trace(drive)
    turning = sum(len(curve.turning_points) for curve in result.curves)
    seconds = time.process_time() - start
    rarest = min(curve.starts_ended for curve in result.curves) / result.starts
    worst = max(gap(drive, curve) for curve in result.curves)
    return Row(name, len(result.curves), rarest, turning, len(result.branch_points), worst, seconds)


def flat(count: int, near: bool, seed: int = 11) -> tuple[int, list[str]]:
    """Return how many random linkages come out right, and what is wrong with the others."""
    wrong: list[str] = []
    for lengths in random_linkages(count, near, seed):
        drive = catalog.make("four_bar", **dict(zip(NAMES, lengths, strict=True)))
        try:
            result = trace(drive, starts=8)
        except MechsimError as error:
            wrong.append(f"{lengths}: {error}")
            continue
        known = 0 if near else len(drive.change_points())
        worst = max(gap(drive, curve) for curve in result.curves)
        signs = [np.sign(drive.assembly_sign(curve.samples(73).points)) for curve in result.curves]
        changed = near and any(len(set(sign)) > 1 for sign in signs)
        if len(result.branch_points) != known or not worst <= WRONG or changed or result.left_out:
            wrong.append(
                f"{lengths}: {len(result.branch_points)} of {known} branch points, {worst:.1e} off, {changed}"
            )
    return count - len(wrong), wrong


def main() -> int:
    """Print the table and the tallies."""
    words = argparse.ArgumentParser()
    words.add_argument("--count", type=int, default=40)
    words.add_argument("--picture")
    asked = words.parse_args()
    print("| mechanism | curves | rarest | turning points | branch points | off | cpu s |")
    print("|---|---|---|---|---|---|---|")
    missed = 0
    for name, drive in subjects():
        result = row(name, drive)
        missed += not result.worst <= WRONG
        print(
            f"| {name} | {result.curves} | {result.rarest:.0%} | {result.turning} | {result.branch_points} "
            f"| {result.worst:.0e} | {result.seconds:.1f} |",
            flush=True,
        )
    for near in (False, True):
        right, wrong = flat(asked.count, near)
        print(f"{'nearly flat' if near else 'flat'}: {right} of {asked.count} right", *wrong, sep="\n  ")
        missed += len(wrong)
    if asked.picture:
        draw(asked.picture)
    return int(missed > 0)


def draw(path: str) -> None:
    """Draw the curves of a parallelogram over the angles of crank and rocker."""
    result = trace(
        replace(catalog.make("four_bar"), **special_designs("four_bar").change_points["parallelogram"])
    )
    plots.write(
        path, plots.assembly_plot(assembly_table(result, curve_tables(result)), ("angle", "rocker.q"))
    )


if __name__ == "__main__":
    raise SystemExit(main())
