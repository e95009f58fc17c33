"""Read a mechanism from a TOML file; docs/reference/toml.md documents its keys."""

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mechsim.analytic.derivatives.dimensions import Dimension
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, Inertia, Link, Pose
from mechsim.model.mechanism import Mechanism, Up, against
from mechsim.subjects.model_source import ModelDescription, ModelSource, Parameters
from mechsim.subjects.parameter_units import parameter_dependencies, parameter_units, require_dimensions
from mechsim.subjects.prescription import Prescription
from mechsim.subjects.toml_coordinates import (
    coordinates_of,
    couplings_of,
    drivers_of,
    initial_of,
    locked_of,
    motion_laws_of,
    require_pitch_points,
    start_of,
)
from mechsim.subjects.toml_forces import GRAVITY, forces_of
from mechsim.subjects.toml_keys import ROOT, Table
from mechsim.subjects.toml_values import TomlSource, Values, read_source, suggestion
from mechsim.units import WrittenUnits


@dataclass(frozen=True)
class TomlModel(ModelSource):
    """A mechanism in a TOML file.

    Attributes:
        path: path of the file.
    """

    path: str

    @cached_property
    def source(self) -> TomlSource:
        """The parsed file."""
        return read_source(self.path)

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism; the requested coordinates are the drivers if the file names none."""
        return toml_model(self.source, changed, drivers=tuple(prescription.drive))

    def values(self, changed: Mapping[str, str | float]) -> Values:
        """Return what reads values of the file, with its parameters."""
        document = self.source.document
        texts, units_of = document.get("parameters", {}), parameter_units(document)
        return values_of(self.source).with_parameters(texts, changed, units_of)

    def parameters(self, changed: Mapping[str, str | float]) -> Parameters:
        """Return the parameters; a parameter whose use does not determine its unit is a plain number."""
        document = self.source.document
        texts, units_of = document.get("parameters", {}), parameter_units(document)
        values = self.values(changed)
        dimensions: dict[str, Dimension] = {}
        for name, value in values.parameters.items():
            unit = values.unit_of(name, texts[name], units_of)
            dimensions[name] = (
                Dimension(name, value, "1")
                if unit is None
                else Dimension(name, values.in_si(value, unit), unit, values.declared_unit(texts[name], unit))
            )
        return Parameters(dimensions, parameter_dependencies(document))


def toml_model(
    source: TomlSource, changed: Mapping[str, str | float] | None = None, *, drivers: tuple[str, ...] = ()
) -> ModelDescription:
    """Return the mechanism of a TOML file.

    Args:
        source: the file.
        changed: parameter -> text, or number in SI, that replaces the value in the file.
        drivers: driven coordinates if the file names none.

    Raises:
        InputError: for invalid contents; names file, line, key, value and remedy.
    """
    document = {name: entry for name, entry in source.document.items() if name not in ("parameters", "units")}
    units_of = parameter_units(source.document) if changed else {}
    parameters = source.document.get("parameters", {})
    require_dimensions(source, {**parameters, **(changed or {})})
    values = values_of(source).with_parameters(parameters, changed or {}, units_of)
    read = values.checked(ROOT, document, ())
    coordinates = coordinates_of(values, read)
    with source.error_context(()):
        drivers = drivers_of(coordinates, drivers)
        start, guess_coordinates = start_of(coordinates, drivers)
        gears, couplings = couplings_of(coordinates)
        mechanism = Mechanism(
            name=read["name"],
            links=tuple(_links(source, read)),
            joints=tuple(_joint(source, name, entry) for name, entry in read["joints"].items()),
            driver=drivers[0] if len(drivers) == 1 else drivers,
            points={
                name: (entry["link"], entry.get("at", (0.0, 0.0, 0.0)))
                for name, entry in _entries(read, "points")
            },
            gears=gears,
            guess={name: _pose(source, name, entry) for name, entry in _entries(read, "guess")},
            start=start,
            couplings=couplings,
            locked=locked_of(coordinates, drivers),
            guess_coordinates=guess_coordinates,
            up=_up(read),
        )
    require_pitch_points(source, mechanism, read)
    formula = read.get("formula", {}).get("python", "")
    solver = LoopForm(
        mechanism,
        parameters=values.parameters,
        # FILE.py:FUNCTION with the folder of the mechanism
        formula=os.path.join(os.path.dirname(source.path), formula) if formula else "",
        forces=forces_of(values, mechanism, read),
        initial=initial_of(coordinates),
        written=WrittenUnits(values.length, values.angle),
    )
    duration = read.get("duration")
    if duration is not None and not duration > 0.0:
        raise source.error(("duration",), f"is {duration:g} s; give a time above 0")
    return ModelDescription(solver, motion_laws_of(coordinates, drivers), duration)


def _up(read: Mapping[str, Any]) -> Up | None:
    """Return the axis that points up: as stated in the file, else against the gravity of `[forces]`."""
    stated: Up | None = read.get("display", {}).get("up")
    if stated or "forces" not in read:
        return stated
    return against(read["forces"].get("gravity", GRAVITY))


def values_of(source: TomlSource) -> Values:
    """Return the reader of values, with the file's units and without parameters."""
    bare = Values(source, "m", "rad", {})
    units_table = Table({"units": ROOT.keys["units"]}, "")
    stated = {name: entry for name, entry in source.document.items() if name == "units"}
    units = bare.checked(units_table, stated, ()).get("units", {})
    values = Values(source, units.get("length", "m"), units.get("angle", "rad"), {})
    with source.error_context(("units",)):
        values.in_si(1.0, "m")
        values.in_si(1.0, "rad")
    return values


