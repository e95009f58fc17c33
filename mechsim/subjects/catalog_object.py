"""A mechanism of the catalogue with parameters given as text."""

from collections.abc import Mapping

from mechsim.analytic import catalog
from mechsim.analytic.catalog.base import ClosedForm


def read_catalog(name: str, changed: Mapping[str, str]) -> ClosedForm:
    """Return a catalogue mechanism with some parameters changed.

    Args:
        name: of the mechanism.
        changed: parameter -> its value as text; bare numbers are in SI.

    Raises:
        InputError: for an unknown name or parameter (with the nearest known one) or a bad value.
    """
    return catalog.make(name, **changed)
