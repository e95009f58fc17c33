"""What a command is given, made into what moves: a name, FILE.toml or FILE.py:OBJECT."""

import os
from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches

from mechsim.analytic import catalog
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.subjects import gallery
from mechsim.subjects.catalog_object import read_catalog
from mechsim.subjects.python_object import read_python
from mechsim.subjects.toml_reader import read_toml


def is_file(model: str) -> bool:
    """Whether a model is meant as a file: by its ending alone, so that no file shadows a known name."""
    return model.lower().endswith((".toml", ".xml", ".py")) or ".py:" in model


def load(model: str, changed: Mapping[str, str] | None = None) -> Form:
    """Return what moves.

    Args:
        model: a name of the catalogue or the gallery, FILE.toml, or FILE.py:OBJECT, a Mechanism, a catalogue
            object, or a function without arguments that returns one. The Python file is run.
        changed: parameter -> its value as text, as `--set` takes it; bare numbers are in the file's units.

    Raises:
        InputError: for what is none of these; names the file, the line, the value and the remedy.
    """
    given = dict(changed or {})
    if not is_file(model):
        return _named(model, given)
    if model.lower().endswith(".toml"):
        return _toml(model, given)
    if model.lower().endswith(".xml"):
        raise InputError(f"{model}: MJCF is not read by this command; give FILE.toml or a catalogue name")
    if given:
        raise InputError(f"{model}: an object in a Python file has no parameters; leave out --set")
    return read_python(model)


def _named(name: str, given: Mapping[str, str]) -> Form:
    shown = gallery.files()
    if name in shown and name not in catalog.DRIVES:
        return _toml(str(shown[name]), given)
    # of two that are as near the catalogue's is meant
    if name not in catalog.DRIVES and not get_close_matches(name, catalog.DRIVES):
        raise InputError(f"there is no mechanism {name!r}{catalog.nearest(name, [*catalog.DRIVES, *shown])}")
    return read_catalog(name, given)


def _toml(path: str, given: Mapping[str, str]) -> Form:
    """Return the mechanism of a TOML file; the file of its formula is looked for beside it."""
    form = read_toml(path, given)
    beside = os.path.join(os.path.dirname(path), form.formula)
    return replace(form, formula=beside) if form.formula else form
