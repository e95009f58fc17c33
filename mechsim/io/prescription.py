"""Prescription of a motion: drivers and their motion laws, locked coordinates, tracked points."""

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from mechsim import units
from mechsim.errors import InputError, MechsimError
from mechsim.io.model_source import ModelDescription, ModelSource, Prescription
from mechsim.io.toml_coordinates import FileMotionLaw
from mechsim.io.toml_values import suggestion
from mechsim.kinematics.loops.start import closed_start, start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.joint_kinds import FIXED, KINDS, REVOLUTE
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.link_poses import spin_rod
from mechsim.mechanism.links import GROUND, IDENTITY, ORIGIN, Pose, Vector, vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import CRANK, MotionLaws, State, make_motion_laws, steady
from mechsim.numerics.arrays import REVOLUTION, number
from mechsim.units import WrittenUnits

if TYPE_CHECKING:
    from mechsim.io.model_source import LockedAt

# duration of motion laws in [s] if no table ends and no file states one
DEFAULT_DURATION = 1.0
# direction in the frame of a ball that is no usual axis of a link
OBLIQUE = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)

DriverLaw = str | State | FileMotionLaw


def prescribed_solver(
    source: ModelSource,
    changed: Mapping[str, str | float],
    prescription: Prescription,
    *,
    assembled: bool,
    guess: Mapping[str, Pose] | None = None,
) -> KinematicSolver:
    """Return the solver of a source; without `assembled`, it keeps the guess of the file, which is faster.

    Args:
        source: the model.
        changed: parameter -> its value as text or in SI.
        prescription: the requests of the user.
        assembled: whether its loops are closed.
        guess: from `written_guess`, if known: it selects the assembly of designs with changed parameters.
    """
    if prescription.lock_others:
        solver_of = partial(prescribed_solver, source, changed, assembled=assembled, guess=guess)
        return _with_others_locked(replace(prescription, lock_others=False), solver_of)
    description = source.describe(changed, prescription)
    if prescription.loops is not None and not description.prescribed:
        name = description.solver.name
        raise InputError(f"{name}: loops from {prescription.loops} need the path of a URDF file; give one")
    solver = description.solver
    if prescription.start and solver.closed_form is not None:
        raise InputError(
            f"{solver.name}: its parameters select the assembly, as --set branch=-1; leave out --start"
        )
    if description.prescribed:
        prescription = Prescription(drive=prescription.drive, duration=prescription.duration)
    elif solver.closed_form is None:
        if not solver.mechanism.has_crank:
            solver = _started_by_laws(solver, {**description.motion_laws, **prescription.drive})
        if prescription.start:
            from mechsim.io.requested_start import started_near

            started = started_near(solver.mechanism, prescription.start, solver.written)
            solver = solver.with_mechanism(started)
        if assembled:
            own = written_guess(source) if changed and guess is None else guess
            solver = _assembled(solver, own if changed else None)
        requested = prescription.still or prescription.drive or prescription.lock or prescription.fix_base
        if not requested and (turning := _turning_balls(solver.mechanism)) is not None:
            fact = (
                f"nothing is driven: {turning.drivers[0]} turns once about one oblique axis, and the other "
                "joints keep their pose"
            )
            laws = make_motion_laws(turning, {turning.drivers[0]: steady(0.0, REVOLUTION)}, DEFAULT_DURATION)
            solver = solver.with_mechanism(turning, motion_laws=laws, facts=(*solver.facts, fact))
    return _prescribed(solver, prescription, description)


def _with_others_locked(
    prescription: Prescription, solver_of: Callable[[Prescription], KinematicSolver]
) -> KinematicSolver:
    """Return the solver of a prescription that also locks the joints left undetermined."""
    from mechsim.kinematics.loops.joint_locks import undetermined_joints

    # the path to a locked value can need the other locks
    start = {name: q if isinstance(q, tuple) else None for name, q in prescription.lock.items()}
    solver = solver_of(replace(prescription, lock=start))
    others = undetermined_joints(solver.mechanism)
    if lock := {**prescription.lock, **others}:
        solver = solver_of(replace(prescription, lock=lock))
    named = [f"{name} (one rotation)" if spin else name for name, spin in others.items()]
    fact = f"joints locked at their initial values: {', '.join(named) or 'none'}"
    return solver.with_mechanism(solver.mechanism, facts=(*solver.facts, fact))


def _assembled(solver: KinematicSolver, guess: Mapping[str, Pose] | None) -> KinematicSolver:
    """Return a solver whose loops close at its start, with what was moved for it.

    Args:
        solver: the mechanism.
        guess: poses of a design in which its links without a guess start, so that all commands choose the
            same assembly; those of other links than its own are without effect.
    """
    from mechsim.kinematics.loops.rounded_geometry import corrected

    mechanism = solver.mechanism
    if guess is not None and {*guess} == {*mechanism.link_names[1:]}:
        mechanism = replace(mechanism, guess={**guess, **mechanism.guess})
    exact = corrected(mechanism)
    started, note = closed_start(exact.mechanism)
    return solver.with_mechanism(started, facts=(*solver.facts, *exact.facts, *filter(None, [note])))


