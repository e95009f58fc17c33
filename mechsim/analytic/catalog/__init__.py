"""The catalogue: mechanisms with a closed form, one file each."""

import difflib
from dataclasses import Field, fields
from typing import Any

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.bennett import Bennett
from mechsim.analytic.catalog.four_bar import FourBar
from mechsim.analytic.catalog.looper import Looper
from mechsim.analytic.catalog.parameter_checks import parameter_value
from mechsim.analytic.catalog.rrsrr import Rrsrr
from mechsim.analytic.catalog.rssr import Rssr
from mechsim.analytic.catalog.slider_crank import SliderCrank
from mechsim.analytic.catalog.warp_knitter import WarpKnitter
from mechsim.errors import InputError

DRIVES: dict[str, type[ClosedForm]] = {
    drive.name: drive for drive in (FourBar, SliderCrank, Rssr, Rrsrr, WarpKnitter, Looper, Bennett)
}


def make(name: str, /, **values: Any) -> ClosedForm:
    """Return a catalogue mechanism with some parameters changed from their defaults.

    Args:
        name: as listed in `DRIVES`.
        values: lengths in [m], angles in [rad], or text with a unit, as "14mm"; names as the class declares
            them.

    Raises:
        InputError: for an unknown name or parameter (with the nearest known one) or a bad value.
    """
    known = parameters(name)
    for parameter in values:
        if parameter not in known:
            raise InputError(f"{name} has no parameter {parameter!r}{nearest(parameter, list(known))}")
    given = {one: parameter_value(name, known[one], one, value) for one, value in values.items()}
    return DRIVES[name](**given)


def parameters(name: str) -> dict[str, Field[Any]]:
    """Return the parameters of a mechanism: name -> field with default and, in its metadata, unit and doc.

    Raises:
        InputError: for an unknown name, with the nearest known one.
    """
    if str(name) not in DRIVES:
        raise InputError(f"there is no mechanism {name!r}{nearest(str(name), list(DRIVES))}")
    # how change points are passed stands last: it is no dimension
    known = sorted(fields(DRIVES[name]), key=lambda field: field.name == "change_point")
    return {field.name: field for field in known}


def with_theory(theory: str) -> str:
    """Return the names of the mechanisms that a theory is about, as text."""
    return ", ".join(name for name, drive in DRIVES.items() if theory in drive.theories)


def nearest(name: str, known: list[str]) -> str:
    """Return the tail of a sentence that says what was probably meant."""
    close = difflib.get_close_matches(name, known)
    # of names that are as near the first is meant
    alike = {one: difflib.SequenceMatcher(None, one, name).ratio() for one in known if one in close}
    meant = f"; did you mean {max(alike, key=alike.__getitem__)!r}? " if alike else "; "
    return f"{meant}known are {', '.join(known)}"
