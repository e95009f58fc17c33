"""The catalogue: mechanisms with a closed form, one file each."""

import difflib
from dataclasses import Field, fields
from typing import Any

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.bennett import Bennett
from mechsim.analytic.catalog.formulas import parameter_value
from mechsim.analytic.catalog.four_bar import FourBar
from mechsim.analytic.catalog.looper import Looper
from mechsim.analytic.catalog.rrsrr import Rrsrr
from mechsim.analytic.catalog.rssr import Rssr
from mechsim.analytic.catalog.slider_crank import SliderCrank
from mechsim.analytic.catalog.warp_knitter import WarpKnitter
from mechsim.errors import InputError

MECHANISMS: dict[str, type[ClosedForm]] = {
    solver.declaration.name: solver
    for solver in (FourBar, SliderCrank, Rssr, Rrsrr, WarpKnitter, Looper, Bennett)
}


def make(name: str, /, **values: Any) -> ClosedForm:
    """Return a catalogue mechanism with some parameters changed from their defaults.

    Args:
        name: of the mechanism, such as "four_bar"; `mechsim.list()` has all.
        values: lengths in [m], angles in [rad], or text with a unit, such as "14mm"; named as the fields of
            the class.

    Raises:
        InputError: for an unknown name or parameter (with the nearest known one), or an invalid value.
    """
    fields_of = parameters(name)
    for parameter in values:
        if parameter not in fields_of:
            raise InputError(f"{name} has no parameter {parameter!r}{nearest(parameter, list(fields_of))}")
    return MECHANISMS[name](
        **{key: parameter_value(name, fields_of[key], key, value) for key, value in values.items()}
    )


def parameters(name: str) -> dict[str, Field[Any]]:
    """Return the parameters of a mechanism: name -> field, whose metadata has its unit and description.

    Raises:
        InputError: for an unknown name, with the nearest known one.
    """
    if str(name) not in MECHANISMS:
        raise InputError(f"there is no mechanism {name!r}{nearest(str(name), list(MECHANISMS))}")
    # the change-point policy comes last, since it is no dimension
    ordered = sorted(fields(MECHANISMS[name]), key=lambda field: field.name == "change_point")
    return {field.name: field for field in ordered}


def with_theory(theory: str) -> str:
    """Return the names of the mechanisms for which a theory exists, as text."""
    return ", ".join(
        name for name, mechanism in MECHANISMS.items() if theory in mechanism.declaration.theories
    )


# names that an error message lists
MAX_LISTED = 16


def nearest(name: str, names: list[str]) -> str:
    """Return the end of an error message: the most similar name, and all names, or how to list many."""
    close = difflib.get_close_matches(name, names)
    # of equally similar names the first is suggested
    similarity = {
        candidate: difflib.SequenceMatcher(None, candidate, name).ratio()
        for candidate in names
        if candidate in close
    }
    hint = f"; did you mean {max(similarity, key=similarity.__getitem__)!r}? " if similarity else "; "
    listed = ", ".join(names) if len(names) <= MAX_LISTED else "the names that `mechsim list` prints"
    return f"{hint}choose from {listed}"
