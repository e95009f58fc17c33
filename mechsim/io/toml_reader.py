"""Read a mechanism from a TOML file; docs/reference/toml.md documents its keys."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.files import read_text
from mechsim.io.model_source import ModelDescription, ModelSource, Parameters, Prescription
from mechsim.io.parameter_units import parameter_dependencies, parameter_units, require_dimensions
from mechsim.io.toml_coordinates import FileCoordinates
from mechsim.io.toml_keys import root
from mechsim.io.toml_links import joint_of, links_of, pose_of
from mechsim.io.toml_values import TomlSource, Values, head_comment, parsed_source, shown, values_of
from mechsim.kinematics.designs import Dimension
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.joints import Coupling, joint_coordinate
from mechsim.mechanism.links import GROUND, IDENTITY
from mechsim.mechanism.mechanism import Mechanism, Up, against
from mechsim.units import WrittenUnits

if TYPE_CHECKING:
    from mechsim.mechanism.contacts import Contact

# largest file in bytes: mechanisms need far less
MAX_BYTES = 1_000_000


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
        source = parsed_source(self.path, read_text(self.path, "a TOML file", MAX_BYTES))
        if not tables_in(source.document, "parameters"):
            return source
        from mechsim.io.toml_stated import with_stated

        return with_stated(source)

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism; the requested coordinates are the drivers if the file names none.

        Raises:
            InputError: for invalid contents; names file, line, key, value and remedy.
        """
        source = self.source
        document = {
            name: entry for name, entry in source.document.items() if name not in ("parameters", "units")
        }
        values = self.values(changed)
        if source.stated:
            self.parameters({})
        if any("backlash" in joint for joint in tables_in(document, "joints")):
            from mechsim.io.toml_backlash import with_backlash

            values.checked(root(), document, ())
            with source.error_context(("joints",)):
                document = with_backlash(document)
        added: Sequence[Coupling] = ()
        contacts: Mapping[str, Contact] = {}
        if has_curves(document):
            from mechsim.io.toml_curves import with_curves

            document, added, contacts = with_curves(values, document, values.checked(root(), document, ()))
        read = values.checked(root(), document, ())
        require_dimensions(source, {**source.document.get("parameters", {}), **changed})
        coordinates = FileCoordinates(values, read)
        with source.error_context(()):
            drivers = coordinates.drivers(tuple(prescription.drive), still=prescription.still)
            mechanism = replace(mechanism_of(coordinates, drivers, added), contacts=contacts)
        limits = coordinates.limits()
        stated = {name: contact.restitution for name, contact in contacts.items()}
        restitution = {f"{name}.gap": e for name, e in stated.items() if e is not None}
        forces, facts = None, ()
        if limits.stops or has_forces(read):
            from mechsim.io.toml_forces import facts_of, forces_of

            forces = forces_of(values, mechanism, read, limits.stops)
            facts = facts_of(values, mechanism, forces)
        solver = KinematicSolver(
            mechanism,
            parameters=values.parameters,
            formula=formula_path(source, read.get("formula", {}).get("python", "")),
            forces=forces,
            initial=coordinates.initial(),
            ranges=limits.ranges,
            restitution=limits.restitution | restitution,
            written=WrittenUnits(values.length, values.angle),
            comment=head_comment(source.path),
            facts=facts,
        )
        duration = read.get("duration")
        if duration is not None and not duration > 0.0:
            raise source.error(("duration",), f"is {duration:g} s; give a time above 0")
        return ModelDescription(solver, coordinates.motion_laws(drivers), duration)

    def values(self, changed: Mapping[str, str | float]) -> Values:
        """Return what reads values of the file, with its parameters."""
        document = self.source.document
        units_of = parameter_units(document) if changed else {}
        return values_of(self.source).with_parameters(document.get("parameters", {}), changed, units_of)

    def parameters(self, changed: Mapping[str, str | float]) -> Parameters:
        """Return the parameters; a parameter whose use does not determine its unit is a plain number."""
        document = self.source.document
        texts, units_of = document.get("parameters", {}), parameter_units(document)
        values = self.values(changed)
        dimensions: dict[str, Dimension] = {}
        for name, value in values.parameters.items():
            unit = values.unit_of(name, texts[name], units_of)
            dimension = Dimension(name, value, "1")
            if unit is not None:
                declared = values.declared_unit(texts[name], unit)
                dimension = Dimension(name, values.in_si(value, unit), unit, declared)
            if name in self.source.stated:
                from mechsim.io.toml_stated import as_stated

                dimension = as_stated(values, dimension)
            dimensions[name] = dimension
        return Parameters(dimensions, parameter_dependencies(document), document.get("intended_use", ""))


