"""The mechanisms that come with mechsim: the gallery of TOML files, and a list with one sentence each."""

import re
from itertools import takewhile
from pathlib import Path

from mechsim.analytic import catalog

PACKAGE = Path(__file__).resolve().parents[1]


def folder() -> Path:
    """Return the folder of the gallery, in an installed package or in the source tree."""
    inside = PACKAGE / "gallery"
    return inside if inside.is_dir() else PACKAGE.parent / "models" / "gallery"


def files() -> dict[str, Path]:
    """Return the mechanisms of the gallery: name -> file."""
    return {path.stem: path for path in sorted(folder().glob("*.toml"))}


def description(path: Path) -> str:
    """Return the first sentence of the comment at the head of a gallery file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    head = takewhile(lambda line: line.startswith("# ") and not line.startswith("# Source:"), lines)
    text = " ".join(line.removeprefix("# ") for line in head)
    return re.split(r"[.;] ", text)[0].rstrip(".") + "."


def list() -> dict[str, dict[str, str]]:
    """Return the mechanisms that come with mechsim: catalogue and gallery, name -> description.

    Example:
        >>> sorted(ms.list())
        ['gallery', 'mechanisms']
    """
    return {
        "mechanisms": {name: (cls.__doc__ or "").splitlines()[0] for name, cls in catalog.MECHANISMS.items()},
        "gallery": {name: description(path) for name, path in files().items()},
    }
