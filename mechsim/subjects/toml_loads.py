"""Loads of a TOML file: numbers, or how they go over time or the crank's angle."""

from collections.abc import Sequence

from mechsim.errors import InputError
from mechsim.model.load_profile import LoadProfile, constant
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.checked_values import Values
from mechsim.subjects.load_profile_text import LoadComponent, combine_components, is_table, parse_component
from mechsim.subjects.toml_source import KeyPath, shown

Written = float | str


def load_profile_of(
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
    single = len(written) == 1
    components = [
        _component(values, mechanism, component, name, unit, path if single else (*path, i))
        for i, (name, component) in enumerate(zip(("crank",) if single else "xyz", written, strict=True))
    ]
    try:
        return combine_components(components)
    except InputError as error:
        raise values.source.error(path, str(error)) from None


def _component(
    values: Values, mechanism: Mechanism, written: Written, name: str, unit: str, path: KeyPath
) -> LoadComponent:
    if not isinstance(written, str):
        return LoadComponent(written, constant(written))
    from_file = is_table(written)
    try:
        text = values.source.sibling(written) if from_file else written
        component = parse_component(text, name, unit, values.parameters)
    except InputError as error:
        link = ": " if from_file else ", which "
        raise values.source.error(path, f"is {shown(written)}{link}{error}") from None
    if component.profile.over == "angle" and not mechanism.has_crank:
        drivers = ", ".join(mechanism.drivers)
        reason = f"is {shown(written)}, but no crank has an angle where {drivers} drive; give it over t"
        raise values.source.error(path, reason)
    return component
