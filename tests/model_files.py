"""Models in `tests/models/`: their texts, changed copies, and the mechanisms that they describe."""

import itertools
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from string import Template

import mechsim as ms
from mechsim.io import gallery
from mechsim.io.model_source import Prescription
from mechsim.io.toml_reader import TomlModel
from mechsim.io.toml_writer import to_toml

FOLDER = Path(__file__).parent / "models"
COPIES = tempfile.TemporaryDirectory(prefix="mechsim-tests-")
NUMBERS = itertools.count()


def model_text(name: str, **values: object) -> str:
    """Return the text of a file, with the values of its `${fields}`."""
    text = (FOLDER / name).read_text()
    return Template(text).substitute(values) if values else text


def replaced(text: str, changes: Iterable[Sequence[str]], count: int = -1) -> str:
    """Return a text in which pairs of old and new texts, each of which it contains, are replaced."""
    for old, new in changes:
        assert old in text, f"{old} is not in the text"
        text = text.replace(old, new, count)
    return text


def changed_text(source: str | list[str] | dict[str, str]) -> str:
    """Return a text, or that of the file `models/NAME`, changed.

    In a list, pairs of old and new texts follow the file. In a table, other keys are the `{fields}` of
    its `file`, empty by default.
    """
    if isinstance(source, dict):
        return model_text(source["file"].removeprefix("models/")).format_map(defaultdict(str, source))
    first, *changes = [source] if isinstance(source, str) else source
    text = model_text(first.removeprefix("models/")) if first.startswith("models/") else first
    return replaced(text, zip(changes[::2], changes[1::2], strict=True))


def catalog_text(name: str, **values: float) -> str:
    """Return the description of a mechanism of the catalogue, with its parameters, or of the gallery."""
    if name in ms.catalog.MECHANISMS:
        return to_toml(ms.catalog.make(name, **values))
    return (gallery.files() | gallery.machines())[name].read_text().split("[formula]")[0]


def copied(text: str, suffix: str = ".toml") -> str:
    """Return the path of a file with a text."""
    path = Path(COPIES.name) / f"model{next(NUMBERS)}{suffix}"
    path.write_text(text, "utf-8")
    return str(path)


def changed_model(name: str, *changes: tuple[str, str], more: str = "", **values: object) -> str:
    """Return the path of a copy of a model with replaced texts and more text at its end.

    A model is a file of `tests/models/`, or a name of the catalogue or the gallery.
    """
    suffix = Path(name).suffix
    text = model_text(name, **values) if suffix else catalog_text(name, **values)
    text += f"\n{more}" if more else ""
    return copied(replaced(text, changes, 1), suffix or ".toml")


def load_model(name: str, *changes: tuple[str, str], more: str = "", still: bool = False, **values: object):
    """Return the solver of a changed model; `still` needs no motion laws."""
    return ms.load(changed_model(name, *changes, more=more, **values), still=still)


def model_mechanism(name: str) -> ms.Mechanism:
    """Return the mechanism of a file, assembled at its start."""
    return ms.load(str(FOLDER / name)).mechanism


def stated_mechanism(name: str, **parameters: float) -> ms.Mechanism:
    """Return the mechanism that a file states, with changed parameters, whether or not its loops close."""
    return TomlModel(str(FOLDER / name)).describe(parameters, Prescription()).solver.mechanism
