"""Texts of the models in `tests/models/`."""

from pathlib import Path
from string import Template


def model_text(name: str, **values: object) -> str:
    """Return the text of a file in `tests/models/`, with the values of its `${fields}`."""
    text = (Path(__file__).parent / "models" / name).read_text()
    return Template(text).substitute(values) if values else text
