"""What is prescribed of a mechanism: what is driven and how, what is held, and which points count."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from mechsim import units
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.closure.start_values import start_poses
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.maths.given import number
from mechsim.model.joint_kinds import FIXED, KINDS
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, IDENTITY, ORIGIN, Pose, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.model.programs import Programs, State
from mechsim.model.programs import programs as all_programs
from mechsim.model.written_units import WrittenUnits
from mechsim.subjects.program_text import Program, Start, program
from mechsim.subjects.toml_drivers import FileProgram
from mechsim.subjects.toml_source import nearest
from mechsim.units import Unit

# how long programs run, in [s], where neither a table ends nor a file says
DURATION = 1.0

Given = str | State | FileProgram


@dataclass(frozen=True, slots=True, kw_only=True)
class Prescription:
    """What is asked of a subject beside what it says itself.

    Attributes:
        drive: coordinate -> its program, as text (see `program_text.program`) or a function of time.
        lock: joint or coordinate -> where it is locked, as text or in SI; None holds it where it starts, and
            alone holds a ball.
        fix_base: whether what floats is held where it starts.
        lock_others: whether what the drivers leave undetermined is locked where it starts.
        key: name of a keyframe to start from.
        track: the only points that count, as `NAME` or `NAME,LINK@x,y,z`; empty for those there are.
        duration: of the programs in [s].
        still: whether nothing need be driven.
    """

    drive: Mapping[str, str | State] = field(default_factory=dict[str, "str | State"])
    lock: Mapping[str, str | float | None] = field(default_factory=dict[str, "str | float | None"])
    fix_base: bool = False
    lock_others: bool = False
    key: str | None = None
    track: tuple[str, ...] = ()
    duration: float | None = None
    still: bool = False


def prescribed(
    form: Form,
    asked: Prescription,
    programs: Mapping[str, FileProgram] | None = None,
    duration: float | None = None,
) -> Form:
    """Return what moves as it is asked to.

    Args:
        form: what moves.
        asked: what is prescribed.
        programs: what a file says of drivers of which nothing is asked.
        duration: of them in [s], where a file says.

    Raises:
        InputError: for a coordinate, a point or a program that is none.
    """
    if asked == Prescription() and not programs:
        return form
    if asked.key is not None:
        raise InputError(f"{form.name} has no keyframes; leave out --key {asked.key}, or give an MJCF file")
    own = form if isinstance(form, LoopForm) else LoopForm(form.mechanism)
    mechanism = form.mechanism
    if asked.track:
        mechanism = replace(
            mechanism, points=dict(_tracked(mechanism, text, own.written) for text in asked.track)
        )
    still = _standing_still(mechanism, asked)
    if still:
        mechanism = _stilled(mechanism, still)
        asked = replace(asked, lock={name: one for name, one in asked.lock.items() if name not in still})
    mechanism = _redriven(mechanism, asked, own.written)
    if mechanism is form.mechanism and not (asked.drive or programs) and asked.duration is None:
        return form
    before = own.programs
    given: dict[str, Given] = {} if before is None else dict(before.by_name)
    given |= programs or {}
    given = {name: one for name, one in given.items() if name in mechanism.drivers} | dict(asked.drive)
    if duration is None and before is not None:
        duration = before.duration
    return replace(
        own, mechanism=mechanism, programs=_programs(mechanism, given, asked.duration, duration, own.written)
    )


class _NeedsStartError(Exception):
    """A motion law counts from where its driver starts."""


def started_by_laws(form: LoopForm, laws: Mapping[str, Given]) -> LoopForm:
    """Return a mechanism whose drivers start where their motion laws begin, if nothing else says where.

    A value that the file states, or a guess of both links of a driver's joint, comes first. A lone crank
    starts at zero.
    """
    mechanism = form.mechanism
    if mechanism.has_crank:
        return form
    placed, starts = {GROUND, *mechanism.guess}, dict(mechanism.counted)
    for name, joint in zip(mechanism.drivers, mechanism.driven_joints, strict=True):
        if name in laws and name not in starts and not {joint.a.link, joint.b.link} <= placed:
            with suppress(_NeedsStartError):
                state = _state(mechanism, name, laws[name], _no_start, form.written)
                starts[name] = float(np.asarray(state(np.zeros(1))[0]).ravel()[0])
    if starts == mechanism.counted or not np.isfinite(list(starts.values())).all():
        return form
    return replace(form, mechanism=replace(mechanism, counted=starts))


def _no_start() -> float:
    raise _NeedsStartError


def _state(mechanism: Mechanism, name: str, law: Given, start: Start, written: WrittenUnits) -> State:
    """Return the motion law of a driver, read."""
    unit = mechanism.unit(name)
    if isinstance(law, str):
        return program(law, name, unit, start, declared=written.of(unit))
    return law.made(name, unit, start) if isinstance(law, FileProgram) else law


def _programs(
    mechanism: Mechanism,
    given: Mapping[str, Given],
    asked: float | None,
    own: float | None,
    written: WrittenUnits,
) -> Programs | None:
    """Return the programs of what is given for drivers; None where nothing is."""
    if given:
        states = _states(mechanism, given, written)
        return all_programs(mechanism, states, lasting(asked, own, states))
    if asked is not None:
        raise InputError(
            f"{mechanism.name} has no programs that could last {asked:g} s; give --drive JOINT=PROGRAM too"
        )
    return None


def _states(mechanism: Mechanism, given: Mapping[str, Given], written: WrittenUnits) -> dict[str, State]:
    """Return the programs of drivers, read."""
    starts: dict[str, float] = {}

    def start(name: str) -> Callable[[], float]:
        def found() -> float:
            if not starts:
                starts.update(start_poses(mechanism)[1])
            return starts[name]

        return found

    return {name: _state(mechanism, name, law, start(name), written) for name, law in given.items()}


def lasting(asked: float | None, own: float | None, states: Mapping[str, State]) -> float:
    """Return how long programs run, in [s], and not beyond a table.

    Args:
        asked: for how long; None where nothing was.
        own: how long a file says; None where it says nothing.
        states: of the drivers.
    """
    ends = {
        name: state.lasts
        for name, state in states.items()
        if isinstance(state, Program) and state.lasts is not None
    }
    if asked is None:
        asked = own if own is not None else min(ends.values(), default=DURATION)
    for name, end in ends.items():
        if asked > end * (1.0 + 1e-12):
            raise InputError(
                f"the table of {name} ends at {end:g} s, before the duration, {asked:g} s; "
                "give a shorter one, or more rows"
            )
    return asked


def _redriven(mechanism: Mechanism, asked: Prescription, written: WrittenUnits) -> Mechanism:
    """Return the mechanism with what is asked driven and held.

    Where others are driven than its own drivers, those alone are; what is held is driven no more.
    """
    known = [name for joint in mechanism.joints for name in joint.coordinates]
    for name in asked.drive:
        if name not in known:
            raise InputError(f"{mechanism.name} has no coordinate {name!r} to drive{nearest(name, known)}")
    if not asked.lock and set(asked.drive) <= set(mechanism.drivers):
        return mechanism
    poses, starts = start_poses(mechanism)
    locked = _holds(mechanism, asked.lock, starts, written)
    drivers = tuple(name for name in mechanism.drivers if name not in locked)
    if not set(asked.drive) <= set(drivers):
        drivers = tuple(asked.drive)
        locked = {name: value for name, value in locked.items() if name not in drivers or name in asked.lock}
    if not drivers:
        raise InputError(f"{mechanism.name}: nothing is driven; hold less, or name a driver by --drive")
    counted = {name: starts[name] for name in drivers}
    counted |= {name: value for name, value in mechanism.counted.items() if name not in locked}
    alone = drivers[0] if len(drivers) == 1 else ""
    changed = replace(
        mechanism,
        driver=alone or drivers,
        locked=locked,
        counted=counted,
        guess=poses,
    )
    return replace(changed, start=counted[alone]) if changed.has_crank else changed


def _holds(
    mechanism: Mechanism,
    hold: Mapping[str, str | float | None],
    starts: Mapping[str, float],
    written: WrittenUnits,
) -> dict[str, float]:
    """Return all coordinates held, and where, in SI."""
    holds = dict(mechanism.locked)
    known: dict[str, tuple[str, ...]] = {
        name: (name,) for joint in mechanism.joints for name in joint.coordinates
    }
    known |= {joint.name: joint.coordinates for joint in mechanism.joints if joint.coordinates}
    balls = _balls(mechanism)
    for name, value in hold.items():
        if name in balls:
            raise InputError(
                f"joint {name!r} turns about every axis, and no one value says how far; give none, to hold "
                "it where it starts"
            )
        if name not in known:
            raise InputError(
                f"{mechanism.name} has no coordinate {name!r} to hold{nearest(name, [*known, *balls])}"
            )
        first, *others = known[name]
        if value is None:
            holds |= {one: starts[one] for one in known[name]}
        elif others:
            of = ", ".join(known[name])
            raise InputError(f"joint {name!r} has coordinates {of}; hold each by its own name")
        elif isinstance(value, str):
            unit: Unit = "m" if mechanism.unit(first) == "m" else "rad"
            units.require_written(value, unit, written.of(unit), f"the locked position of {name}")
            holds[first] = units.parse(value, unit, f"the locked position of {name}")
        else:
            holds[first] = number(value)
    return holds


def _tracked(mechanism: Mechanism, text: str, written: WrittenUnits) -> tuple[str, tuple[str, Vector]]:
    """Return a point written as NAME, of a point or a link, or as NAME,LINK@x,y,z."""
    name, comma, rest = text.partition(",")
    links = [GROUND, *(link.name for link in mechanism.links)]
    if not comma:
        if name in mechanism.points:
            return name, mechanism.points[name]
        if name in links:
            return name, (name, ORIGIN)
        raise InputError(
            f"{mechanism.name} has no point or link {name!r} to track"
            f"{nearest(name, [*mechanism.points, *links])}"
        )
    link, at, place = rest.partition("@")
    if link not in links:
        raise InputError(f"the point {name} is tracked on link {link!r}{nearest(link, links)}")
    if at:
        units.require_written(place, "m", written.length, f"the place of {name}")
    values = units.parse_vector(place, "m", f"the place of {name}") if at else ORIGIN
    if len(values) != 3:
        raise InputError(f"the place of {name} is {place!r}; give three numbers in m, with commas")
    return name, (link, (values[0], values[1], values[2]))


def _standing_still(mechanism: Mechanism, asked: Prescription) -> list[str]:
    """Return the joints to be fixed where they start: what floats, or balls held without a value."""
    floating = [
        joint.name
        for joint in mechanism.joints
        if KINDS[joint.kind].floats and GROUND in (joint.a.link, joint.b.link)
    ]
    if asked.fix_base and not floating:
        raise InputError(f"{mechanism.name} has no link that floats; leave out --fix-base")
    held = [name for name in _balls(mechanism) if asked.lock.get(name, "") is None]
    return [*(floating if asked.fix_base else ()), *held]


def _balls(mechanism: Mechanism) -> list[str]:
    """Return the joints that turn about every axis."""
    return [joint.name for joint in mechanism.joints if KINDS[joint.kind].ball]


def _stilled(mechanism: Mechanism, names: list[str]) -> Mechanism:
    """Return the mechanism with joints fixed where they start."""
    poses, _ = start_poses(mechanism)
    placed = {GROUND: IDENTITY, **poses}
    joints = tuple(_fixed(one, placed) if one.name in names else one for one in mechanism.joints)
    known = [name for joint in joints for name in joint.coordinates]
    return replace(
        mechanism,
        joints=joints,
        guess=poses,
        locked={name: value for name, value in mechanism.locked.items() if name in known},
        counted={name: value for name, value in mechanism.counted.items() if name in known},
    )


def _fixed(joint: Joint, poses: Mapping[str, Pose]) -> Joint:
    """Return a joint that leaves its links as they stand."""
    a, b = poses[joint.a.link], poses[joint.b.link]
    frame = a.rotation.T @ b.rotation @ joint.b.frame
    point = a.rotation.T @ (b.point(joint.b.point) - a.position)
    near = End(joint.a.link, _vector(point), _vector(frame[:, 2]), _vector(frame[:, 0]))
    return Joint(joint.name, FIXED, near, replace(joint.b, mark=_vector(joint.b.frame[:, 0])))


def _vector(values: Array) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))
