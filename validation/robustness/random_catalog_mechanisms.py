"""Catalogue mechanisms of random dimensions: rotating or swinging cranks, any transmission angle."""

from typing import Any

import numpy as np

from mechsim import catalog
from mechsim.errors import MechsimError
from mechsim.kinematics.formulas.closed_form import SELECTORS
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import CrankProfile, interval_around, swing, within_range
from mechsim.numerics.arrays import REVOLUTION

# lengths vary by this factor, angles by this value in [rad]
FACTOR, ANGLE_SPREAD = 1.6, 0.6
# a swing stays inside this fraction of the range
RANGE_FRACTION = 0.95
SPEED = 20.0 * np.pi
# parameters that are not dimensions
FIXED = (*SELECTORS, "gear_ratio")


def random_mechanism(number: int, random: np.random.Generator) -> KinematicSolver:
    """Return a mechanism whose kind follows from its number, assembled over most of its range."""
    names = list(catalog.MECHANISMS)
    name = names[number % len(names)]
    while True:
        try:
            solver = catalog.make(name, **random_dimensions(name, random))
            if hasattr(solver, "guide") and random.random() < 0.3:
                solver = solver.with_parameters(guide=True)
            profile = within_range(solver.mechanism, solver.crank_range(), SPEED)
            solver.solve(profile.state(np.linspace(0.0, profile.duration, 73))[0])
            return solver
        except MechsimError:
            continue


def well_conditioned(name: str, random: np.random.Generator) -> KinematicSolver:
    """Return a mechanism of a kind that turns fully, with a transmission angle above 20 degrees."""
    while True:
        try:
            solver = catalog.make(name, **random_dimensions(name, random, 1.25, 0.25))
            angles = np.linspace(0.0, REVOLUTION, 181)
            if solver.crank_range().full and solver.transmission_angle(angles).min() > np.deg2rad(20.0):
                return solver
        except MechsimError:
            continue


def random_dimensions(
    name: str, random: np.random.Generator, factor: float = FACTOR, spread: float = ANGLE_SPREAD
) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for parameter, row in catalog.parameters(name).items():
        if parameter in FIXED or row.options or row.unit not in ("rad", "m"):
            continue
        default = np.asarray(row.default, dtype=np.float64)
        if row.unit == "rad":
            value = default + random.uniform(-spread, spread, default.shape)
        else:
            value = default * factor ** random.uniform(-1.0, 1.0, default.shape)
        values[parameter] = value.item() if value.ndim == 0 else tuple(value.tolist())
    return values


def random_swing(solver: KinematicSolver, random: np.random.Generator) -> CrankProfile:
    """Return a swing inside the crank range, on any revolution with the same linkage configuration."""
    limits, start = solver.crank_range(), solver.mechanism.start
    low, high = (
        (start - np.pi, start + np.pi) if limits.full else interval_around(limits, start) or (start, start)
    )
    low, high = (low + high) / 2.0 + RANGE_FRACTION * (high - low) / 2.0 * np.array([-1.0, 1.0])
    middle = random.uniform(low, high)
    amplitude = min(middle - low, high - middle) * random.uniform(0.1, 1.0)
    revolutions = 0 if getattr(solver, "gear_ratio", 0.0) % 1.0 else int(random.integers(-3, 4))
    return swing(middle + REVOLUTION * revolutions, amplitude, SPEED)


def swing_near_dead_centre(
    solver: KinematicSolver, random: np.random.Generator, nearest: float
) -> CrankProfile | None:
    """Return a swing that ends between `nearest` and 0.1 rad from a dead centre; None for a full range."""
    limits = solver.crank_range()
    interval = interval_around(limits, solver.mechanism.start)
    if limits.full or interval is None:
        return None
    low, high = interval
    amplitude = min(0.25 * (high - low), 0.5)
    # the range may be shorter
    distance = min(nearest * (0.1 / nearest) ** random.random(), amplitude)
    return swing(
        high - distance - amplitude if random.random() < 0.5 else low + distance + amplitude, amplitude, SPEED
    )
