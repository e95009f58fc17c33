"""Planar linkages in JSON, as other programs write them: linkage_sim, pylinkage and PMKS.

Each format is a file with a function from the content to a `Mechanism`, and a row of FORMATS. Lengths without
a unit are in [m]. Links have the frame of the ground at the start, except those of linkage_sim.
"""

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.errors import InputError, cut
from mechsim.files import read_text
from mechsim.io.toml_values import MAX_DIGITS, MAX_SHOWN, shown
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Vector


@dataclass(frozen=True)
class Format:
    """A JSON format.

    Attributes:
        software: the software that writes it.
        keys: keys on the first level of its files.
        module: module with the function `mechanism` that reads it, the keys READ, and the keys NAMED of
            objects whose keys are names.
    """

    software: str
    keys: frozenset[str]
    module: str

    def read(self, name: str, content: Mapping[str, Any]) -> KinematicSolver:
        """Return the mechanism, and sentences on what was not read."""
        module = import_module(self.module)
        unread = dict.fromkeys(_unread(content, module.READ.split(), module.NAMED))
        facts = [f"{key} is not read" for key in unread]
        return KinematicSolver(module.mechanism(name, content), facts=tuple(facts))


def _unread(content: Mapping[str, Any], read: Collection[str], named: Collection[str]) -> Iterator[str]:
    """Yield the keys at all depths that are not in `read`, with the keys that contain them."""
    for key, value in content.items():
        if key not in read:
            yield cut(key, MAX_SHOWN)
            continue
        objects = value.values() if key in named and isinstance(value, dict) else value
        for entry in objects if isinstance(objects, list | type({}.values())) else [objects]:
            if isinstance(entry, dict):
                yield from (f"{key}.{inner}" for inner in _unread(entry, read, named))


FORMATS = (
    Format("linkage_sim", frozenset({"bodies", "joints"}), "mechsim.io.linkage_sim_json"),
    Format("pylinkage", frozenset({"links", "joints"}), "mechsim.io.pylinkage_json"),
    Format("PMKS", frozenset({"Joints"}), "mechsim.io.pmks_json"),
)


def read_json(path: str) -> KinematicSolver:
    """Return the mechanism of a file with a planar linkage."""
    written = read_text(path, "a JSON file with a linkage")
    try:
        content = json.loads(written)
    except (json.JSONDecodeError, RecursionError) as error:
        line = f", line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}{line} is no JSON; correct it") from None
    except ValueError:  # Python reads no integer of more digits
        raise InputError(f"{path} has a number of over {MAX_DIGITS} digits; shorten it") from None
    content = content if isinstance(content, dict) else {}
    for file_format in FORMATS:
        if file_format.keys <= content.keys():
            return file_format.read(Path(path).stem, content)
    keys = "; ".join(f"{', '.join(sorted(entry.keys))} ({entry.software})" for entry in FORMATS)
    raise InputError(f"{path} holds no linkage that is known; its first level needs {keys}")


def entries(content: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    """Return a list of objects."""
    listed = content.get(key)
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise InputError(f"{key} is no list of objects; write {key}: [{{...}}]")
    return listed


def text(entry: Mapping[str, Any], key: str, what: str) -> str:
    """Return a name of an entry."""
    value = entry.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{what} has no {key}; give a name")
    return value


def point(value: Any, what: str) -> tuple[float, float]:
    """Return two finite numbers."""
    try:
        x, y = (float(number) for number in value)
    except (TypeError, ValueError, OverflowError):
        x = y = np.nan
    if not np.isfinite([x, y]).all():
        raise InputError(f"{what} is {shown(value)}; give two finite numbers")
    return x, y


def in_plane(position: Sequence[float]) -> Vector:
    """Return a point or direction of the plane z = 0."""
    return position[0], position[1], 0.0


def pins(name: str, links: Sequence[str], position: tuple[float, float]) -> list[Joint]:
    """Return the revolute joints by which a pin joins links that have the frame of the ground."""
    first, *others = sorted(links, key=lambda link: link != GROUND)
    names = [name, *(f"{name}_{link}" for link in others[1:])]
    first_end, *ends = (End(link, in_plane(position)) for link in (first, *others))
    return [Joint(own, "revolute", first_end, end) for own, end in zip(names, ends, strict=False)]


def slide(
    name: str, first: str, second: str, position: tuple[float, float], direction: tuple[float, float]
) -> Joint:
    """Return a prismatic joint between links that have the frame of the ground."""
    first_end, second_end = (
        End(link, in_plane(position), in_plane(direction), (0.0, 0.0, 1.0)) for link in (first, second)
    )
    return Joint(name, "prismatic", first_end, second_end)
