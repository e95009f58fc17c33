"""Models in `tests/models/`: their texts, and the mechanisms that they describe."""

from pathlib import Path
from string import Template

import mechsim as ms
from mechsim.io.model_source import Prescription
from mechsim.io.toml_reader import TomlModel

FOLDER = Path(__file__).parent / "models"


def model_text(name: str, **values: object) -> str:
    """Return the text of a file, with the values of its `${fields}`."""
    text = (FOLDER / name).read_text()
    return Template(text).substitute(values) if values else text


def changed_text(source: str | list[str]) -> str:
    """Return a text or that of the file `models/NAME`; pairs of old and new texts may follow."""
    first, *changes = [source] if isinstance(source, str) else source
    text = model_text(first.removeprefix("models/")) if first.startswith("models/") else first
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text, f"{old} is not in {first}"
        text = text.replace(old, new)
    return text


def model_mechanism(name: str) -> ms.Mechanism:
    """Return the mechanism of a file, assembled at its start."""
    return ms.load(str(FOLDER / name)).mechanism


def stated_mechanism(name: str, **parameters: float) -> ms.Mechanism:
    """Return the mechanism that a file states, with changed parameters, whether or not its loops close."""
    return TomlModel(str(FOLDER / name)).describe(parameters, Prescription()).solver.mechanism
