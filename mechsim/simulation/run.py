"""One call from a mechanism or a model to its motion in MuJoCo, with an outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.limits import MAX_STEPS, require_steps
from mechsim.mechanism.mechanism import Mechanism, starting_at
from mechsim.mechanism.motion_laws import CRANK, CrankProfile, MotionLaws, constant
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import REVOLUTION, number, require, units_remedy
from mechsim.numerics.resources import ProcessorBudget, Progress, no_progress
from mechsim.simulation.custom_model import at_initial_state, parameter_profile
from mechsim.simulation.driven_run import DrivenRun, check_records, first_state, solved_run
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mobility import (
    require_determined,
    require_movable,
    require_path_within_limits,
    require_within_limits,
    residual_mobility,
)
from mechsim.simulation.position_tolerance import run_within
from mechsim.simulation.result import Method, Run
from mechsim.simulation.settings import Settings
from mechsim.simulation.source import Source, from_source
from mechsim.simulation.stepping import require_steps_resolve
from mechsim.units import si

# argument of `simulate` -> its type
KINDS = {"scene": Scene, "settings": Settings, "profile": CrankProfile, "motion_laws": MotionLaws}
# fraction of a step by which a duration may differ from a multiple of the step
WHOLE_STEP_TOLERANCE = 1e-6


def with_timestep(run: DrivenRun, settings: Settings, timestep: float) -> tuple[DrivenRun, Settings]:
    """Return a run of whole steps of a given length, and the settings of such a run.

    The run ends with the last whole step within its duration.

    Args:
        run: the motion to be stepped.
        settings: how to step; their number of steps is replaced.
        timestep: in [s].

    Raises:
        InputError: for a step that is too long or too short for the motion, or that does not fit the records.
    """
    profile, period = run.profile, REVOLUTION / run.profile.max_speed
    longest, shortest = period / 4.0, period / MAX_STEPS
    if not shortest <= timestep <= longest:
        limit = f"{longest:.3g} s at the most" if timestep > longest else f"{shortest:.3g} s at the least"
        cycle = "a turn of the crank" if run.closed.loops.drivers.crank else "a cycle of the motion laws"
        raise InputError(f"time step is {timestep:g} s, but {cycle} takes {period:.6g} s; take {limit}")
    total = int(np.floor(profile.duration / timestep + WHOLE_STEP_TOLERANCE))
    require_steps(
        f"a motion of {profile.duration:g} s in steps of {timestep:g} s", total, "take longer steps"
    )
    if total < profile.min_instants:
        most = profile.duration / profile.min_instants
        raise InputError(
            f"time step is {timestep:g} s, but the motion lasts {profile.duration:.6g} s and needs "
            f"{profile.min_instants} steps at least; take {most:.3g} s at the most"
        )
    if run.samples is not None and total % run.samples:
        # the divisors of the number of steps, in ascending order
        low = np.arange(1, int(np.sqrt(total)) + 1)
        low = low[total % low == 0]
        fitting = np.unique(np.concatenate([low, total // low]))
        below, above = fitting <= run.samples, fitting >= min(run.samples, total)
        counts = sorted({fitting[below].max(), fitting[above].min()})
        intervals, rows = (" or ".join(str(count + more) for count in counts) for more in (0, 1))
        raise InputError(
            f"{run.samples} equal intervals between records do not fit {total} steps of {timestep:g} s; take "
            f"{intervals} intervals (--samples {rows}), or leave the time step out"
        )
    end = total * timestep
    note = ""
    if profile.duration - end > WHOLE_STEP_TOLERANCE * timestep:
        note = f"the run ends at {end:.9g} s, with the last whole step within {profile.duration:.9g} s"
    fixed = replace(run, profile=replace(profile, duration=end), total=total, ending=note)
    return fixed, replace(settings, steps_per_turn=int(np.ceil(period / timestep - 1e-9)))


@quiet()
def simulate(
    source: Source,
    *,
    speed: float | str | None = None,
    turns: float = 1.0,
    profile: CrankProfile | None = None,
    tolerance: float | str | None = None,
    settings: Settings | None = None,
    timestep: float | str | None = None,
    method: Method | None = None,
    samples: int | None = None,
    scene: Scene | None = None,
    motion_laws: MotionLaws | None = None,
    drive: str | None = None,
    lock: Mapping[str, float | None] | None = None,
    key: str | None = None,
    progress: Progress | None = None,
    budget: ProcessorBudget | None = None,
) -> Run:
    """Run a mechanism, or a custom model, in MuJoCo under a driven crank or motion laws of its drivers.

    Args:
        source: a Mechanism, or an object that has one, such as those of the catalogue; or a specification, an
            MJCF file or text whose sites are the tracked points. `mechsim.simulate` also takes a name of the
            catalogue or the gallery, FILE.toml and FILE.py:OBJECT.
        speed: constant crank speed in [rad/s], negative backwards, or text, as "600rpm"; or give `profile`.
        turns: of the crank, at constant speed.
        profile: the crank's angle over time.
        tolerance: position tolerance of all tracked points, in [m] or text, as "10um"; the number of steps
            is then chosen by trials and the result checked against it. None takes the settings' steps, and a
            ten-thousandth of the stroke as the tolerance.
        settings: of the stepping. A tolerance replaces their number of steps, and their compliance too if no
            number of steps suffices, unless the compliance is set.
        timestep: in [s] or text, as "2ms"; kept exactly: the run ends with the last whole step within its
            duration. It replaces the number of steps of the settings.
        method: "step" integrates in time; "pose" solves each crank angle separately, to rounding. None takes
            "step" with a tolerance or settings, or if the drivers do not determine the tracked points;
            otherwise "pose". The run reports it.
        samples: instants to record after the first, evenly spaced; None takes about 72 a turn. With
            samples given, the number of steps is raised to a multiple of them.
        scene: contents of the model; None takes `Scene(level="motion")`, in which no forces act. From level
            "dynamics" on, the source's forces act, as a file's `[forces]`, unless the scene names others.
        motion_laws: motion laws of the drivers, in place of speed or profile; None takes those of the source.
            The drivers first move along a straight path from the model's reference to the start of the laws.
            In a custom model the joints of these names are driven.
        drive: the hinge that is the crank of a custom model; None for the joint named "crank".
        lock: joint of a custom model -> value at which it is locked, in [m] or [rad]; None for its initial
            value, the only choice for a ball or a free joint.
        key: initial keyframe of a custom model.
        progress: callback with the progress of the run as text and as a fraction, 0 to 1.
        budget: processor time of the stepped runs for a tolerance. Once it is spent, the best run so far is
            returned, and its note states that it did not converge. None sets no limit.

    Raises:
        BudgetError: if not even one run ends within the budget.
        InputError: for invalid values, and for a stepped motion that must stay on the branch.
        AssemblyError: if the loops close nowhere or only over a fraction of the crank motion, or a joint
            would leave its range.
        MobilityError: if the drivers do not determine the requested poses, or cannot move.
    """
    speed, tolerance = si(speed, "rad/s", "the crank speed"), si(tolerance, "m", "the tolerance")
    timestep = si(timestep, "s", "the time step")
    _check(tolerance, method, samples, timestep)
    options = {"scene": scene, "settings": settings, "profile": profile, "motion_laws": motion_laws}
    for name, option in options.items():
        if option is not None:
            require(name, option, KINDS[name])
    motion_laws = laws_of(source, motion_laws, speed if profile is None else profile)
    if profile is not None:
        source = starting_at(source, profile.angles)
    drivers = drive if motion_laws.crank else motion_laws.drivers
    scene = scene or Scene(level="pose" if method == "pose" else "motion")
    closed = from_source(source, scene, drivers=drivers, lock=lock, key=key)
    profile = profile or requested_profile(motion_laws, speed, turns, closed.angle)
    samples = None if samples is None else int(samples)
    check_records(closed, profile, samples)
    if method is None and (tolerance is not None or settings is not None or timestep is not None):
        method = "step"
    mobility = residual_mobility(closed)
    # a model with undetermined degrees of freedom is stepped
    method = method or ("step" if mobility.undetermined else "pose")
    require_movable(closed, mobility)
    if method == "pose":
        require_determined(closed, mobility)
    else:
        closed = closed.without_contacts(mobility.determined_bodies)
    closed = at_initial_state(closed, motion_laws)
    if method == "pose":
        return solved_run(closed, profile, samples, tolerance, progress or no_progress)
    require_steps_resolve(motion_laws)
    start = first_state(closed, profile)
    require_within_limits(closed, start[0][None])
    if not mobility.undetermined:
        require_path_within_limits(closed, profile.angles)
    run = DrivenRun(closed, profile, start, samples, progress or no_progress, budget=budget)
    run.require_decided()
    settings = settings or Settings()
    if timestep is not None:
        run, settings = with_timestep(run, settings, timestep)
    return run.stepped(settings) if tolerance is None else run_within(run, settings, tolerance)


def requested_profile(
    motion_laws: MotionLaws, speed: float | None, turns: float, start: float
) -> CrankProfile:
    """Return the profile of the path parameter under motion laws, or of a crank at constant speed."""
    if not motion_laws.crank:
        return parameter_profile(motion_laws)
    if speed is None:
        raise InputError("neither a crank speed nor a profile was given; give one")
    return constant(speed, turns, start)


def _check(
    tolerance: float | None, method: Method | None, samples: int | None, timestep: float | None
) -> None:
    """Reject invalid values."""
    if timestep is not None and not 0.0 < number(timestep) < np.inf:
        raise InputError(f"time step is {timestep} s; give a finite time above 0")
    if timestep is not None and (tolerance is not None or method == "pose"):
        chosen = "a tolerance chooses the step by itself"
        other = "method 'pose' takes no steps" if tolerance is None else chosen
        raise InputError(f"time step is {timestep:g} s, but {other}; leave one out")
    if tolerance is not None and not 0.0 < number(tolerance) < np.inf:
        remedy = units_remedy(tolerance, "units.parse_length('1 um')")
        raise InputError(f"tolerance is {tolerance} m; give a finite length above 0{remedy}")
    if method not in (None, "step", "pose"):
        raise InputError(f"there is no method {method!r}; choose from step, pose")
    if samples is not None and not (number(samples) >= 1 and number(samples) % 1 == 0):
        raise InputError(f"{samples} samples requested; take a whole number, at least 1")


def laws_of(source: object, motion_laws: MotionLaws | None, crank_motion: object) -> MotionLaws:
    """Return the requested motion laws; without them, and without a crank motion, those of the source.

    Raises:
        InputError: if they do not fit the mechanism's drivers, or a crank motion is given as well.
    """
    if motion_laws is None and crank_motion is None:
        motion_laws = getattr(source, "motion_laws", None)
    laws = motion_laws if isinstance(motion_laws, MotionLaws) else CRANK
    if not laws.crank and crank_motion is not None:
        raise InputError("both motion laws and a crank's motion were given; give only one")
    model = getattr(source, "mechanism", source)
    if isinstance(model, Mechanism):
        laws.require_drivers(model)
    return laws
