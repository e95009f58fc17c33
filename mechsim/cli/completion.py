"""What a shell offers at the Tab key: mechanisms, files, parameters. Nothing is solved for it."""

import sys
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

from mechsim.analytic import catalog
from mechsim.subjects import gallery
from mechsim.subjects.model_source import READERS


def models(incomplete: str) -> list[str]:
    """Return mechanisms, and folders and files that may be one."""
    names = [name for name in (*catalog.DRIVES, *gallery.files()) if name.startswith(incomplete)]
    return names + _paths(incomplete, tuple(suffix for reader in READERS for suffix in reader.suffixes))


def files(incomplete: str) -> list[str]:
    """Return folders and files."""
    return _paths(incomplete, ())


def parameters(ctx: Any, incomplete: str) -> list[str]:
    """Return the parameters of the mechanism that was named, with their equals sign."""
    model = ctx.params.get("model") or next((word for word in sys.argv[2:] if not word.startswith("-")), "")
    return [f"{name}=" for name in _parameters(str(model)) if name.startswith(incomplete)]


def _parameters(model: str) -> list[str]:
    if model in catalog.DRIVES:
        return [field.name for field in fields(catalog.DRIVES[model])]
    path = gallery.files().get(model, Path(model))
    if path.suffix.lower() != ".toml":
        return []
    try:
        read = tomllib.loads(path.read_text(encoding="utf-8")).get("parameters", {})
    except (OSError, ValueError):
        return []
    return list(read) if isinstance(read, dict) else []


def _paths(incomplete: str, suffixes: tuple[str, ...]) -> list[str]:
    folder, _, start = incomplete.rpartition("/")
    paths: list[str] = []
    try:
        entries = sorted(Path(f"{folder}/" if "/" in incomplete else ".").iterdir())
    except OSError:
        return []
    for path in entries:
        hidden = path.name.startswith(".") and not start.startswith(".")
        if not path.name.startswith(start) or hidden:
            continue
        shown = f"{folder}/{path.name}" if "/" in incomplete else path.name
        if path.is_dir():
            paths.append(f"{shown}/")
        elif not suffixes or path.suffix.lower() in suffixes:
            paths.append(shown)
    return paths
