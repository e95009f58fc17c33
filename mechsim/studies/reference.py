"""Motions of a mechanism by each method, and their comparison with reference data of 30 digits."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from mechsim.analytic.dynamics import dynamic_model, prescribed
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError, InputError
from mechsim.model.force_record import ForceRecord
from mechsim.model.motion import Motion, PointMotion, select_instants
from mechsim.model.motion_laws import CrankProfile, constant, within_range
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array, rms
from mechsim.simulation import Run, simulate
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.scene.published_run import published_motion, runs_as_published
from mechsim.subjects.mjcf_source import MjcfForm
from mechsim.verdict.checks import Check, Verdict, check_of, checks_of, combined, concluded, tolerances_of
from mechsim.verdict.quantities import (
    MOTION,
    QUANTITIES,
    largest_acceleration,
    motion_scales,
    reach_of,
    stroke_of,
)
from mechsim.verdict.tolerances import Requested, Tolerance, instants_of

# largest number of samples of a picture or video
MAX_SAMPLES = 100_000


def profile_of(
    solver: KinematicSolver, speed: float, turns: float, through: float | None = None
) -> CrankProfile:
    """Return the crank's motion: whole revolutions, or one swing of a crank that cannot turn fully.

    The swing passes the angle `through`, by default that of the start. Under motion laws the motion is that
    of their path parameter.
    """
    if not solver.motion_laws.crank:
        return solver.motion_laws.path_profile
    if not (turns != 0.0 and abs(turns) < 1e4):
        raise InputError(f"{turns:g} turns; give turns other than 0, fewer than 10000 either way")
    return within_range(
        solver.mechanism, solver.crank_range(), speed if turns > 0 else -speed, abs(turns), through
    )


def simulated(solver: KinematicSolver, profile: CrankProfile, **options: Any) -> Run:
    """Return a run in MuJoCo under the motion laws of the drivers, or else under the crank motion."""
    return simulate(solver, **driven_as(solver, profile), **options)


def driven_as(solver: KinematicSolver, profile: CrankProfile) -> dict[str, Any]:
    """Return the driver motion of a run as arguments: motion laws of the drivers, or a crank motion."""
    return {"profile": profile} if solver.motion_laws.crank else {"motion_laws": solver.motion_laws}


def drawn_motion(solver: KinematicSolver, method: str, profile: CrankProfile, samples: float) -> Motion:
    """Return a motion to draw, with evenly spread samples after the first.

    Args:
        solver: the mechanism's solver.
        method: "closed", "simulated" (stepped by MuJoCo) or "posed" (solved by it pose by pose). A file that
            MuJoCo can run is stepped with its own settings, so that its drift is shown.
        profile: of the crank.
        samples: number of samples; rounded.
    """
    if method not in ("closed", "simulated", "posed"):
        raise InputError(f"there is no method {method!r}; choose from closed, simulated and, to draw, both")
    count = round(samples)
    if not 1 <= count <= MAX_SAMPLES:
        raise InputError(f"{samples:g} frames or samples requested; give 1 to {MAX_SAMPLES}")
    if method == "closed":
        return solver.solve_along(*profile.state(np.linspace(0.0, profile.duration, count + 1)))
    return (
        stepped(solver, profile, count)
        if method == "simulated"
        else simulated(solver, profile, samples=count, method="pose").motion
    )


def stepped(solver: KinematicSolver, profile: CrankProfile, samples: int) -> Motion:
    """Return a motion stepped by MuJoCo, of a file that MuJoCo can run with its own settings."""
    if runs_as_published(solver):
        assert isinstance(solver, MjcfForm)
        return published_motion(solver, profile, samples)
    return simulated(solver, profile, samples=samples, method="step").motion


def joint_loads(
    solver: KinematicSolver, method: str, profile: CrankProfile, motion: Motion
) -> dict[str, Any]:
    """Return forces and moments in the joints at the samples of a motion, by the same method as the motion.

    They act on link b of each joint, under the masses and forces of `dynamic_model`.
    """
    if method == "simulated":
        reactions = simulated_forces(solver, profile, len(motion) - 1).reactions
    else:
        instants = (motion.angle, motion.speed, motion.acceleration)
        study = prescribed(dynamic_model(solver), *instants, time=motion.time, as_run=motion)
        reactions = study.forces.reactions
    forces = {name: reaction.force for name, reaction in reactions.items()}
    # a moment smaller than the largest force times a billionth of the size is rounding and gets no arrow
    least = (
        1e-9
        * solver.mechanism.characteristic_length
        * max(float(np.abs(force).max()) for force in forces.values())
    )
    moments = {
        name: np.where(np.abs(reaction.moment) > least, reaction.moment, 0.0)
        for name, reaction in reactions.items()
    }
    return {"forces": forces, "moments": moments}


def simulated_forces(solver: KinematicSolver, profile: CrankProfile, samples: int) -> ForceRecord:
    """Return forces from MuJoCo along a motion, under the masses and forces of `dynamic_model`."""
    model = dynamic_model(solver.starting_at(profile.angles))
    return driven(model.mechanism, model.forces, samples=samples, **driven_as(solver, profile)).forces


COMPARED = tuple(row for row in MOTION if row.name in ("position", "velocity", "acceleration"))
# tolerance on drive forces, relative to the largest root mean square; measured 9e-13 over 33 mechanisms
RELATIVE_TOLERANCE = 1e-11


class ReferenceData(Protocol):
    """Reference data of a motion, such as `subjects.reference_data.ReferenceTable`."""

    @property
    def speed(self) -> float | None: ...

    @property
    def first(self) -> Array: ...

    @property
    def points(self) -> Mapping[str, PointMotion]: ...

    @property
    def drive_forces(self) -> Mapping[str, Array]: ...


def by_reference(
    solver: KinematicSolver, reference: ReferenceData, closed: KinematicSolver | None = None
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
    verdicts["loop equations"], verdicts["pose"] = (
        _by_equations(solver, reference),
        _by_poses(solver, reference),
    )
    return combined(verdicts)


def _solved(solver: KinematicSolver, reference: ReferenceData) -> Motion:
    if solver.motion_laws.crank:
        assert reference.speed is not None
        return solver.solve(reference.first, reference.speed)
    return solver.solve(t=reference.first)


def _by_equations(solver: KinematicSolver, reference: ReferenceData) -> Verdict:
    try:
        motion = _solved(solver, reference)
        study = prescribed_along(
            dynamic_model(solver), motion.angle, motion.speed, time=reference.first, as_run=None
        )
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    return _checked(motion, reference, "closed form", study.forces)


def _by_poses(solver: KinematicSolver, reference: ReferenceData) -> Verdict:
    try:
        acting, profile = dynamic_model(solver), _profile(solver, reference)
        samples = len(reference.first) - solver.motion_laws.crank
        motion = simulated(solver, profile, method="pose", samples=samples).motion
        run = driven(
            acting.mechanism,
            acting.forces,
            method="pose",
            samples=samples,
            **driven_as(solver, profile),
        )
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    if motion.broken:
        return Verdict("diverged", (), motion.broken)
    count = np.arange(len(motion)) < len(reference.first)
    return _checked(select_instants(motion, count), reference, "pose", run.forces)


def _profile(solver: KinematicSolver, reference: ReferenceData) -> CrankProfile:
    """Return the crank's steady motion over the reference data, or the path of the motion laws."""
    if not solver.motion_laws.crank:
        return solver.motion_laws.path_profile
    assert reference.speed is not None
    start, end = float(reference.first[0]), float(reference.first[-1])
    return constant(reference.speed, (end - start) / REVOLUTION, start)


def _checked(
    motion: Motion, reference: ReferenceData, method: str, forces: ForceRecord | None = None
) -> Verdict:
    """Return the verdict over a motion, and its forces, at the instants of the data."""
    exact = replace(motion, points=reference.points, links={}, joints={})
    speed, reach = float(np.abs(motion.speed).max()), max(reach_of(motion), reach_of(exact))
    scales = motion_scales(stroke_of(exact), speed, reach, largest_acceleration(motion, reach))
    # positions by formulas have the rounding of solved poses
    allowed = tolerances_of(COMPARED, "pose", scales, Requested()) | tolerances_of(
        COMPARED, method, scales, Requested()
    )
    checks = list(checks_of(COMPARED, motion, exact, allowed, motion.conditioning))
    if forces is not None:
        checks += _effort_checks(motion, reference, forces)
    return concluded(checks)


def _effort_checks(motion: Motion, reference: ReferenceData, forces: ForceRecord) -> Iterator[Check]:
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
