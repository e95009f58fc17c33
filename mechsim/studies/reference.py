"""Comparison of a mechanism with reference data of 30 digits, by each method."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from mechsim.compare.checks import Check, Verdict, check_of, checks_of, combined, concluded, tolerances_of
from mechsim.compare.quantities import (
    MOTION,
    QUANTITIES,
    largest_acceleration,
    motion_scales,
    reach_of,
    stroke_of,
)
from mechsim.compare.tolerances import Requested, Tolerance, instants_of
from mechsim.errors import AssemblyError
from mechsim.io.reference_data import ReferenceTable
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.prescribed_motion import prescribed_along
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.motion import Motion, select_instants
from mechsim.mechanism.motion_laws import CrankProfile, constant
from mechsim.numerics.arrays import REVOLUTION, rms
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.motions import driven_as, simulated

COMPARED = tuple(row for row in MOTION if row.name in ("position", "velocity", "acceleration"))
# tolerance on drive forces, relative to the largest root mean square; measured 9e-13 over 33 mechanisms
RELATIVE_TOLERANCE = 1e-11


def by_reference(
    solver: KinematicSolver, reference: ReferenceTable, closed: KinematicSolver | None = None
) -> Verdict:
    """Compare loop equations, MuJoCo's poses and a closed form with reference data.

    Args:
        solver: the mechanism of the reference data, with its masses and weight.
        reference: the reference data.
        closed: the same mechanism with a closed form; its motion is compared too.
    """
    verdicts: dict[str, Verdict] = {}
    if closed is not None:
        verdicts["closed form"] = _checked(_solved(closed, reference), reference, "closed form")
    verdicts["loop equations"] = _by_equations(solver, reference)
    verdicts["pose"] = _by_poses(solver, reference)
    return combined(verdicts)


def _solved(solver: KinematicSolver, reference: ReferenceTable) -> Motion:
    if solver.motion_laws.crank:
        assert reference.speed is not None
        return solver.solve(reference.first, reference.speed)
    return solver.solve(t=reference.first)


def _by_equations(solver: KinematicSolver, reference: ReferenceTable) -> Verdict:
    try:
        motion = _solved(solver, reference)
        study = prescribed_along(
            dynamic_model(solver), motion.angle, motion.speed, time=reference.first, as_run=None
        )
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    return _checked(motion, reference, "closed form", study.forces)


def _by_poses(solver: KinematicSolver, reference: ReferenceTable) -> Verdict:
    try:
        acting, profile = dynamic_model(solver), _profile(solver, reference)
        samples = len(reference.first) - solver.motion_laws.crank
        options: dict[str, Any] = {"method": "pose", "samples": samples}
        motion = simulated(solver, profile, **options).motion
        run = driven(acting.mechanism, acting.forces, **driven_as(solver, profile), **options)
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    if motion.broken:
        return Verdict("diverged", (), motion.broken)
    count = np.arange(len(motion)) < len(reference.first)
    return _checked(select_instants(motion, count), reference, "pose", run.forces)


def _profile(solver: KinematicSolver, reference: ReferenceTable) -> CrankProfile:
    """Return the crank's steady motion over the reference data, or the path of the motion laws."""
    if not solver.motion_laws.crank:
        return solver.motion_laws.path_profile
    assert reference.speed is not None
    start, end = float(reference.first[0]), float(reference.first[-1])
    return constant(reference.speed, (end - start) / REVOLUTION, start)


def _checked(
    motion: Motion, reference: ReferenceTable, method: str, forces: ForceRecord | None = None
) -> Verdict:
    """Return the verdict over a motion, and its forces, at the instants of the data."""
    exact = replace(motion, points=reference.points, links={}, joints={})
    speed, reach = float(np.abs(motion.speed).max()), max(reach_of(motion), reach_of(exact))
    scales = motion_scales(stroke_of(exact), speed, reach, largest_acceleration(motion, reach))
    # positions by formulas have the rounding of solved poses
    allowed = tolerances_of(COMPARED, "pose", scales, Requested())
    allowed |= tolerances_of(COMPARED, method, scales, Requested())
    checks = list(checks_of(COMPARED, motion, exact, allowed, motion.conditioning))
    if forces is not None:
        checks += _effort_checks(motion, reference, forces)
    return concluded(checks)


def _effort_checks(motion: Motion, reference: ReferenceTable, forces: ForceRecord) -> Iterator[Check]:
    """Yield checks of drive forces, relative to the largest root mean square."""
    largest = max(rms(values) for values in reference.drive_forces.values())
    for name, exact in reference.drive_forces.items():
        kind = "driver effort" if forces.drives else "drive torque"
        mine = forces.drives[name] if forces.drives else forces.torque
        unit = "N" if name in forces.straight else QUANTITIES[kind].unit
        scale = f"{largest:.3g} {unit}, the largest root mean square"
        reason = f"{RELATIVE_TOLERANCE:.0e} of {scale}; rounding, no integration"
        tolerance = Tolerance(RELATIVE_TOLERANCE * largest, unit, reason)
        error = np.abs(mine[: len(exact)] - exact)
        yield check_of(kind, name, error, instants_of(motion), tolerance, motion.conditioning)
