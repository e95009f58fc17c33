"""Models in `tests/models/`: their texts, and the mechanisms that they describe."""

from pathlib import Path
from string import Template

import mechsim as ms

FOLDER = Path(__file__).parent / "models"


def model_text(name: str, **values: object) -> str:
    """Return the text of a file, with the values of its `${fields}`."""
    text = (FOLDER / name).read_text()
    return Template(text).substitute(values) if values else text


def model_mechanism(name: str) -> ms.Mechanism:
    """Return the mechanism of a file, assembled at its start."""
    return ms.load(str(FOLDER / name)).mechanism
