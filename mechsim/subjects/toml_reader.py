"""A mechanism in a TOML file, read: its keys are those of `toml_keys`, and docs/models.md shows them."""

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.model.inertia import Inertia
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, Link, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.vertical import Up, against
from mechsim.model.written_units import WrittenUnits
from mechsim.subjects.checked_values import Values
from mechsim.subjects.key_kinds import Keys
from mechsim.subjects.parameter_units import parameter_units, require_kinds
from mechsim.subjects.toml_couplings import couplings_of, require_pitch_points
from mechsim.subjects.toml_drivers import (
    FileProgram,
    coordinates_of,
    drivers_of,
    locked_of,
    programs_of,
    start_of,
)
from mechsim.subjects.toml_forces import GRAVITY, forces_of
from mechsim.subjects.toml_keys import ROOT
from mechsim.subjects.toml_source import TomlSource, nearest, read_source


@dataclass(frozen=True)
class TomlSubject:
    """A mechanism in a file, and how the file drives it.

    Attributes:
        form: what moves, as yet without programs.
        programs: driver -> its program as the file has it.
        duration: of the programs in [s]; None where the file says nothing.
    """

    form: LoopForm
    programs: Mapping[str, FileProgram]
    duration: float | None


def read_toml(
    path: str, changed: Mapping[str, str | float] | None = None, *, drivers: tuple[str, ...] = ()
) -> TomlSubject:
    """Return the mechanism of a TOML file.

    Args:
        path: of the file.
        changed: parameter -> text, or number in SI, that stands for what the file has.
        drivers: coordinates that are driven where the file names none.

    Raises:
        InputError: for what the file may not hold; names file, line, key, value and remedy.
    """
    return toml_subject(read_source(path), changed, drivers=drivers)


def toml_subject(
    source: TomlSource, changed: Mapping[str, str | float] | None = None, *, drivers: tuple[str, ...] = ()
) -> TomlSubject:
    """Return the mechanism of a file that was read; as `read_toml`."""
    document = {name: one for name, one in source.document.items() if name not in ("parameters", "units")}
    told = parameter_units(source.document) if changed else {}
    parameters = source.document.get("parameters", {})
    values = values_of(source).with_parameters(parameters, changed or {}, told)
    require_kinds(source, {**parameters, **(changed or {})})
    read = values.checked(ROOT, document, ())
    of = coordinates_of(values, read["joints"])
    with source.about(()):
        driver = drivers_of(of, read, drivers)
        start, counted = start_of(of, read, driver)
        gears, couplings = couplings_of(of, read)
        mechanism = Mechanism(
            name=read["name"],
            links=tuple(_links(source, read)),
            joints=tuple(_joint(source, name, one) for name, one in read["joints"].items()),
            driver=driver,
            points={name: (one["link"], one.get("at", (0.0, 0.0, 0.0))) for name, one in _of(read, "points")},
            gears=gears,
            guess={name: _pose(source, name, one) for name, one in _of(read, "guess")},
            start=start,
            couplings=couplings,
            locked=locked_of(of, read, driver),
            counted=counted,
            up=_up(read),
        )
    require_pitch_points(source, mechanism, read)
    form = LoopForm(
        mechanism,
        parameters=values.parameters,
        formula=_formula(source.path, read),
        forces=forces_of(values, mechanism, read),
        written=WrittenUnits(values.length, values.angle),
    )
    duration = read.get("duration")
    if duration is not None and not duration > 0.0:
        raise source.refusal(("duration",), f"is {duration:g} s; give a time above 0")
    return TomlSubject(form, programs_of(of, read, driver), duration)


def _up(read: Mapping[str, Any]) -> Up | None:
    """Return the axis that points up: as stated, else against the gravity that acts by `[forces]`."""
    stated: Up | None = read.get("display", {}).get("up")
    if stated or "forces" not in read:
        return stated
    return against(read["forces"].get("gravity", GRAVITY))


def _formula(path: str, read: Mapping[str, Any]) -> str:
    """Return FILE.py:FUNCTION of the formula, the file looked for beside the mechanism's; empty without."""
    given = read.get("formula", {}).get("python", "")
    return os.path.join(os.path.dirname(path), given) if given else ""


def values_of(source: TomlSource) -> Values:
    """Return what reads values, with the file's units and no parameters yet."""
    bare = Values(source, "m", "rad", {})
    words = Keys({"units": ROOT.keys["units"]}, "")
    given = {name: one for name, one in source.document.items() if name == "units"}
    units = bare.checked(words, given, ()).get("units", {})
    found = Values(source, units.get("length", "m"), units.get("angle", "rad"), {})
    with source.about(("units",)):
        found.in_si(1.0, "m")
        found.in_si(1.0, "rad")
    return found


def _of(read: Mapping[str, Any], table: str) -> Iterator[tuple[str, Any]]:
    yield from read.get(table, {}).items()


def _links(source: TomlSource, read: Mapping[str, Any]) -> Iterator[Link]:
    """Yield the links with tables, then those that only joints name, at least two of them."""
    declared: dict[str, Any] = read.get("links", {})
    if GROUND in declared:
        raise source.refusal(("links", GROUND), "is the frame, which has no table; take it out")
    for name, one in declared.items():
        with source.about(("links", name)):
            inertia = one.get("inertia")
            yield Link(name, one.get("outline", ()), inertia and Inertia(**inertia))
    named = [(joint, side, one[side]["link"]) for joint, one in _of(read, "joints") for side in "ab"]
    count = Counter(link for _, _, link in named)
    for joint, side, link in named:
        if link in declared or link == GROUND:
            continue
        if count[link] == 1:
            known = dict.fromkeys(name for name in (GROUND, *declared, *count) if name != link)
            why = f"is {link!r}, which no other joint names and [links] does not hold"
            table = f"; a link of one joint needs a table, [links.{link}]"
            raise source.refusal(("joints", joint, side, "link"), why + nearest(link, known) + table)
    yield from (Link(name) for name in count if name not in declared and name != GROUND)


def _joint(source: TomlSource, name: str, one: Mapping[str, Any]) -> Joint:
    with source.about(("joints", name)):
        a, b = (_end(one[side]) for side in "ab")
        rest = {key: one[key] for key in ("cross_angle", "lead") if key in one}
        return Joint(name, one["kind"], a, b, **rest)


def _end(one: Mapping[str, Any]) -> End:
    known = {"at": "point", "axis": "axis", "mark": "mark"}
    return End(one["link"], **{known[key]: value for key, value in one.items() if key != "link"})


def _pose(source: TomlSource, link: str, one: Mapping[str, Any]) -> Pose:
    rotation = np.eye(3)
    if "turn" in one and "rotation" in one:
        raise source.refusal(("guess", link), "has both turn and rotation; give one of them")
    if "turn" in one:
        axis = np.array(one["turn"]["axis"])
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise source.refusal(("guess", link, "turn"), "has an axis of length 0; give a direction")
        rotation = turned_by(rotation[None], (axis / length * one["turn"]["angle"])[None])[0]
    elif "rotation" in one:
        rotation = np.array(one["rotation"])
        if not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6 or np.linalg.det(rotation) < 0.0:
            raise source.refusal(("guess", link, "rotation"), "is no rotation matrix; give one, or a turn")
    return Pose(np.array(one.get("at", (0.0, 0.0, 0.0))), rotation)
