"""How far aside of its path a point can lie, by tolerances."""

from dataclasses import dataclass

import numpy as np

from mechsim.numerics.arrays import Array, tangents
from mechsim.studies.sensitivity.study import ToleranceStudy
from mechsim.studies.sensitivity.table import Sensitivity


@dataclass(frozen=True, slots=True)
class PathDeviation:
    """A path, and how far aside of it a point can lie: across the path in the plane nearest to it.

    Attributes:
        point: its name.
        places: (n, 3) in [m].
        worst: where all conspire, to first order, (n,) in [m].
        squares: by the root of the sum of squares, (n,) in [m].
    """

    point: str
    places: Array
    worst: Array
    squares: Array


def path_bands(table: Sensitivity, study: ToleranceStudy) -> list[PathDeviation]:
    """Return the bands of the points whose three coordinates are in a study and that move."""
    found: list[PathDeviation] = []
    for point in table.moved.form.mechanism.points:
        columns = [f"{point}.{axis}" for axis in "xyz"]
        if not all(one in table.values for one in columns):
            continue
        places = np.column_stack([table.values[one] for one in columns])
        if np.ptp(places, axis=0).max() == 0.0:
            continue
        parts = study.across(columns, _across(places))
        total, squares = np.sum(parts, 0), np.sqrt(np.sum(np.square(parts), 0))
        found.append(PathDeviation(point, places, total, squares))
    return found


def _across(places: Array) -> Array:
    """Return unit vectors across a path in the plane nearest to it, (n, 3)."""
    middle = places - places.mean(0)
    normal = np.linalg.svd(middle, full_matrices=False)[2][2]
    across = np.cross(normal, tangents(middle))
    length = np.sqrt((across**2).sum(1, keepdims=True))
    return across / np.where(length > 0.0, length, 1.0)
