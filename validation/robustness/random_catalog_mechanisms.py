"""Catalogue mechanisms of random dimensions, good and bad: cranks that turn or swing, any transmission."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from mechsim import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.formulas import SELECTORS
from mechsim.errors import MechsimError
from mechsim.model.motion_laws import CrankProfile, interval_around, swing, within_range
from mechsim.numerics.angles import REVOLUTION

# sizes vary by this factor up and down, angles by this many radians
FACTOR, SPREAD = 1.6, 0.6
# a swing stays inside this part of the range
INSIDE = 0.95
SPEED = 20.0 * np.pi
# what is not dimension but kind
KEPT = (*SELECTORS, "gear_ratio")


def random_catalog_mechanisms(random: np.random.Generator, count: int) -> Iterator[ClosedForm]:
    """Yield mechanisms of each kind in turn that can be assembled and driven over most of their range."""
    for number in range(count):
        yield rough_drive(number, random)


def rough_drive(number: int, random: np.random.Generator) -> ClosedForm:
    """Return a mechanism whose kind follows from its number."""
    names = list(catalog.DRIVES)
    name = names[number % len(names)]
    while True:
        try:
            drive = catalog.make(name, **_values(name, random))
            if hasattr(drive, "guide") and random.random() < 0.3:
                drive = replace(drive, guide=True)
            profile = within_range(drive.mechanism, drive.crank_range(), SPEED)
            drive.solve(profile.state(np.linspace(0.0, profile.duration, 73))[0])
            return drive
        except MechsimError:
            continue


def _values(name: str, random: np.random.Generator) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for parameter, field in catalog.parameters(name).items():
        if parameter in KEPT or "options" in field.metadata or field.metadata["unit"] not in ("rad", "m"):
            continue
        default = np.asarray(field.default, dtype=np.float64)
        if field.metadata["unit"] == "rad":
            changed = default + random.uniform(-SPREAD, SPREAD, default.shape)
        else:
            changed = default * FACTOR ** random.uniform(-1.0, 1.0, default.shape)
        values[parameter] = changed.item() if changed.ndim == 0 else tuple(changed.tolist())
    return values


def rough_swing(drive: ClosedForm, random: np.random.Generator) -> CrankProfile:
    """Return a swing anywhere inside the range of a drive, on any lap on which its linkage is the same."""
    arcs, start = drive.crank_range(), drive.mechanism.start
    low, high = (
        (start - np.pi, start + np.pi) if arcs.full else interval_around(arcs, start) or (start, start)
    )
    low, high = (low + high) / 2.0 + INSIDE * (high - low) / 2.0 * np.array([-1.0, 1.0])
    middle = random.uniform(low, high)
    reach = min(middle - low, high - middle) * random.uniform(0.1, 1.0)
    laps = 0 if getattr(drive, "gear_ratio", 0.0) % 1.0 else int(random.integers(-3, 4))
    return swing(middle + REVOLUTION * laps, reach, SPEED)


def close_swing(drive: ClosedForm, random: np.random.Generator, nearest: float) -> CrankProfile | None:
    """Return a swing that ends from 0.1 rad to so near a dead centre; None where the crank turns fully."""
    arcs = drive.crank_range()
    around = interval_around(arcs, drive.mechanism.start)
    if arcs.full or around is None:
        return None
    low, high = around
    reach = min(0.25 * (high - low), 0.5)
    # a range may be shorter than that
    off = min(nearest * (0.1 / nearest) ** random.random(), reach)
    return swing(high - off - reach if random.random() < 0.5 else low + off + reach, reach, SPEED)
