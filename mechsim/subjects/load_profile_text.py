"""Loads written as text: numbers, expressions of t or of the crank angle, or tables in files."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.model.load_profile import WRITTEN, LoadProfile, Over, constant, function, table
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.subjects.motion_law_text import read_column
from mechsim.subjects.time_expressions import VARIABLES, time_function

_AXES: dict[str, Over] = {"t": "time", "time": "time", "angle": "angle"}
_VARIABLE = re.compile(rf"(?<![\w.])({'|'.join(VARIABLES)})(?!\w)")


@dataclass(frozen=True)
class LoadComponent:
    """A load along one axis.

    Attributes:
        text: its number, or the text by which a file in SI says the same.
        profile: its course, one number at each place.
    """

    text: float | str
    profile: LoadProfile


@dataclass(frozen=True)
class WrittenLoad:
    """The value of a load over time or angle, known by its text.

    Attributes:
        components: of one axis or of three.
    """

    components: tuple[LoadComponent, ...]

    def __call__(self, position: Array) -> Array:
        """Return the values at places (n,), (n,) or (n, 3)."""
        columns = [component.profile.at(position, position) for component in self.components]
        return columns[0] if len(columns) == 1 else np.stack(columns, 1)


def variables(text: str) -> list[str]:
    """Return which variables a text names: t, angle."""
    return sorted(set(_VARIABLE.findall(text)))


def is_profile(value: object) -> TypeGuard[str]:
    """Whether a value is text that says how a load goes over time or the crank's angle."""
    return isinstance(value, str) and (is_table(value) or bool(variables(value)))


def is_table(text: str) -> bool:
    """Whether a text names a file with a table."""
    return text.strip().lower().endswith(files.EXTENSIONS)


def parse_component(text: str, name: str, unit: str, parameters: Mapping[str, float]) -> LoadComponent:
    """Return what text that `varies` says of a load along one axis.

    Args:
        text: an expression of t in s or of the crank's angle in rad, or FILE.csv with columns t or angle,
            and value in SI; straight lines join its rows, and one turn of angles repeats.
        name: of the column in a file that has several.
        unit: "N" or "N m"; numbers without a unit are in it.
        parameters: parameter -> its number.

    Raises:
        InputError: for what is none of these; of an expression its sentence has no subject.
    """
    if is_table(text):
        axis, position, value = read_column(
            text, name, list(_AXES), "a load give two, t in s or angle in rad"
        )
        full_turn = axis == "angle" and abs(np.ptp(position) - TURN) < WRITTEN
        return LoadComponent(text, table(position, value, over=_AXES[axis], periodic=bool(full_turn)))
    names = variables(text)
    if len(names) > 1:
        raise InputError(f"names both {' and '.join(names)}; a load goes over one of them")
    (variable,) = names
    if variable in parameters:
        raise InputError(f"names {variable!r}, here a parameter, too; give the parameter another name")
    si_text, state = time_function(text, unit, parameters=parameters, variable=variable)
    return LoadComponent(si_text, function(lambda position: state(position)[0], over=_AXES[variable]))


def combine_components(components: Sequence[LoadComponent]) -> LoadProfile:
    """Return a load of one component or three.

    Raises:
        InputError: where some go over time and others over the angle; its sentence has no subject.
    """
    axes: set[Over] = {
        component.profile.over for component in components if component.profile.over is not None
    }
    if len(axes) > 1:
        raise InputError("goes over t in one component and over angle in another; give one for all")
    if not axes:
        numbers = [component.text for component in components]
        return constant(numbers[0] if len(numbers) == 1 else numbers)
    return LoadProfile(axes.pop(), WrittenLoad(tuple(components)), len(components))
