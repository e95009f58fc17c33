"""Loads of a TOML file: numbers, or how they go over time or the crank's angle."""

from collections.abc import Sequence

from mechsim.errors import InputError
from mechsim.model.load_profile import LoadProfile, constant
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.checked_values import Values
from mechsim.subjects.load_text import Component, component, is_table, load_of
from mechsim.subjects.toml_source import KeyPath, shown

Written = float | str


def course_of(
    values: Values, mechanism: Mechanism, written: Sequence[Written], unit: str, path: KeyPath
) -> LoadProfile:
    """Return the course of a load.

    Args:
        values: what reads the file.
        mechanism: on which it acts.
        written: of the crank's torque one component, else three, as checked by a key `Course`.
        unit: "N" or "N m".
        path: of its key.

    Raises:
        InputError: for text that says no load; names file, line, key, value and remedy.
    """
    alone = len(written) == 1
    parts = [
        _component(values, mechanism, one, name, unit, path if alone else (*path, i))
        for i, (name, one) in enumerate(zip(("crank",) if alone else "xyz", written, strict=True))
    ]
    try:
        return load_of(parts)
    except InputError as error:
        raise values.source.refusal(path, str(error)) from None


def _component(
    values: Values, mechanism: Mechanism, written: Written, name: str, unit: str, path: KeyPath
) -> Component:
    if not isinstance(written, str):
        return Component(written, constant(written))
    tabled = is_table(written)
    try:
        text = values.source.beside(written) if tabled else written
        found = component(text, name, unit, values.parameters)
    except InputError as error:
        joined = ": " if tabled else ", which "
        raise values.source.refusal(path, f"is {shown(written)}{joined}{error}") from None
    if found.profile.over == "angle" and not mechanism.has_crank:
        drivers = ", ".join(mechanism.drivers)
        why = f"is {shown(written)}, but no crank has an angle where {drivers} drive; give it over t"
        raise values.source.refusal(path, why)
    return found