def has_forces(read: Mapping[str, Any]) -> bool:
    """Whether a file has forces, friction or clearance of joints, or teeth or an efficiency of couplings."""
    tables = (*read.get("joints", {}).values(), *read.get("couplings", {}).values())
    keys = {"friction", "clearance", "pressure_angle", "efficiency"}
    return "forces" in read or any(keys & {*table} for table in tables)


def has_curves(document: Mapping[str, Any]) -> bool:
    """Whether a file has curves or cams, or joints on them."""
    kinds = [row.get("kind") for row in tables_in(document, "joints")]
    return not {"curves", "cams"}.isdisjoint(document) or "curve" in kinds or "cam" in kinds


def tables_in(document: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """Return the tables of an entry of a file that is not checked."""
    entries = document.get(key)
    return [row for row in entries.values() if isinstance(row, dict)] if isinstance(entries, dict) else []


def mechanism_of(
    coordinates: FileCoordinates, drivers: tuple[str, ...], added: Sequence[Coupling] = ()
) -> Mechanism:
    """Return the mechanism that a file describes, with its drivers and the couplings of its curves."""
    source, read = coordinates.values.source, coordinates.read
    start, guess_coordinates = coordinates.start(drivers)
    gears, couplings = coordinates.couplings()
    mechanism = Mechanism(
        name=read["name"],
        links=tuple(links_of(source, read)),
        joints=tuple(joint_of(source, name, entry) for name, entry in read["joints"].items()),
        driver=drivers[0] if len(drivers) == 1 else drivers,
        points={
            name: (entry["link"], entry.get("at", (0.0, 0.0, 0.0)))
            for name, entry in read.get("points", {}).items()
        },
        gears=gears,
        guess={name: pose_of(source, name, entry) for name, entry in read.get("guess", {}).items()},
        start=start,
        couplings=(*couplings, *added),
        locked=coordinates.locked(drivers),
        guess_coordinates=guess_coordinates,
        up=read.get("display", {}).get("up") or _against_gravity(read),
    )
    if any(coupling.belt for coupling in couplings):
        from mechsim.mechanism.belts import belts_of

        # rejects pulleys that overlap
        list(belts_of(mechanism))
    return mechanism if "start" in read else _started_at_guess(mechanism)


def _started_at_guess(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose drivers start where the guess places both links of their joints."""
    placed = {GROUND: IDENTITY, **mechanism.guess}
    values = dict.fromkeys(mechanism.drivers, 0.0)
    for joint in mechanism.joints:
        if joint.a.link in placed and joint.b.link in placed and values.keys() & set(joint.coordinates):
            read = np.atleast_1d(joint_coordinate(joint, placed[joint.a.link], placed[joint.b.link])).tolist()
            own = dict(zip(joint.coordinates, read, strict=True))
            values |= {name: own[name] for name in values.keys() & own.keys()}
    if mechanism.has_crank:
        return replace(mechanism, start=values[mechanism.crank.name])
    return replace(mechanism, guess_coordinates={name: value for name, value in values.items() if value})


def formula_path(source: TomlSource, formula: str) -> str:
    """Return FILE.py:FUNCTION with the folder of the mechanism; a file elsewhere is not run."""
    folder, (file, _, _) = Path(source.path).parent, formula.rpartition(":")
    if not (folder / file).resolve().is_relative_to(folder.resolve()):
        raise source.error(
            ("formula", "python"),
            f"is {shown(formula)}, outside the folder of the mechanism; put it there or in a folder below",
        )
    return os.path.join(os.path.dirname(source.path), formula) if formula else ""


def _against_gravity(read: Mapping[str, Any]) -> Up | None:
    """Return the axis against the gravity of `[forces]`; None without that table."""
    if "forces" not in read:
        return None
    from mechsim.mechanism.forces import WEIGHT

    return against(read["forces"].get("gravity", WEIGHT.gravity))
