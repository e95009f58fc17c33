"""Synthesis: the best (Chebyshev) approximation of a looper's coupler curve to a given one.

Crank, coupler and arm are given, and where C should go; rocker, frame and frame angle are found. While C
runs along the curve the dyad O1-A-C carries B along with it, and B should keep its distance c from a
fixed O2. |B|2 - 2 p0 Bx - 2 p1 By - p2, with p0, p1 the place of O2 and p2 = c2 - d2, is how far it does
not; this is linear in p, so the p with the least greatest error is found by a linear programme.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mechsim.catalog.looper import Looper
from mechsim.errors import AssemblyError, InputError
from mechsim.synthesis.chebyshev import best_circle

Array = NDArray[np.float64]
Sign = Literal[1, -1]

# points of a line: the ripple between them is hidden to a thousandth of its height
POINTS = 101


@dataclass(frozen=True, slots=True)
class Synthesis:
    """A looper found by approximation.

    Attributes:
        design: the whole linkage.
        deviation: the farthest its C, in the plane, is from the curve, in [m].
        radial_error: the farthest that B leaves the rocker's circle, to first order, in [m].
        curve: points that C should pass, (n, 2) in [m].
        angles: crank angle at which it should, (n,) in [rad].
        error: distance of C from the curve there, signed, (n,) in [m]; equal in size and of
            alternating sign at the alternation points.
        alternation: indices of the points that hold the solution in place.
    """

    design: Looper
    deviation: float
    radial_error: float
    curve: Array
    angles: Array
    error: Array
    alternation: tuple[int, ...]

    @property
    def frame(self) -> float:
        """Distance of the pivots, d, in [m]."""
        return self.design.frame

    @property
    def frame_angle(self) -> float:
        """Angle of O1O2, eta, in [rad]."""
        return self.design.frame_angle

    @property
    def rocker(self) -> float:
        """Length of the rocker, c, in [m]."""
        return self.design.rocker


def synthesize_looper(
    through: tuple[float, float],
    tilt: float,
    length: float,
    base: Looper,
    *,
    equal_ripple: bool = False,
    in_space: bool = False,
) -> Synthesis:
    """Return the looper whose C follows a straight line best.

    Args:
        through: middle of the line, (x, y) in [m].
        tilt: angle of the line from Y towards X, in [rad].
        length: extent of the line in y, in [m].
        base: gives crank, coupler, arm, arm angle and all that the plane does not decide.
        equal_ripple: level the distance of C from the line rather than that of B from its circle.
        in_space: follow the line with the C of the spatial linkage, seen along Z, rather than with that
            of the planar four-bar.

    Raises:
        InputError: where C cannot reach the line, or no linkage follows it.

    Accuracy: the optimum over 101 points to rounding; the line between them moves the least error by a
    thousandth, and, the optimum being flat, the lengths by 1 um for the paper's linkage.

    Source: paper 004, section "Example of synthesis", eq. (3) in the form of papers.md section 4.
    """
    return follow_curve(line(through, tilt, length), base, equal_ripple=equal_ripple, in_space=in_space)


def line(through: tuple[float, float], tilt: float, length: float) -> Array:
    """Return points of a line, closer together at its ends, (n, 2) in [m], for `synthesize_looper`."""
    if not 0.0 < length < np.inf or not np.isfinite([*through, tilt]).all() or not abs(tilt) < np.pi / 2:
        raise InputError(
            f"there is no line through {through} m, tilted by {tilt} rad and {length} m long; "
            "give finite numbers, a length above 0 and a tilt between -pi/2 and pi/2"
        )
    y = -0.5 * length * np.cos(np.pi * np.arange(POINTS) / (POINTS - 1))
    return np.column_stack([through[0] + np.tan(tilt) * y, through[1] + y])


def follow_curve(
    curve: Array, base: Looper, *, equal_ripple: bool = False, in_space: bool = False
) -> Synthesis:
    """Return the looper whose C follows a curve best, of both ways the dyad O1-A-C can bend.

    Args:
        curve: points in the order they are passed, (n, 2) in [m], n at least 5.
        base: as for `synthesize_looper`.
        equal_ripple: as for `synthesize_looper`, and `in_space` too.

    Raises:
        InputError: where C cannot reach the curve, or no linkage follows it.
    """
    curve = np.asarray(curve, dtype=np.float64)
    if curve.ndim != 2 or curve.shape[1] != 2 or len(curve) < 5 or not np.isfinite(curve).all():
        raise InputError(f"a curve of shape {curve.shape} is none; give five points (x, y) or more, finite")
    found: list[Synthesis] = []
    for bend in (1, -1):
        task = _Task(curve, base, in_space, *dyad(curve, base, bend, in_space=in_space))
        try:
            best = task.fitted(np.ones(len(curve)))
            for _ in range(3 if equal_ripple else 0):
                best = task.fitted(task.levers(best.design))
            found.append(best)
        except AssemblyError:
            continue
    if not found:
        raise InputError(
            "no linkage carries C along this curve: the rocker that fits best cannot hold B all the way; "
            "move the curve or change crank, coupler and arm"
        )
    return min(found, key=lambda one: one.deviation)


def depth(y: Array, base: Looper) -> Array:
    """Return how far from the plane C is on its cylinder at height y, the nearer of two, (n,) in [m].

    NaN where y is beyond the cylinder.
    """
    with np.errstate(invalid="ignore"):
        half = np.sqrt((base.follower - (y - base.axis_y)) * (base.follower + (y - base.axis_y)))
    return base.axis_z - np.copysign(half, base.axis_z)


def dyad(curve: Array, base: Looper, bend: Sign, *, in_space: bool = False) -> tuple[Array, Array]:
    """Return crank angles, (n,) in [rad], and places of B, (n, 2) in [m], that put C on a curve.

    Args:
        curve: places of C, (n, 2) in [m].
        base: gives crank a, coupler b, arm k and arm angle; in space also the cylinder.
        bend: side of A on the way from O1 to C, +1 for left.
        in_space: the curve is that of C on the cylinder, seen along Z; then arm and arm angle are what
            the plane shows of them, k' and omega' of the paper.

    Raises:
        InputError: where C is out of reach.
    """
    z = depth(curve[:, 1], base) if in_space else np.zeros(len(curve))
    with np.errstate(invalid="ignore"):
        k = np.sqrt((base.arm - z) * (base.arm + z))
        cosine = base.arm * np.cos(base.arm_angle) / k
        sine = np.sign(np.sin(base.arm_angle)) * np.sqrt((1.0 - cosine) * (1.0 + cosine))
    if not np.isfinite(sine).all():
        raise InputError("the cylinder takes C farther from the plane than its arm reaches; move its axis")
    a, reach = base.crank, np.hypot(curve[:, 0], curve[:, 1])
    if not ((reach >= np.abs(k - a)) & (reach <= k + a)).all():
        raise InputError(
            f"the curve runs {reach.min():.6g} to {reach.max():.6g} m from the crank's shaft, but crank and "
            f"arm reach {abs(base.arm - a):.6g} to {base.arm + a:.6g} m; move the curve or change the arm"
        )
    inner = np.arccos(np.clip((a * a + (reach - k) * (reach + k)) / (2.0 * a * reach), -1.0, 1.0))
    angles = np.unwrap(np.arctan2(curve[:, 1], curve[:, 0]) + bend * inner)
    pin = a * np.column_stack([np.cos(angles), np.sin(angles)])
    x, y = ((curve - pin) / k[:, None]).T
    return angles, pin + base.coupler * np.column_stack([cosine * x + sine * y, cosine * y - sine * x])


@dataclass(frozen=True, slots=True)
class _Task:
    """A curve to follow, and where the dyad then is: crank angles, (n,), and B, (n, 2)."""

    curve: Array
    base: Looper
    in_space: bool
    angles: Array
    b: Array

    @property
    def pin(self) -> Array:
        """Places of A, (n, 2) in [m]."""
        return self.base.crank * np.column_stack([np.cos(self.angles), np.sin(self.angles)])

    def fitted(self, weights: Array) -> Synthesis:
        """Return the linkage whose weighted circle error is least."""
        circle = best_circle(self.b, weights / weights.max())
        bends = _wedge(self.b - circle.centre, self.pin - circle.centre)
        if abs(np.sign(bends).sum()) < len(bends):
            raise AssemblyError("coupler and rocker stretch out while C is on the curve")
        design = replace(
            self.base,
            rocker=circle.radius,
            frame=float(np.hypot(*circle.centre)),
            frame_angle=float(np.arctan2(circle.centre[1], circle.centre[0])),
            branch=1 if bends[0] > 0.0 else -1,
        )
        with np.errstate(invalid="ignore"):
            flat = design.planar_point(self.angles)[:, :2]
        if not np.isfinite(flat).all():
            raise AssemblyError("the linkage does not close while C is on the curve")
        reached = design.positions(self.angles)["C"][:, :2] if self.in_space else flat
        error = ((reached - self.curve) * _normals(self.curve)).sum(1)
        radial = float(np.abs(circle.error).max()) / (2.0 * circle.radius)
        deviation = float(np.abs(error).max())
        return Synthesis(design, deviation, radial, self.curve, self.angles, error, circle.alternation)

    def levers(self, design: Looper) -> Array:
        """Return by how much C leaves the curve for an error of one in |B - O2|2, (n,).

        With the crank held the coupler turns about A until B is back on its circle.
        """
        to_b, to_c = self.b - self.pin, self.curve - self.pin
        sweep = np.column_stack([-to_c[:, 1], to_c[:, 0]])
        if self.in_space:
            # AC keeps its length and its angle to AB, and C stays on the cylinder
            z = depth(self.curve[:, 1], self.base)
            arm, rod = np.column_stack([to_c, z]), np.column_stack([to_b, np.zeros_like(z)])
            lever = np.column_stack(
                [np.zeros_like(z), self.curve[:, 1] - self.base.axis_y, z - self.base.axis_z]
            )
            volume = (np.cross(arm, rod) * lever).sum(1)
            sweep = (-_wedge(to_b, to_c) / volume)[:, None] * np.cross(lever, arm)[:, :2]
        moved = np.abs((sweep * _normals(self.curve)).sum(1))
        closed = 2.0 * np.abs(_wedge(to_b, self.b - design.pivot[:2, 0]))
        # where C moves along the curve its error does not count, yet the circle wants some hold there
        return np.maximum(moved / closed, 1e-6 * (moved / closed).max())


def _wedge(u: Array, v: Array) -> Array:
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _normals(curve: Array) -> Array:
    """Return unit normals of a curve given by points, (n, 2)."""
    along = np.gradient(curve, axis=0)
    return np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(along[:, 0], along[:, 1])[:, None]