def written_guess(source: ModelSource) -> Mapping[str, Pose]:
    """Return the assembly of a model as it is written, without changed parameters; empty if it has none."""
    with suppress(MechsimError):
        written = source.describe({}, Prescription(still=True)).solver
        if written.closed_form is None and len(written.mechanism.guess) < len(written.mechanism.links):
            return start_poses(written.mechanism)[0]
    return {}


def _prescribed(
    solver: KinematicSolver, prescription: Prescription, description: ModelDescription
) -> KinematicSolver:
    """Return a solver with the prescription applied; its description has laws of drivers without a request.

    Raises:
        InputError: for an unknown coordinate or point, or an invalid motion law.
    """
    file_laws = description.motion_laws
    # a mechanism that cannot be assembled is reported by what uses it
    if prescription == Prescription() and not file_laws:
        return solver
    if prescription.key is not None:
        raise InputError(
            f"{solver.name} has no keyframes; leave out --key {prescription.key}, or give an MJCF file"
        )
    mechanism = solver.mechanism
    if any("." in name for name in prescription.drive):
        from mechsim.io.pose_drivers import with_pose_drivers

        mechanism = with_pose_drivers(mechanism, prescription.drive)
    if prescription.track:
        points = dict(_tracked_point(mechanism, text, solver.written) for text in prescription.track)
        mechanism = replace(mechanism, points=points)
    fixed = _joints_to_fix(mechanism, prescription)
    spins = {name: spin for name, spin in prescription.lock.items() if isinstance(spin, tuple)}
    if spins:
        poses, _ = start_poses(mechanism)
        frames = {GROUND: IDENTITY, **poses}
        rods = (spin_rod(mechanism.joint(name), spin, frames) for name, spin in spins.items())
        mechanism = replace(mechanism, joints=(*mechanism.joints, *rods), guess=poses)
    if fixed:
        mechanism = _with_fixed_joints(mechanism, fixed)
    locks = {name: law for name, law in prescription.lock.items() if name not in (*fixed, *spins)}
    prescription = replace(prescription, lock=locks)
    mechanism = _with_drivers_and_locks(mechanism, prescription, file_laws, solver.written)
    unchanged = mechanism is solver.mechanism and not (prescription.drive or file_laws)
    if unchanged and prescription.duration is None:
        return solver
    own_laws, duration = solver.motion_laws, description.duration
    laws: dict[str, DriverLaw] = {**own_laws.by_name, **file_laws}
    laws = {name: law for name, law in laws.items() if name in mechanism.drivers} | dict(prescription.drive)
    if duration is None and not own_laws.crank:
        duration = own_laws.duration
    # the user's formula is a function of the mechanism's own drivers
    formula = solver.formula if mechanism.drivers == solver.mechanism.drivers else ""
    solver = solver.with_mechanism(mechanism, formula=formula)
    return replace(solver, motion_laws=_motion_laws(solver, laws, prescription.duration, duration))


def _started_by_laws(solver: KinematicSolver, laws: Mapping[str, DriverLaw]) -> KinematicSolver:
    """Return a mechanism whose drivers start at the initial values of their motion laws if these are unknown.

    A value in the file, or a guess of both links of a driver's joint, has priority. A law of a constant speed
    starts at the initial value itself, and gives none.
    """
    mechanism = solver.mechanism
    guessed, starts = {GROUND, *mechanism.guess}, dict(mechanism.guess_coordinates)
    unknown = dict.fromkeys(mechanism.drivers, np.nan)
    for name, joint in zip(mechanism.drivers, mechanism.driven_joints, strict=True):
        if name in laws and name not in starts and not {joint.a.link, joint.b.link} <= guessed:
            state = _state(solver, name, laws[name], lambda: unknown)
            value = float(np.asarray(state(np.zeros(1))[0]).ravel()[0])
            starts |= {name: value} if np.isfinite(value) else {}
    if starts == mechanism.guess_coordinates:
        return solver
    return solver.with_mechanism(replace(mechanism, guess_coordinates=starts))


def _state(
    solver: KinematicSolver, name: str, law: DriverLaw, starts: Callable[[], Mapping[str, float]]
) -> State:
    """Return the parsed motion law of a driver; `starts` returns the coordinates at the start."""
    unit = solver.mechanism.unit(name)
    if isinstance(law, str):
        from mechsim.io.law_text import parse_motion_law

        declared = solver.written.declared(unit)
        return parse_motion_law(law, name, unit, lambda: starts()[name], declared=declared)
    return law.parse(name, unit, lambda: starts()[name]) if isinstance(law, FileMotionLaw) else law


