"""Synthesis: the best (Chebyshev) approximation of a looper's coupler curve to a given one.

Crank, coupler and arm are given, and where C should go; rocker, frame and frame angle are found. While C
runs along the curve the dyad O1-A-C carries B along with it, and B should keep its distance c from a
fixed O2. |B|2 - 2 p0 Bx - 2 p1 By - p2, with p0, p1 the place of O2 and p2 = c2 - d2, is how far it does
not; this is linear in p, so the p with the least greatest error is found by a linear programme. That is
the paper's criterion. The distance of C from the curve is not quite linear in p; it is made least at its
greatest by such programmes one after another, each about the linkage of the last (Gauss-Newton).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.looper import Looper
from mechsim.errors import AssemblyError, InputError
from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array
from mechsim.theory.passage import Passage, crank_pin, dyad, levers_on, passage, wedge


@dataclass(frozen=True, slots=True)
class Best:
    """The unknowns x that make the greatest |right - rows x| least.

    Attributes:
        x: (3,).
        error: right - rows x, (n,).
        level: its greatest size.
        active: the rows, four as a rule, that hold the solution in place, rising.
    """

    x: Array
    error: Array
    level: float
    active: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Circle:
    """The circle that points keep to best.

    Attributes:
        centre: (2,) in [m].
        radius: in [m].
        error: |B - centre|2 - radius2 at every point, (n,) in [m2].
        level: its greatest size.
        alternation: the points, four as a rule, that hold the solution in place, rising.
    """

    centre: Array
    radius: float
    error: Array
    level: float
    alternation: tuple[int, ...]


def best_circle(points: Array) -> Circle:
    """Return the circle whose error |B - m|2 - r2 is least at its greatest.

    Args:
        points: B, (n, 2) in [m].

    Raises:
        AssemblyError: where the best "circle" has no real radius.
    """
    origin = points.mean(0)
    best = least_worst(*circle_rows(points - origin))
    centre, radius = circle_of(best.x)
    return Circle(origin + centre, radius, best.error, best.level, best.active)


def circle_rows(points: Array) -> tuple[Array, Array]:
    """Return rows, (n, 3), and right side, (n,), of |B - m|2 - r2 = right - rows x for x = (m, r2 - m2)."""
    return np.column_stack([2.0 * points, np.ones(len(points))]), (points**2).sum(1)


def circle_of(x: Array) -> tuple[Array, float]:
    """Return centre, (2,), and radius of the circle with x = (m, r2 - m2), as `circle_rows` has it."""
    radius2 = float(x[2] + x[:2] @ x[:2])
    if not radius2 > 0.0:
        raise AssemblyError("the circle that fits the rocker's end best has no real radius")
    return x[:2], float(np.sqrt(radius2))


def least_worst(rows: Array, right: Array) -> Best:
    """Return the x whose greatest |right - rows x| is least, by a linear programme.

    Args:
        rows: (n, 3).
        right: (n,).

    Raises:
        AssemblyError: where the programme has no solution.

    Accuracy: the programme is solved in an orthonormal basis and in units of the error itself, then its
    active rows exactly, so that nothing of the solver's tolerance (1e-7) is left.
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
    n = len(rows)
    active = np.unique(np.argsort(-duals)[:4] % n)
    error = right - rows @ x[:3]
    if len(active) == 4:
        square = np.column_stack([rows[active], np.sign(error[active])])
        q = np.asarray(np.linalg.solve(square, right[active]), dtype=np.float64)
        if np.abs(right - rows @ q[:3]).max() <= np.abs(error).max() * (1.0 + 1e-6):
            return active, q[:3]
    return active, x[:3]


# points of a line for the rocker's circle: the ripple between them is hidden to a thousandth of its height
POINTS = 101
# for the distance of C there are so many times more, which hide it to 2e-5
FINER = 8
# in parts of the arm: on a shorter curve rounding moves the lengths by more than 1e-7, and outweighs the
# deviation, which falls with the cube of the length
MIN_STEP = 1e-4
# programmes one after another, three to six as a rule, until one predicts no more than this part
MAX_PROGRAMMES = 40
LAST_GAIN = 1e-6
# before them, as many about the dyad with C on the curve, which come within some percent
GUESSES = 3


