"""Both roads against reference data: places, rates and drive efforts known to 30 digits."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from mechsim.analytic.dynamics import Machine, machine
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.analytic.forms import Form
from mechsim.errors import AssemblyError
from mechsim.model.efforts import Efforts
from mechsim.model.motion import Motion, PointMotion, taken
from mechsim.model.motion_laws import CrankProfile
from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.motion_source import simulated
from mechsim.verdict.checks import Check, Verdict, check_of, checks_of, combined, concluded, tolerances_of
from mechsim.verdict.quantities import MOTION, QUANTITIES, motion_scales, reach_of, stroke_of
from mechsim.verdict.tolerances import Requested, Tolerance, instants_of

KNOWN = tuple(row for row in MOTION if row.name in ("position", "velocity", "acceleration"))
# of drive efforts, as a part of the largest root mean square; measured 9e-13 at the worst of 33 mechanisms
EFFORT = 1e-11


class Known(Protocol):
    """What reference data say of a motion; `subjects.reference_data.ReferenceTable` tells what is what."""

    @property
    def speed(self) -> float | None: ...

    @property
    def first(self) -> Array: ...

    @property
    def points(self) -> Mapping[str, PointMotion]: ...

    @property
    def efforts(self) -> Mapping[str, Array]: ...


def by_reference(form: Form, known: Known, closed: Form | None = None) -> Verdict:
    """Judge loop equations and MuJoCo's poses, and a closed form, by what is known.

    Args:
        form: the mechanism as the reference data describe it, with its masses and weight.
        known: the reference data.
        closed: the same mechanism with a closed form, whose motion is judged too.
    """
    roads: dict[str, Verdict] = {}
    if closed is not None:
        roads["closed form"] = _judged(_solved(closed, known), known, "closed form")
    roads["loop equations"], roads["pose"] = _by_equations(form, known), _by_poses(form, known)
    return combined(roads)


def _solved(form: Form, known: Known) -> Motion:
    motion_laws = form.motion_laws
    if motion_laws is None:
        assert known.speed is not None
        return form.solve(known.first, known.speed)
    return form.solve(t=known.first)


def _machine(form: Form) -> Machine:
    return machine(form, form.forces)


def _by_equations(form: Form, known: Known) -> Verdict:
    try:
        motion = _solved(form, known)
        study = prescribed_along(_machine(form), motion.angle, motion.speed, time=known.first, as_run=None)
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    return _judged(motion, known, "closed form", study.efforts)


def _by_poses(form: Form, known: Known) -> Verdict:
    try:
        acting, motion_laws, profile = _machine(form), form.motion_laws, _profile(form, known)
        samples = len(known.first) - (motion_laws is None)
        motion = simulated(form, profile, method="pose", samples=samples).motion
        run = driven(
            acting.mechanism,
            acting.forces,
            profile=None if motion_laws is not None else profile,
            motion_laws=motion_laws,
            method="pose",
            samples=samples,
        )
    except AssemblyError as error:
        return Verdict("cannot assemble", (), str(error))
    if motion.broken:
        return Verdict("diverged", (), motion.broken)
    count = np.arange(len(motion)) < len(known.first)
    return _judged(taken(motion, count), known, "pose", run.efforts)


def _profile(form: Form, known: Known) -> CrankProfile:
    """Return the crank's steady motion over what is known, or the clock of the programs."""
    motion_laws = form.motion_laws
    if motion_laws is not None:
        return motion_laws.clock
    assert known.speed is not None
    speed, start, end = known.speed, known.first[0], known.first[-1]

    def state(time: Array) -> tuple[Array, Array, Array]:
        return start + speed * time, np.full_like(time, speed), np.zeros_like(time)

    return CrankProfile((end - start) / speed, speed, state, steady=True)


def _judged(found: Motion, known: Known, road: str, efforts: Efforts | None = None) -> Verdict:
    """Return the verdict over a motion, and efforts, that stand where the data do."""
    exact = replace(found, points=known.points, links={}, joints={})
    speed, quickest = float(np.abs(found.speed).max()), _quickest(found)
    reach = max(reach_of(found), reach_of(exact))
    scales = motion_scales(stroke_of(exact), speed, reach, quickest)
    # places of formulas are rounded as solved poses are
    allowed = tolerances_of(KNOWN, "pose", scales, Requested()) | tolerances_of(
        KNOWN, road, scales, Requested()
    )
    checks = list(checks_of(KNOWN, found, exact, allowed, found.conditioning))
    if efforts is not None:
        checks += _effort_checks(found, known, efforts)
    return concluded(checks)


def _quickest(found: Motion) -> float:
    """Return the largest acceleration of a driver under programs, in [rad/s2] or by its largest place."""
    drivers = [found.joints[name] for name in found.drivers]
    sizes = [max(1e-300, float(np.abs(one.value).max())) if one.unit == "m" else 1.0 for one in drivers]
    most = [float(np.abs(one.acceleration).max()) / size for one, size in zip(drivers, sizes, strict=True)]
    return max(most, default=0.0)


def _effort_checks(found: Motion, known: Known, efforts: Efforts) -> Iterator[Check]:
    """Yield checks of drive efforts, each a part of the root mean square of the largest of its kind."""
    largest = max(float(np.sqrt(np.mean(one**2))) for one in known.efforts.values())
    for name, exact in known.efforts.items():
        kind = "driver effort" if efforts.drives else "drive torque"
        mine = efforts.drives[name] if efforts.drives else efforts.torque
        unit = "N" if name in efforts.straight else QUANTITIES[kind].unit
        why = f"{EFFORT:.0e} of {largest:.3g} {unit}, the largest root mean square; rounding, no integration"
        bound = Tolerance(EFFORT * largest, unit, why)
        yield check_of(
            kind, name, np.abs(mine[: len(exact)] - exact), instants_of(found), bound, found.conditioning
        )