def _motion_laws(
    solver: KinematicSolver, laws: Mapping[str, DriverLaw], requested: float | None, stated: float | None
) -> MotionLaws:
    """Return the motion laws of all drivers; `CRANK` without any law."""
    if laws:
        # assembled for the laws that need it
        starts = cache(lambda: start_poses(solver.mechanism)[1])
        states = {name: _state(solver, name, law, starts) for name, law in laws.items()}
        return make_motion_laws(solver.mechanism, states, duration_of(requested, stated, states))
    if requested is not None:
        raise InputError(
            f"{solver.name} has no motion laws for a duration of {requested:g} s; "
            "give --drive COORDINATE=LAW too; a run from an initial state is mechsim dynamics forward"
        )
    return CRANK


def duration_of(requested: float | None, stated: float | None, states: Mapping[str, State]) -> float:
    """Return the duration of motion laws in [s], limited by the end of their tables.

    Args:
        requested: requested duration; None for no request.
        stated: duration in the file; None if it has none.
        states: motion laws of the drivers.
    """
    # of motion laws by text
    stated_ends = {name: getattr(state, "end_time", None) for name, state in states.items()}
    ends: dict[str, float] = {name: end for name, end in stated_ends.items() if end is not None}
    if requested is None:
        requested = stated if stated is not None else min(ends.values(), default=DEFAULT_DURATION)
    for name, end in ends.items():
        if requested > end * (1.0 + 1e-12):
            raise InputError(
                f"the table of {name} ends at {end:g} s, before the duration, {requested:g} s; "
                "give a shorter duration, or more rows"
            )
    return requested


def _with_drivers_and_locks(
    mechanism: Mechanism, prescription: Prescription, file_laws: Collection[str], written: WrittenUnits
) -> Mechanism:
    """Return the mechanism with the requested drivers and locked coordinates.

    Requested drivers replace the mechanism's own drivers, unless these keep the motion laws of the file, or
    need one. A locked coordinate is not driven.
    """
    for name in prescription.drive:
        if name not in mechanism.coordinates:
            hint = suggestion(name, mechanism.coordinates)
            raise InputError(f"{mechanism.name} has no coordinate {name!r} to drive{hint}")
    requested = {*prescription.drive}
    released = prescription.still and bool(requested) and not {*mechanism.drivers} <= {*requested, *file_laws}
    if not prescription.lock and not released and requested <= {*mechanism.drivers}:
        return mechanism
    poses, starts = start_poses(mechanism)
    locked = _locked_coordinates(mechanism, prescription.lock, starts, written)
    drivers = tuple(name for name in mechanism.drivers if name not in locked)
    if released or not requested <= {*drivers}:
        drivers = tuple(prescription.drive)
        locked = {
            name: value for name, value in locked.items() if name not in drivers or name in prescription.lock
        }
    if not drivers:
        raise InputError(
            f"{mechanism.name}: no coordinate is driven; lock fewer, or name a driver by --drive"
        )
    guess_coordinates = {name: starts[name] for name in drivers}
    guess_coordinates |= {
        name: value for name, value in mechanism.guess_coordinates.items() if name not in locked
    }
    single = drivers[0] if len(drivers) == 1 else ""
    at_guess = {"guess": poses, "guess_coordinates": guess_coordinates}
    changed = replace(mechanism, driver=single or drivers, locked=locked, **at_guess)
    return replace(changed, start=guess_coordinates[single]) if changed.has_crank else changed


def _locked_coordinates(
    mechanism: Mechanism,
    lock: Mapping[str, "LockedAt"],
    starts: Mapping[str, float],
    written: WrittenUnits,
) -> dict[str, float]:
    """Return all locked coordinates and their values in SI."""
    locked = dict(mechanism.locked)
    coordinates_of: dict[str, tuple[str, ...]] = {name: (name,) for name in mechanism.coordinates}
    coordinates_of |= {joint.name: joint.coordinates for joint in mechanism.joints if joint.coordinates}
    balls = _ball_joints(mechanism)
    for name, value in lock.items():
        if name in balls:
            raise InputError(
                f"joint {name!r} rotates about every axis, so that no single value locks it; give no "
                "value, to lock it at its initial orientation"
            )
        if name not in coordinates_of:
            raise InputError(
                f"{mechanism.name} has no coordinate {name!r} to lock"
                f"{suggestion(name, [*coordinates_of, *balls])}"
            )
        first, *others = coordinates_of[name]
        if value is None:
            locked |= {coordinate: starts[coordinate] for coordinate in coordinates_of[name]}
        elif others:
            listed = ", ".join(coordinates_of[name])
            raise InputError(f"joint {name!r} has coordinates {listed}; lock each by its own name")
        elif isinstance(value, str):
            what, length = f"the locked position of {name}", mechanism.characteristic_length
            unit = mechanism.unit(first)
            locked[first] = units.parse_coordinate(value, unit, what, written, length=length)
        else:
            locked[first] = number(value)
    return locked