@dataclass(frozen=True, slots=True)
class Synthesis:
    """A looper found by approximation.

    Attributes:
        design: the whole linkage.
        deviation: the farthest that the path of its C leaves the curve, along the curve's normals and over
            the whole of it, in [m].
        radial_error: the farthest that B would leave the rocker's circle with C on the curve, in [m].
        curve: points that C should pass, (n, 2) in [m].
        angles: crank angle at which C crosses the normals there, (n,) in [rad].
        error: distance of C from the curve there, signed, (n,) in [m]; by `equal_ripple` it is equal in
            size and of alternating sign at the alternation points.
        alternation: indices of the points that hold the solution in place.
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
    in_space: bool = False,
) -> Synthesis:
    """Return the looper whose C follows a straight line best.

    Args:
        through: middle of the line, (x, y) in [m].
        tilt: angle of the line from Y towards X, in [rad].
        length: extent of the line in y, in [m].
        base: gives crank, coupler, arm, arm angle and all that the plane does not decide.
        equal_ripple: make the deviation of C from the line least, rather than (as the paper does) that of
            B from its circle.
        in_space: follow the line with the C of the spatial linkage, seen along Z, rather than with that
            of the planar four-bar.

    Raises:
        InputError: where C cannot reach the line, no linkage follows it, or it is too short.

    Accuracy: the deviation to 2e-5 of itself, and to rounding of the arm. By the circle, the optimum over
    101 points; the line between them moves the least error by a thousandth, and, the optimum being flat,
    the lengths by 1 um for the paper's linkage. By equal ripple, the optimum over 801 points, next to the
    one by the circle: no linkage nearby is better, one far off may be.

    Source: paper 004, section "Example of synthesis", eq. (3) in the form of papers.md section 4.
    """
    curve = line(through, tilt, length, FINER * (POINTS - 1) + 1)
    return _followed(curve, base, equal_ripple, in_space, every=FINER)


def line(through: tuple[float, float], tilt: float, length: float, points: int = POINTS) -> Array:
    """Return points of a line, closer together at its ends, (n, 2) in [m], for `synthesize_looper`."""
    if not 0.0 < length < np.inf or not np.isfinite([*through, tilt]).all() or not abs(tilt) < np.pi / 2:
        raise InputError(
            f"there is no line through {through} m, tilted by {tilt} rad and {length} m long; "
            "give finite numbers, a length above 0 and a tilt between -pi/2 and pi/2"
        )
    y = -0.5 * length * np.cos(np.pi * np.arange(points) / (points - 1))
    return np.column_stack([through[0] + np.tan(tilt) * y, through[1] + y])


def follow_curve(
    curve: Array, base: Looper, *, equal_ripple: bool = False, in_space: bool = False
) -> Synthesis:
    """Return the looper whose C follows a curve best, of both senses in which the dyad O1-A-C can bend.

    Args:
        curve: points in the order they are passed, (n, 2) in [m], n at least 5; the deviation counts on
            the normals at these.
        base: as for `synthesize_looper`.
        equal_ripple: as for `synthesize_looper`.
        in_space: the curve is that of C on its cylinder, seen along Z, not of the planar four-bar's.

    Raises:
        InputError: where C cannot reach the curve, no linkage follows it, or it is too short.
    """
    curve = np.asarray(curve, dtype=np.float64)
    if curve.ndim != 2 or curve.shape[1] != 2 or len(curve) < 5 or not np.isfinite(curve).all():
        raise InputError(f"a curve of shape {curve.shape} is none; give five points (x, y) or more, finite")
    return _followed(curve, base, equal_ripple, in_space)


def _followed(curve: Array, base: Looper, equal_ripple: bool, in_space: bool, every: int = 1) -> Synthesis:
    extent = float(np.hypot(*np.ptp(curve, axis=0)))
    if not extent >= MIN_STEP * base.arm:
        raise InputError(
            f"the curve extends over {extent:.3g} m, where rounding decides the linkage; give at least "
            f"{MIN_STEP * base.arm:.3g} m, {MIN_STEP:g} of the arm"
        )
    solutions: list[Synthesis] = []
    for branch in (1, -1):
        task = _Task(curve, base, in_space, every, *dyad(curve, base, branch, in_space=in_space))
        try:
            solutions.append(task.leveled() if equal_ripple else task.by_circle().synthesis)
        except AssemblyError:
            continue
    if not solutions:
        raise InputError(
            f"no linkage carries C along this curve, {extent:.6g} m in extent: the rocker that fits best "
            "cannot hold B all along it; shorten or move the curve or change crank, coupler and arm"
        )
    return min(solutions, key=lambda solution: solution.deviation)


@dataclass(frozen=True, slots=True)
class _Trial:
    """A linkage and how it passes the curve."""

    synthesis: Synthesis
    passage: Passage


@dataclass(frozen=True, slots=True)
class _Task:
    """A curve to follow, and where the dyad then is: crank angles, (n,), and B, (n, 2)."""

    curve: Array
    base: Looper
    in_space: bool
    every: int
    angles: Array
    b: Array

    @property
    def origin(self) -> Array:
        """Where circles are counted from, lest digits cancel, (2,) in [m]."""
        return self.b.mean(0)

    def _circle(self, x: Array) -> tuple[Array, float]:
        centre, radius = circle_of(x)
        return self.origin + centre, radius

    def by_circle(self) -> _Trial:
        """Return the linkage whose B, with C on every so many points of the curve, keeps its circle best."""
        circle = best_circle(self.b[:: self.every])
        alternation = tuple(self.every * index for index in circle.alternation)
        return self._trial(circle.centre, circle.radius, self.angles, alternation)

    def leveled(self) -> Synthesis:
        """Return the linkage whose C leaves the curve least."""
        best = self._guess()
        for _ in range(MAX_PROGRAMMES):
            now, level = best.passage, best.synthesis.deviation
            rows, right = circle_rows(now.b - self.origin)
            target = least_worst(now.levers[:, None] * rows, now.error + now.levers * right)
            gain = level - target.level
            better = self._toward(target, best, gain) if gain > LAST_GAIN * level else None
            if better is None:
                break
            best = better
        return best.synthesis

    def _guess(self) -> _Trial:
        """Return nearly the linkage whose C leaves the curve least, from the dyad with C on the curve."""
        rows, right = circle_rows(self.b - self.origin)
        best = least_worst(rows, right)
        for _ in range(GUESSES):
            design = self._design(*self._circle(best.x))
            levers = levers_on(design, self.curve, self.angles, in_space=self.in_space)
            best = least_worst(levers[:, None] * rows, levers * right)
        return self._trial(*self._circle(best.x), self.angles, best.active)

    def _toward(self, target: Best, last: _Trial, gain: float) -> _Trial | None:
        """Return the first trial, ever nearer to the last, with a tenth of the predicted gain."""
        design, level = last.synthesis.design, last.synthesis.deviation
        centre = design.pivot[:2, 0] - self.origin
        x = np.append(centre, design.rocker**2 - centre @ centre)
        for fraction in 0.5 ** np.arange(12):
            try:
                circle = self._circle(x + fraction * (target.x - x))
                trial = self._trial(*circle, last.passage.angles, target.active)
            except AssemblyError:
                continue
            if level - trial.synthesis.deviation > 0.1 * fraction * gain:
                return trial
        return None

    def _design(self, centre: Array, radius: float) -> Looper:
        pin = crank_pin(self.angles, self.base)
        bends = wedge(self.b - centre, pin - centre)
        if abs(np.sign(bends).sum()) < len(bends):
            raise AssemblyError("coupler and rocker stretch out while C is on the curve")
        return replace(
            self.base,
            rocker=radius,
            frame=float(np.hypot(*centre)),
            frame_angle=float(np.arctan2(centre[1], centre[0])),
            branch=1 if bends[0] > 0.0 else -1,
        )

    def _trial(self, centre: Array, radius: float, angles: Array, alternation: tuple[int, ...]) -> _Trial:
        design = self._design(centre, radius)
        passed = passage(design, self.curve, angles, in_space=self.in_space)
        radial = float(np.abs(np.hypot(*(self.b - centre).T) - radius).max())
        deviation = float(np.abs(passed.error).max())
        synthesis = Synthesis(design, deviation, radial, self.curve, passed.angles, passed.error, alternation)
        return _Trial(synthesis, passed)
