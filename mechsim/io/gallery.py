"""The mechanisms that come with mechsim: gallery and machines, and a list with one sentence each."""

from pathlib import Path

from mechsim.io import catalog
from mechsim.io.toml_values import head_comment


def folder() -> Path:
    """Return the folder of the gallery."""
    return catalog.models() / "gallery"


def files() -> dict[str, Path]:
    """Return the mechanisms of the gallery: name -> file."""
    return {path.stem: path for path in sorted(folder().glob("*.toml"))}


def machines() -> dict[str, Path]:
    """Return the machines, whose forces and known answers serve dynamics: name -> file."""
    return {path.stem: path for path in sorted((catalog.models() / "machines").glob("*.toml"))}


def named() -> dict[str, Path]:
    """Return the files of gallery and machines by the names that a model may have: name -> file."""
    return {**files(), **machines()}


def list() -> dict[str, dict[str, str]]:
    """Return the mechanisms that come with mechsim: catalogue, gallery and machines, name -> description.

    Example:
        >>> sorted(ms.list())
        ['gallery', 'machines', 'mechanisms']
    """
    mechanisms = {name: catalog.models() / f"{name}.toml" for name in catalog.MECHANISMS}
    groups = {"mechanisms": mechanisms, "gallery": files(), "machines": machines()}
    return {
        group: {name: head_comment(str(path)) for name, path in paths.items()}
        for group, paths in groups.items()
    }