def _tracked_point(mechanism: Mechanism, text: str, written: WrittenUnits) -> tuple[str, tuple[str, Vector]]:
    """Return a point written as NAME, of a point or a link, or as NAME,LINK@x,y,z."""
    (name, comma, rest), links = text.partition(","), mechanism.link_names
    if not comma:
        if name in mechanism.points:
            return name, mechanism.points[name]
        if name in links:
            return name, (name, ORIGIN)
        raise InputError(
            f"{mechanism.name} has no point or link {name!r} to track"
            f"{suggestion(name, [*mechanism.points, *links])}"
        )
    link, separator, numbers = rest.partition("@")
    if link not in links:
        raise InputError(f"the point {name} is tracked on link {link!r}{suggestion(link, links)}")
    if separator:
        units.require_written(numbers, "m", written.length, f"the position of {name}")
    values = units.parse_vector(numbers, "m", f"the position of {name}") if separator else ORIGIN
    if len(values) != 3:
        raise InputError(
            f"the position of {name} is {numbers!r}; give three numbers in m, separated by commas"
        )
    return name, (link, (values[0], values[1], values[2]))


def _joints_to_fix(mechanism: Mechanism, prescription: Prescription) -> list[str]:
    """Return the joints to fix at their initial pose: floating or spherical joints locked as they are."""
    floating = [
        joint.name
        for joint in mechanism.joints
        if KINDS[joint.kind].floating and GROUND in (joint.a.link, joint.b.link)
    ]
    if prescription.fix_base and not floating:
        raise InputError(f"{mechanism.name} has no floating link; leave out --fix-base")
    balls = [name for name in _ball_joints(mechanism) if prescription.lock.get(name, "") is None]
    return [*(floating if prescription.fix_base else ()), *balls]


def _ball_joints(mechanism: Mechanism) -> list[str]:
    """Return the spherical joints."""
    return [joint.name for joint in mechanism.joints if KINDS[joint.kind].ball]


def _with_fixed_joints(mechanism: Mechanism, names: list[str]) -> Mechanism:
    """Return the mechanism with joints fixed at their initial pose."""
    poses, _ = start_poses(mechanism)
    frames, joints = {GROUND: IDENTITY, **poses}, [*mechanism.joints]
    for i, joint in enumerate(joints):
        if joint.name in names:
            a, b = frames[joint.a.link], frames[joint.b.link]
            frame = a.rotation.T @ b.rotation @ joint.b.frame
            point = a.local(b.point(joint.b.point))
            end = End(joint.a.link, vector(point), vector(frame[:, 2]), vector(frame[:, 0]))
            joints[i] = Joint(joint.name, FIXED, end, replace(joint.b, reference=vector(joint.b.frame[:, 0])))
    coordinates = {name for joint in joints for name in joint.coordinates}
    locked, guessed = (
        {name: value for name, value in values.items() if name in coordinates}
        for values in (mechanism.locked, mechanism.guess_coordinates)
    )
    changed = {"joints": tuple(joints), "guess": poses, "locked": locked, "guess_coordinates": guessed}
    return replace(mechanism, **changed)


def _turning_balls(mechanism: Mechanism) -> Mechanism | None:
    """Return an open chain of balls, universal and free joints, of which only the first turns, as a hinge.

    None stands for other mechanisms.
    """
    joints = mechanism.joints
    if mechanism.drivers or len(joints) != len(mechanism.links):
        return None
    moving = [joint for joint in joints if KINDS[joint.kind].dof]
    if not moving or any(KINDS[joint.kind].dof == 1 for joint in moving):
        return None
    first, poses = moving[0], {GROUND: IDENTITY, **start_poses(mechanism)[0]}
    fixed = _with_fixed_joints(mechanism, [joint.name for joint in moving])
    a, b = (poses[link] for link in (first.a.link, first.b.link))
    axis = a.rotation @ first.a.frame @ OBLIQUE
    end_a = End(first.a.link, vector(a.local(b.point(first.b.point))), vector(a.rotation.T @ axis))
    end_b = End(first.b.link, first.b.point, vector(b.rotation.T @ axis))
    hinge = Joint(first.name, REVOLUTE, end_a, end_b)
    hinges = tuple(hinge if joint.name == first.name else joint for joint in fixed.joints)
    return replace(fixed, joints=hinges, driver=first.name, guess_coordinates={}, guess={})