def _entries(read: Mapping[str, Any], table: str) -> Iterator[tuple[str, Any]]:
    yield from read.get(table, {}).items()


def _links(source: TomlSource, read: Mapping[str, Any]) -> Iterator[Link]:
    """Yield the links with tables, then those that at least two joints name."""
    declared: dict[str, Any] = read.get("links", {})
    if GROUND in declared:
        raise source.error(("links", GROUND), "is the frame, which has no table; leave it out")
    for name, entry in declared.items():
        with source.error_context(("links", name)):
            inertia = entry.get("inertia")
            yield Link(name, entry.get("outline", ()), inertia and Inertia(**inertia))
    named = [(joint, side, entry[side]["link"]) for joint, entry in _entries(read, "joints") for side in "ab"]
    count = Counter(link for _, _, link in named)
    for joint, side, link in named:
        if link in declared or link == GROUND:
            continue
        if count[link] == 1:
            candidates = dict.fromkeys(name for name in (GROUND, *declared, *count) if name != link)
            reason = f"is {link!r}, which no other joint names and [links] does not contain"
            table = f"; a link of one joint needs a table, [links.{link}]"
            raise source.error(("joints", joint, side, "link"), reason + suggestion(link, candidates) + table)
    yield from (Link(name) for name in count if name not in declared and name != GROUND)


def _joint(source: TomlSource, name: str, entry: Mapping[str, Any]) -> Joint:
    with source.error_context(("joints", name)):
        a, b = (_end(entry[side]) for side in "ab")
        rest = {key: entry[key] for key in ("cross_angle", "lead") if key in entry}
        return Joint(name, entry["kind"], a, b, **rest)


def _end(entry: Mapping[str, Any]) -> End:
    fields = {"at": "point", "axis": "axis", "reference": "reference", "mark": "reference"}
    return End(entry["link"], **{fields[key]: value for key, value in entry.items() if key != "link"})


def _pose(source: TomlSource, link: str, entry: Mapping[str, Any]) -> Pose:
    rotation = np.eye(3)
    if "turn" in entry and "rotation" in entry:
        raise source.error(("guess", link), "has both turn and rotation; give one of them")
    if "turn" in entry:
        axis = np.array(entry["turn"]["axis"])
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise source.error(("guess", link, "turn"), "has an axis of length 0; give a direction")
        rotation = turned_by(rotation[None], (axis / length * entry["turn"]["angle"])[None])[0]
    elif "rotation" in entry:
        rotation = np.array(entry["rotation"])
        if not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6 or np.linalg.det(rotation) < 0.0:
            raise source.error(("guess", link, "rotation"), "is no rotation matrix; give one, or a turn")
    return Pose(np.array(entry.get("at", (0.0, 0.0, 0.0))), rotation)
