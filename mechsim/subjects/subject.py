"""What a command is given, made into what moves: a catalogue name, FILE.toml or FILE.py:OBJECT."""

from collections.abc import Mapping

from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.subjects.catalog_object import read_catalog
from mechsim.subjects.python_object import read_python
from mechsim.subjects.toml_reader import read_toml


def is_file(model: str) -> bool:
    """Whether a model is meant as a file: by its ending alone, so that no file shadows a catalogue name."""
    return model.lower().endswith((".toml", ".xml", ".py")) or ".py:" in model


def load(model: str, changed: Mapping[str, str] | None = None) -> Form:
    """Return what moves.

    Args:
        model: a catalogue name, FILE.toml, or FILE.py:OBJECT, a Mechanism, a catalogue object, or a function
            without arguments that returns one. The Python file is run.
        changed: parameter -> its value as text, as `--set` takes it; bare numbers are in the file's units.

    Raises:
        InputError: for what is none of these; names the file, the line, the value and the remedy.
    """
    given = dict(changed or {})
    if not is_file(model):
        return read_catalog(model, given)
    if model.lower().endswith(".toml"):
        return read_toml(model, given)
    if model.lower().endswith(".xml"):
        raise InputError(f"{model}: MJCF is not read by this command; give FILE.toml or a catalogue name")
    if given:
        raise InputError(f"{model}: an object in a Python file has no parameters; leave out --set")
    return read_python(model)
