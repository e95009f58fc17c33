"""The gallery: known mechanisms in TOML that come with the package, each with its source and its law."""

import re
from pathlib import Path

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
    lines: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("# ") or line.startswith("# Source:"):
            break
        lines.append(line.removeprefix("# "))
    return re.split(r"[.;] ", " ".join(lines))[0].rstrip(".") + "."
