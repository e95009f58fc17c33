"""The catalogue: mechanisms described by models/NAME.toml, with their formulas in models/NAME.py."""

import difflib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from mechsim.errors import InputError
from mechsim.io.formula_file import FormulaFile, mechanism_in
from mechsim.io.toml_reader import TomlModel
from mechsim.kinematics.formulas.parameters import FormulaParameter
from mechsim.kinematics.solvers import KinematicSolver

PACKAGE = Path(__file__).resolve().parents[1]
MECHANISMS = ("four_bar", "slider_crank", "rssr", "rrsrr", "warp_knitter", "looper", "bennett")


def models() -> Path:
    """Return the folder of the mechanisms that come with mechsim, in a package or in its sources."""
    inside = PACKAGE / "models"
    return inside if inside.is_dir() else PACKAGE.parent / "models"


@cache
def mechanism(name: str) -> FormulaFile:
    """Return a mechanism of `MECHANISMS`, whose file is read when it is first asked for."""
    return mechanism_in(TomlModel(str(models() / f"{name}.toml")).source)


def make(name: str, /, **values: Any) -> KinematicSolver:
    """Return a catalogue mechanism with some parameters changed from their defaults.

    Args:
        name: of the mechanism, such as "four_bar"; `mechsim.list()` has all.
        values: lengths in [m], angles in [rad], or text with a unit, such as "14mm"; named as
            in `parameters`.

    Raises:
        InputError: for an unknown name or parameter (with the nearest known one), or an invalid value.
    """
    parameters(name)
    return mechanism(name).make(values)


def parameters(name: str) -> Mapping[str, FormulaParameter]:
    """Return the parameters of a mechanism by name, with default, unit and meaning.

    Raises:
        InputError: for an unknown name, with the nearest known one.
    """
    if str(name) not in MECHANISMS:
        raise InputError(f"there is no mechanism {name!r}{nearest(str(name), list(MECHANISMS))}")
    return mechanism(name).rows


# names that an error message lists
MAX_LISTED = 16


def nearest(name: str, names: list[str]) -> str:
    """Return the end of an error message: the most similar name, and all names, or how to list many."""
    close = difflib.get_close_matches(name, names)
    similarity = {close_name: difflib.SequenceMatcher(None, close_name, name).ratio() for close_name in close}
    # of equally similar names the first is suggested
    best = max(sorted(close, key=names.index), key=similarity.__getitem__, default="")
    hint = f"; did you mean {best!r}? " if best else "; "
    listed = ", ".join(names) if len(names) <= MAX_LISTED else "the names that `mechsim list` prints"
    return f"{hint}choose from {listed}"
