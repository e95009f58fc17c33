"""Intervals of a mechanism's joints within the tolerances of its dimensions."""

from collections.abc import Mapping
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.errors import InputError
from mechsim.model.design_arrays import side_numbers, structure
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.studies.certify.toml_intervals import toml_joint_radii
from mechsim.subjects.toml_reader import TomlModel

# fractions of a tolerance at which the quadratic through its ends and middle is checked
FRACTIONS = (-0.81, -0.62, -0.43, -0.24, 0.19, 0.38, 0.57, 0.76)
# largest deviation from the quadratic, relative to the largest change
DEPARTURE = 0.1
# safety factor of sampled quantities: deviations from the quadratic and joint effects of several dimensions
SAFETY = 2.0
# maximum number of corners of the tolerances at which all dimensions change
MAX_CORNERS = 64
# rounding error of points and axes relative to the largest value
ROUNDING = 1e-13


def radii_within(
    model: object, changed: Mapping[str, str | float], designs: DesignFamily, bounds: Mapping[str, float]
) -> dict[str, Array]:
    """Return the radii of `joint_radii`; for designs of a TOML file they come from interval arithmetic.

    Args:
        model: the opened model of these designs.
        changed: parameter -> its value, as `load` takes it.
        designs: the parametric model of the mechanism.
        bounds: dimension -> bound in SI.

    Raises:
        InputError: as in `joint_radii` and `toml_joint_radii`.
    """
    if isinstance(model, TomlModel) and {*designs.dimensions} == {*model.values({}).parameters}:
        return toml_joint_radii(model, changed, designs.describe({}), bounds)
    return joint_radii(designs, bounds)


def joint_radii(designs: DesignFamily, bounds: Mapping[str, float]) -> dict[str, Array]:
    """Return JOINT.a and JOINT.b -> radii of point, axis and reference, (3, 3), within bounds of dimensions.

    Each dimension changes by its bound to either side. The radius is the sum of the larger deviation; of
    the difference of both, which bounds the curvature; of the deviation from a quadratic in between; of the
    joint effect of each two dimensions; and of the joint effect of all. The certificate holds for joints
    within these radii.

    Raises:
        InputError: if a dimension changes more than points and axes of joints, or changes them far from
            smoothly within its tolerance.
    """
    nominal = designs.describe({})
    keys, start = [*side_numbers(nominal)], _stacked(nominal)
    total = np.zeros_like(start)

    def change(moved: Mapping[str, float]) -> Array:
        mechanism = designs.describe(
            {name: designs.dimensions[name].value + by for name, by in moved.items()}
        )
        if structure(mechanism) != structure(nominal):
            raise InputError(
                f"dimension {', '.join(moved)} changes a coupling, a lock or a kind of joint; "
                "a certificate holds within tolerances of points and axes only: leave it out of --within"
            )
        return _stacked(mechanism) - start

    ends = {name: [change({name: sign * bounds[name]}) for sign in (-1.0, 1.0)] for name in bounds}
    for name, (down, up) in ends.items():
        departure = np.zeros_like(start)
        for fraction in FRACTIONS:
            quadratic = 0.5 * fraction * (up - down) + 0.5 * fraction**2 * (up + down)
            departure = np.maximum(departure, np.abs(change({name: fraction * bounds[name]}) - quadratic))
        extent = np.maximum(np.abs(down), np.abs(up))
        if not departure.max() <= DEPARTURE * extent.max() + ROUNDING * np.abs(start).max():
            raise InputError(
                f"dimension {name} moves joints too unevenly within its tolerance {bounds[name]:g}; give a "
                "smaller one"
            )
        total += extent + np.abs(down + up) + SAFETY * departure
    for first, second in combinations(bounds, 2):
        together = [
            change({first: a * bounds[first], second: b * bounds[second]})
            - ends[first][(a + 1) // 2]
            - ends[second][(b + 1) // 2]
            for a, b in product((-1, 1), repeat=2)
        ]
        total += SAFETY * np.abs(together).max(0)
    for signs in _corners(len(bounds)):
        moved = change({name: sign * bounds[name] for name, sign in zip(bounds, signs, strict=True)})
        total += SAFETY * np.maximum(np.abs(moved) - total, 0.0)
    total += np.where(total > 0.0, ROUNDING * np.abs(start).max(), 0.0)
    return {key: radii for key, radii in zip(keys, total, strict=True) if radii.any()}


def _corners(count: int) -> NDArray[np.int_]:
    """Return signs of the dimensions at the corners of their tolerances, or at random corners of many."""
    if 2**count <= MAX_CORNERS:
        return np.array([*product((-1, 1), repeat=count)])
    return np.random.default_rng(0).choice([-1, 1], (MAX_CORNERS, count))


def _stacked(mechanism: Mechanism) -> Array:
    """Return points, axes and reference directions of all sides of joints, (sides, 3, 3)."""
    return np.array([*side_numbers(mechanism).values()])
