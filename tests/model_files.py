"""Texts of the models in `tests/models/`."""

from pathlib import Path


def model_text(name: str) -> str:
    """Return the text of a file in `tests/models/`, named by the test file and the model."""
    return (Path(__file__).parent / "models" / name).read_text()
