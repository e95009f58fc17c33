"""Catalogue mechanisms of random sound dimensions, for the studies."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from mechsim import catalog
from mechsim.errors import MechsimError
from mechsim.kinematics.formulas.closed_form import SELECTORS
from mechsim.kinematics.solvers import KinematicSolver

# sizes vary by this factor up and down, angles by this many radians
FACTOR, REVOLUTION = 1.25, 0.25
# what is not dimension but kind
KEPT = (*SELECTORS, "gear_ratio")
# a sound linkage keeps its transmission angle above this, in [rad]
SOUND = np.deg2rad(20.0)


def drives(random: np.random.Generator, count: int, only: str | None = None) -> Iterator[KinematicSolver]:
    """Yield mechanisms that turn fully and stay clear of dead centres, of one kind or each in turn."""
    names = [only] if only else list(catalog.MECHANISMS)
    for i in range(count):
        yield sound(names[i % len(names)], random)


def sound(name: str, random: np.random.Generator) -> KinematicSolver:
    """Return one mechanism of a kind, drawn until it turns fully and its transmission is sound."""
    while True:
        try:
            linkage = catalog.make(name, **_values(name, random))
            angles = np.linspace(0.0, 2.0 * np.pi, 181)
            if linkage.crank_range().full and linkage.transmission_angle(angles).min() > SOUND:
                return linkage
        except MechsimError:
            continue


def _values(name: str, random: np.random.Generator) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for parameter, row in catalog.parameters(name).items():
        if parameter in KEPT or row.options:
            continue
        default = np.asarray(row.default, dtype=np.float64)
        if row.unit == "rad":
            changed = default + random.uniform(-REVOLUTION, REVOLUTION, default.shape)
        else:
            changed = default * FACTOR ** random.uniform(-1.0, 1.0, default.shape)
        values[parameter] = changed.item() if changed.ndim == 0 else tuple(changed.tolist())
    return values
