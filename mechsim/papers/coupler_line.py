"""Synthesis: the best (Chebyshev) approximation of a looper's coupler curve to a given curve.

Given are crank, coupler, arm and the target curve of C; unknown are rocker, frame and frame angle. With C on
the curve the dyad O1-A-C moves B, which should keep its distance c from a fixed O2. Its error is |B|2 - 2 p0
Bx - 2 p1 By - p2, with the position (p0, p1) of O2 and p2 = c2 - d2. It is linear in p, so that a linear
programme finds the p with the smallest largest error. This is the paper's criterion. The distance of C from
the curve is nonlinear in p; successive linear programmes, each about the previous linkage (Gauss-Newton),
minimise its largest value.

A passage is the path of C along the curve, with the deviation of a linkage from it.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.kinematics.vector_method.vectors import Sign
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import Array

# the catalogue's looper, whose parameters are stated in its file
Looper: TypeAlias = Any
# crank step for the speed of C, in [rad]: a central difference with an error of 1e-10
STEP = 1e-5
# largest number of Newton steps; three or four suffice unless C reverses near an end of the curve
MAX_ITERATIONS = 20


@dataclass(frozen=True, slots=True)
class Passage:
    """Crossings of the path of C with the normals of a curve.

    Attributes:
        angles: crank angles, (n,) in [rad].
        error: distances from the curve along its normals, signed, (n,) in [m].
        b: positions of B, (n, 2) in [m].
        levers: derivative of the error by |B - O2|2 - c2, (n,) in [1/m].
    """

    angles: Array
    error: Array
    b: Array
    levers: Array


def dyad(curve: Array, base: Looper, branch: Sign) -> tuple[Array, Array]:
    """Return crank angles, (n,) in [rad], and positions of B, (n, 2) in [m], with C on a curve.

    Args:
        curve: positions of C, (n, 2) in [m].
        base: gives crank a, coupler b, arm k and arm angle.
        branch: side of A seen from O1 towards C, +1 for left.

    Raises:
        InputError: where C is out of reach.
    """
    a, k, reach = base.crank, base.arm, np.hypot(curve[:, 0], curve[:, 1])
    if not ((reach >= abs(k - a)) & (reach <= k + a)).all():
        raise InputError(
            f"the curve runs {reach.min():.6g} to {reach.max():.6g} m from the crank's shaft, but crank and "
            f"arm reach {abs(k - a):.6g} to {k + a:.6g} m; shorten or move the curve or change the arm"
        )
    inner = np.arccos(np.clip((a * a + (reach - k) * (reach + k)) / (2.0 * a * reach), -1.0, 1.0))
    angles = np.unwrap(np.arctan2(curve[:, 1], curve[:, 0]) + branch * inner)
    pin = crank_pin(angles, base)
    return angles, pin + _rod(curve - pin, base)


def crank_pin(angles: Array, base: Looper) -> Array:
    """Return positions of A, (n, 2) in [m]."""
    return base.crank * np.column_stack([np.cos(angles), np.sin(angles)])


def passage(design: Looper, curve: Array, angles: Array) -> Passage:
    """Return the crossings of a linkage's C with the normals of a curve, by Newton's method.

    Args:
        design: the whole linkage.
        curve: points in order, (n, 2) in [m].
        angles: crank angles near the crossings, (n,) in [rad].

    Raises:
        AssemblyError: where the linkage does not close, or C reverses or never crosses a normal.

    Accuracy: the error to 1e-16 of the arm; the levers to 1e-9.
    """
    along = np.gradient(curve, axis=0)
    tangents = along / np.hypot(along[:, 0], along[:, 1])[:, None]
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    angles, positions, speed = _crossings(design, curve, tangents, angles)
    rate, off = (speed * tangents).sum(1), positions - curve
    b, moved = _response(design, positions, angles)
    # C stays on the normal: the crank compensates its displacement along the curve
    derivative = (speed * normals).sum(1) / rate
    levers = (moved * normals).sum(1) - derivative * (moved * tangents).sum(1)
    return Passage(angles, (off * normals).sum(1), b, levers)


def _crossings(design: Looper, curve: Array, tangents: Array, angles: Array) -> tuple[Array, Array, Array]:
    """Return crank angles, (n,), positions of C and speeds, (n, 2) each, at the crossings."""
    middle = len(curve) // 2
    for _ in range(MAX_ITERATIONS):
        positions, speed = _path(design, angles)
        along, rate = ((positions - curve) * tangents).sum(1), (speed * tangents).sum(1)
        if not np.isfinite(along + rate).all():
            break
        reversed_, steps = rate * rate[middle] <= 0.0, np.diff(angles)
        crossed = not reversed_.any() and np.abs(along).max() <= 1e-14 * design.arm
        monotonic = abs(np.sign(steps).sum()) == len(steps)
        if crossed and monotonic and abs(angles[-1] - angles[0]) < 2.0 * np.pi:
            return angles, positions, speed
        # where C has reversed, step inwards only; a longer step could lead there
        inwards = np.sign(angles - angles[middle])
        step = np.divide(along, rate, out=inwards.copy(), where=~reversed_)
        angles = angles - np.clip(step, -0.1, 0.1)
    raise AssemblyError("the linkage does not close, or C reverses, while C is on the curve")


def wedge(u: Array, v: Array) -> Array:
    """Return the cross product of vectors in the plane, (n,) for (n, 2)."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _response(design: Looper, positions: Array, angles: Array) -> tuple[Array, Array]:
    """Return B, and the derivative of C by |B - O2|2 - c2 with the crank fixed, (n, 2) each.

    The coupler rotates about A until B is on its circle again.
    """
    pin = crank_pin(angles, design)
    to_c = positions - pin
    to_b = _rod(to_c, design)
    closed = 2.0 * wedge(to_b, pin + to_b - design.closed_form.pivot[:2, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.column_stack([to_c[:, 1], -to_c[:, 0]]) / closed[:, None]
    if not np.isfinite(moved).all():
        raise AssemblyError("coupler and rocker are collinear while C is on the curve")
    return pin + to_b, moved


def _path(design: Looper, angles: Array) -> tuple[Array, Array]:
    """Return positions of C, (n, 2) in [m], and their derivatives by the crank angle, (n, 2) in [m/rad]."""
    around = np.concatenate([angles, angles + STEP, angles - STEP])
    with np.errstate(invalid="ignore"):
        positions = design.closed_form.planar_point(around)[:, :2]
    current, ahead, behind = np.split(positions, 3)
    return current, (ahead - behind) / (2.0 * STEP)


def _rod(to_c: Array, base: Looper) -> Array:
    """Return AB from AC, (n, 2) each in [m]."""
    x, y = (to_c / base.arm).T
    cosine, sine = np.cos(base.arm_angle), np.sin(base.arm_angle)
    return base.coupler * np.column_stack([cosine * x + sine * y, cosine * y - sine * x])


@dataclass(frozen=True, slots=True)
class Best:
    """The unknowns x that minimise the largest |right - rows x|.

    Attributes:
        x: (3,).
        error: right - rows x, (n,).
        level: largest absolute error.
        active: indices of the active rows, usually four, increasing.
    """

    x: Array
    error: Array
    level: float
    active: tuple[int, ...]


def best_circle(points: Array) -> tuple[Array, float, Best]:
    """Return centre (2,) and radius of the circle with the smallest largest error |B - m|2 - r2, and its fit.

    Args:
        points: B, (n, 2) in [m].

    Raises:
        AssemblyError: if the best "circle" has no real radius.
    """
    origin = points.mean(0)
    best = least_worst(*circle_rows(points - origin))
    centre, radius = circle_of(best.x)
    return origin + centre, radius, best


def circle_rows(points: Array) -> tuple[Array, Array]:
    """Return rows, (n, 3), and right side, (n,), of |B - m|2 - r2 = right - rows x for x = (m, r2 - m2)."""
    return np.column_stack([2.0 * points, np.ones(len(points))]), (points**2).sum(1)


def circle_of(x: Array) -> tuple[Array, float]:
    """Return centre, (2,), and radius of the circle with x = (m, r2 - m2), as in `circle_rows`."""
    radius2 = float(x[2] + x[:2] @ x[:2])
    if not radius2 > 0.0:
        raise AssemblyError("the best circle of the rocker's end has no real radius")
    return x[:2], float(np.sqrt(radius2))


def least_worst(rows: Array, right: Array) -> Best:
    """Return the x that minimises the largest |right - rows x|, by a linear programme.

    Args:
        rows: (n, 3).
        right: (n,).

    Raises:
        AssemblyError: if the programme has no solution.

    Accuracy: the programme is solved in an orthonormal basis and in units of the error itself, and then its
        active rows exactly, so that the solver's tolerance (1e-7) has no effect.
    """
    from scipy.optimize import linprog

    basis, change = np.linalg.qr(rows)
    q = basis.T @ right
    residual = right - basis @ q
    unit = float(np.abs(residual).max())
    active = np.arange(0)
    if unit > 1e-14 * float(np.abs(right).max()):
        unit_column = np.ones((len(rows), 1))
        best = linprog(
            [0.0, 0.0, 0.0, 1.0],
            A_ub=np.block([[-basis, -unit_column], [basis, -unit_column]]),
            b_ub=np.concatenate([-residual, residual]) / unit,
            bounds=[(None, None)] * 3 + [(0.0, None)],
            method="highs",
        )
        if best.x is None:
            raise AssemblyError(f"the linear programme for the rocker has no solution: {best.message}")
        active, extra = _exact(basis, residual / unit, best)
        q = q + unit * extra
    error = right - basis @ q
    x = np.asarray(np.linalg.solve(change, q), dtype=np.float64)
    return Best(x, error, float(np.abs(error).max()), tuple(active.tolist()))


def _exact(rows: Array, right: Array, best: Any) -> tuple[NDArray[np.intp], Array]:
    """Return the active points of a linear programme and its solution from them alone."""
    x: Array = best.x
    duals: Array = np.abs(best.ineqlin.marginals)
    active = np.unique(np.argsort(-duals)[:4] % len(rows))
    error = right - rows @ x[:3]
    if len(active) == 4:
        square = np.column_stack([rows[active], np.sign(error[active])])
        q = np.asarray(np.linalg.solve(square, right[active]), dtype=np.float64)
        if np.abs(right - rows @ q[:3]).max() <= np.abs(error).max() * (1.0 + 1e-6):
            return active, q[:3]
    return active, x[:3]


# points of a line for the rocker's circle: the ripple between them is accurate to a thousandth of its height
POINTS = 101
# factor of the number of points for the distance of C: accurate to 2e-5
REFINEMENT = 8
# shortest curve relative to the arm: on a shorter one rounding moves the lengths by more than 1e-7 and
# exceeds the deviation, which is proportional to the cube of the length
MIN_LENGTH = 1e-4
# largest number of linear programmes, usually three to six, and the relative gain at which they end
MAX_PROGRAMMES = 40
LAST_GAIN = 1e-6


@dataclass(frozen=True, slots=True)
class Synthesis:
    """A synthesised looper.

    Attributes:
        design: the whole linkage.
        deviation: largest distance of the path of C from the curve, along the curve's normals, in [m].
        radial_error: largest distance of B from the rocker's circle with C on the curve, in [m].
        curve: target points of C, (n, 2) in [m].
        angles: crank angles at which C crosses the normals there, (n,) in [rad].
        error: distances of C from the curve there, signed, (n,) in [m]; with `equal_ripple` they have equal
            magnitudes and alternating signs at the alternation points.
        alternation: indices of the active points.
    """

    design: Looper
    deviation: float
    radial_error: float
    curve: Array
    angles: Array
    error: Array
    alternation: tuple[int, ...]

    __repr__ = short_repr

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
) -> Synthesis:
    """Return the looper whose C follows a straight line best.

    Args:
        through: middle of the line, (x, y) in [m].
        tilt: angle of the line from Y towards X, in [rad].
        length: extent of the line in y, in [m].
        base: gives crank, coupler, arm, arm angle and all dimensions that the planar problem does not
            determine.
        equal_ripple: whether to minimise the deviation of C from the line, instead of (as the paper does)
            that of B from its circle.

    Raises:
        InputError: if C cannot reach the line, no linkage follows it, or it is too short.

    Accuracy: the deviation to a relative 2e-5, and to rounding of the arm. By the circle, the optimum over
        101
    points; the line between them changes the smallest error by a thousandth, and, as the optimum is flat, the
    lengths by 1 um for the paper's linkage. By equal ripple, the local optimum over 801 points near the one
    by the circle; another optimum may be better.

    Source: Horobets et al. (2019), section "Example of synthesis", eq. (3), in the form of
        docs/explanation/synthesis.md.
    """
    curve = line(through, tilt, length, REFINEMENT * (POINTS - 1) + 1)
    return follow_curve(curve, base, equal_ripple, every=REFINEMENT)


def line(through: tuple[float, float], tilt: float, length: float, points: int = POINTS) -> Array:
    """Return points of a line, denser at its ends, (n, 2) in [m], for `synthesize_looper`."""
    if not 0.0 < length < np.inf or not np.isfinite([*through, tilt]).all() or not abs(tilt) < np.pi / 2:
        raise InputError(
            f"there is no line through {through} m, tilted by {tilt} rad and {length} m long; "
            "give finite numbers, a length above 0 and a tilt between -pi/2 and pi/2"
        )
    y = -0.5 * length * np.cos(np.pi * np.arange(points) / (points - 1))
    return np.column_stack([through[0] + np.tan(tilt) * y, through[1] + y])


def follow_curve(curve: Array, base: Looper, equal_ripple: bool = False, every: int = 1) -> Synthesis:
    """Return the looper whose C follows a curve best, for both directions in which the dyad O1-A-C can bend.

    Args:
        curve: points in order, (n, 2) in [m]; the deviation is measured on their normals.
        base: as in `synthesize_looper`.
        equal_ripple: as in `synthesize_looper`.
        every: the circle of B is fitted with C on every `every`-th point.

    Raises:
        InputError: if C cannot reach the curve, no linkage follows it, or it is too short.
    """
    extent = float(np.hypot(*np.ptp(curve, axis=0)))
    if not extent >= MIN_LENGTH * base.arm:
        raise InputError(
            f"the curve extends over {extent:.3g} m, where rounding decides the linkage; give at least "
            f"{MIN_LENGTH * base.arm:.3g} m, {MIN_LENGTH:g} of the arm"
        )
    solutions: list[Synthesis] = []
    for branch in (1, -1):
        task = _Task(curve, base, every, *dyad(curve, base, branch))
        try:
            solutions.append(task.equal_ripple() if equal_ripple else task.circle_fit()[0])
        except AssemblyError:
            continue
    if not solutions:
        raise InputError(
            f"no linkage moves C along this curve, {extent:.6g} m in extent: the best rocker cannot "
            "constrain B all along it; shorten or move the curve or change crank, coupler and arm"
        )
    return min(solutions, key=lambda solution: solution.deviation)


# a linkage and its passage along the curve
_Trial = tuple[Synthesis, Passage]


@dataclass(frozen=True, slots=True)
class _Task:
    """A target curve, and the dyad with C on it: crank angles, (n,), and B, (n, 2)."""

    curve: Array
    base: Looper
    every: int
    angles: Array
    b: Array

    @property
    def origin(self) -> Array:
        """Origin of the circles, which avoids loss of significance, (2,) in [m]."""
        return self.b.mean(0)

    def circle_fit(self) -> _Trial:
        """Return the linkage whose B keeps its circle best with C on every `every`-th point of the curve."""
        centre, radius, best = best_circle(self.b[:: self.every])
        alternation = tuple(self.every * index for index in best.active)
        return self._trial(centre, radius, self.angles, alternation)

    def equal_ripple(self) -> Synthesis:
        """Return the linkage whose C has the smallest deviation from the curve."""
        best = self.circle_fit()
        for _ in range(MAX_PROGRAMMES):
            linkage, now = best
            rows, right = circle_rows(now.b - self.origin)
            target = least_worst(now.levers[:, None] * rows, now.error + now.levers * right)
            gain = linkage.deviation - target.level
            better = self._toward(target, linkage, gain) if gain > LAST_GAIN * linkage.deviation else None
            if better is None:
                break
            best = better
        return best[0]

    def _toward(self, target: Best, last: Synthesis, gain: float) -> _Trial | None:
        """Return the first of successively shorter steps with a tenth of the predicted gain."""
        centre = last.design.closed_form.pivot[:2, 0] - self.origin
        x = np.append(centre, last.rocker**2 - centre @ centre)
        for fraction in 0.5 ** np.arange(12):
            try:
                centre, radius = circle_of(x + fraction * (target.x - x))
                trial = self._trial(self.origin + centre, radius, last.angles, target.active)
            except AssemblyError:
                continue
            if last.deviation - trial[0].deviation > 0.1 * fraction * gain:
                return trial
        return None

    def _trial(self, centre: Array, radius: float, angles: Array, alternation: tuple[int, ...]) -> _Trial:
        """Return the linkage whose rocker's end keeps a circle."""
        bends = wedge(self.b - centre, crank_pin(self.angles, self.base) - centre)
        if abs(np.sign(bends).sum()) < len(bends):
            raise AssemblyError("coupler and rocker are collinear while C is on the curve")
        design = self.base.with_parameters(
            rocker=radius,
            frame=float(np.hypot(*centre)),
            frame_angle=float(np.arctan2(centre[1], centre[0])),
            branch=1 if bends[0] > 0.0 else -1,
        )
        passed = passage(design, self.curve, angles)
        radial = float(np.abs(np.hypot(*(self.b - centre).T) - radius).max())
        deviation = float(np.abs(passed.error).max())
        return Synthesis(
            design, deviation, radial, self.curve, passed.angles, passed.error, alternation
        ), passed
