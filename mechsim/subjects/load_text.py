"""A load as people write it: numbers, expressions of t or of the crank's angle, or tables in files."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.load_profile import WRITTEN, LoadProfile, Over, constant, function, table
from mechsim.subjects.program_text import column
from mechsim.subjects.time_expressions import VARIABLES, over_time

_OVER: dict[str, Over] = {"t": "time", "time": "time", "angle": "angle"}
_VARIABLE = re.compile(rf"(?<![\w.])({'|'.join(VARIABLES)})(?!\w)")


@dataclass(frozen=True)
class Component:
    """A load along one axis.

    Attributes:
        text: its number, or the text by which a file in SI says the same.
        profile: its course, one number at each place.
    """

    text: float | str
    profile: LoadProfile


@dataclass(frozen=True)
class LoadText:
    """The value of a load over time or angle, known by its text.

    Attributes:
        parts: of one axis or of three.
    """

    parts: tuple[Component, ...]

    def __call__(self, at: Array) -> Array:
        """Return the values at places (n,), (n,) or (n, 3)."""
        columns = [part.profile.at(at, at) for part in self.parts]
        return columns[0] if len(columns) == 1 else np.stack(columns, 1)


def variables(text: str) -> list[str]:
    """Return which variables a text names: t, angle."""
    return sorted(set(_VARIABLE.findall(text)))


def varies(value: object) -> TypeGuard[str]:
    """Whether a value is text that says how a load goes over time or the crank's angle."""
    return isinstance(value, str) and (is_table(value) or bool(variables(value)))


def is_table(text: str) -> bool:
    """Whether a text names a file with a table."""
    return text.strip().lower().endswith(files.EXTENSIONS)


def component(text: str, name: str, unit: str, names: Mapping[str, float]) -> Component:
    """Return what text that `varies` says of a load along one axis.

    Args:
        text: an expression of t in s or of the crank's angle in rad, or FILE.csv with columns t or angle,
            and value in SI; straight lines join its rows, and one turn of angles repeats.
        name: of the column in a file that has several.
        unit: "N" or "N m"; numbers without a unit are in it.
        names: parameter -> its number.

    Raises:
        InputError: for what is none of these; of an expression its sentence has no subject.
    """
    if is_table(text):
        over, at, value = column(text, name, list(_OVER), "a load give two, t in s or angle in rad")
        turn = over == "angle" and abs(np.ptp(at) - TURN) < WRITTEN
        return Component(text, table(at, value, over=_OVER[over], periodic=bool(turn)))
    found = variables(text)
    if len(found) > 1:
        raise InputError(f"names both {' and '.join(found)}; a load goes over one of them")
    (variable,) = found
    if variable in names:
        raise InputError(f"names {variable!r}, here a parameter, too; give the parameter another name")
    whole, state = over_time(text, unit, names=names, variable=variable)
    return Component(whole, function(lambda at: state(at)[0], over=_OVER[variable]))


def load_of(parts: Sequence[Component]) -> LoadProfile:
    """Return a load of one component or three.

    Raises:
        InputError: where some go over time and others over the angle; its sentence has no subject.
    """
    over: set[Over] = {part.profile.over for part in parts if part.profile.over is not None}
    if len(over) > 1:
        raise InputError("goes over t in one component and over angle in another; give one for all")
    if not over:
        numbers = [part.text for part in parts]
        return constant(numbers[0] if len(numbers) == 1 else numbers)
    return LoadProfile(over.pop(), LoadText(tuple(parts)), len(parts))
