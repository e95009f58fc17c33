"""Many designs of a closed form solved together: the formulas of the catalogue on arrays of parameters."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.kinematics.formulas.closed_form import ClosedForm
from mechsim.kinematics.formulas.two_branch import TwoBranchForm
from mechsim.kinematics.vector_method import link_frames
from mechsim.kinematics.vector_method.trig_polynomial import SignedRoot, TrigPolynomial, polynomial_roots
from mechsim.mechanism.design_arrays import DesignArrays, Ends, StartedDesigns
from mechsim.mechanism.links import ORIGIN, Pose
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import HUGE, REVOLUTION, Array
from mechsim.numerics.jets import Jet

# distance of a root from the unit circle below which it is real, and below which this is uncertain
REAL, NEARLY_REAL = 1e-6, 1e-2
# distance of real roots in [rad], and leading coefficient relative to the largest, below which a design is
# solved separately
MIN_ROOT_DISTANCE, MIN_LEADING = 1e-2, 1e-8
# Newton steps per root or minimum
NEWTON_STEPS = 6

Complex = NDArray[np.complex128]

# crank angles at which discriminants are sampled, and the minimum, relative to the largest harmonic, below
# which it may be a change point or an end of the range
GRID, TOUCHING = 48, 1e-7
# arrays of parameters contain only designs without change points
NO_CHANGE_POINTS = SignedRoot(TrigPolynomial(np.array([1.0 + 0.0j])), ())

Bools = NDArray[np.bool_]
AnyForm = TypeVar("AnyForm", bound=ClosedForm)


@dataclass(frozen=True)
class CrankRanges:
    """Ranges of the cranks of n designs.

    Attributes:
        full: whether the crank rotates fully, (n,).
        uncertain: whether the discriminant has a minimum so close to 0 that only exact roots decide, (n,).
        discriminants: coefficients of the discriminants in the order of `numpy.fft`, (n, 2 degree + 1).
    """

    full: Bools
    uncertain: Bools
    discriminants: NDArray[np.complex128]


def formula_of_many(formula: ClosedForm | None, varied: Iterable[str]) -> TwoBranchForm | None:
    """Return formulas that accept arrays of these parameters; components are named as in pivot.x.

    None for other formulas.
    """
    return formula if isinstance(formula, TwoBranchForm) and _array_parameters(formula, varied) else None


def can_be_started(formula: ClosedForm, varied: Iterable[str]) -> bool:
    """Whether `closed_form_starts` determines the initial poses of designs with these parameters."""
    with np.errstate(all="ignore"):
        return _array_parameters(formula, varied) and formula.start_frames(1) is not None


def _array_parameters(formula: ClosedForm, varied: Iterable[str]) -> bool:
    return {name.partition(".")[0] for name in varied} <= formula.array_parameters


def allowed(formula: ClosedForm, varied: Mapping[str, Array]) -> Bools:
    """Return which designs have valid parameters, (n,)."""
    rules = formula.declared.rows
    valid = np.ones(len(next(iter(varied.values()))), dtype=np.bool_)
    for name, values in varied.items():
        rule = rules[name.partition(".")[0]]
        if rule.options:
            valid &= np.isin(values, np.array(rule.options, dtype=np.float64))
            continue
        valid &= np.abs(values) < (HUGE if rule.unit == "m" else np.inf)
        if rule.positive:
            valid &= values > 1.0 / HUGE
    return valid


def many(formula: AnyForm, varied: Mapping[str, Array], repeat: int) -> AnyForm:
    """Return a closed form whose varied parameters are arrays, each number repeated.

    No check of the parameters runs, and no change point is searched; only its formulas can be used.
    """
    wide = {name: np.repeat(row, repeat) for name, row in varied.items()}
    design = formula.with_dimensions(wide, checked=False)
    # preset cached properties
    vars(design).update(described=formula.described, _root=NO_CHANGE_POINTS)
    return design


def crank_ranges(formula: TwoBranchForm, varied: Mapping[str, Array]) -> CrankRanges:
    """Return the crank ranges of designs from the minima of their discriminants.

    A discriminant is a trigonometric polynomial; Newton's method from evenly spaced angles finds its minima.
    """
    count, n = 2 * formula.discriminant_degree + 1, len(next(iter(varied.values())))
    angles = REVOLUTION * np.arange(count) / count
    with np.errstate(all="ignore"):
        sampled = many(formula, varied, count).discriminant(np.tile(angles, n))
    harmonics = np.fft.fft(sampled.reshape(n, count)) / count
    order = np.asarray(np.fft.fftfreq(count, 1.0 / count), dtype=np.float64)
    scale = np.abs(harmonics).max(1)
    grid = REVOLUTION * np.arange(GRID) / GRID
    heights = (harmonics @ np.exp(1j * np.outer(order, grid))).real
    minima = (heights <= np.roll(heights, 1, 1)) & (heights <= np.roll(heights, -1, 1))
    design, which = np.nonzero(minima)
    own = harmonics[design]
    minimum = _polished(grid[which, None], own, order, derivative=1)
    least = np.full(n, np.inf)
    np.minimum.at(least, design, _values(minimum, own, order)[:, 0])
    finite = np.isfinite(least) & (scale > 0.0)
    uncertain = ~finite | (np.abs(least) <= TOUCHING * scale)
    return CrankRanges(finite & (least > TOUCHING * scale), uncertain, harmonics)


def solved(
    formula: ClosedForm,
    varied: Mapping[str, Array],
    angles: Array,
    speed: ArrayLike,
    acceleration: ArrayLike = 0.0,
    *,
    rates: bool,
    joints: bool,
    links: bool = False,
) -> Motion:
    """Return the motions of designs, one design after another.

    Args:
        formula: the closed form with the constant parameters.
        varied: parameter -> (n,) in SI.
        angles: crank angles, (p,) in [rad], or (n, p) if they differ by design.
        speed: crank speed, of the same shapes, in [rad/s].
        acceleration: crank acceleration, of the same shapes, in [rad/s2].
        rates: False sets velocities and accelerations to 0.
        joints: whether to include joints.
        links: whether to include links.

    Returns:
        Points, links and joints with one coordinate at n p instants; NaN where a loop does not close.
    """
    designs = len(next(iter(varied.values())))
    wide_rows = (np.broadcast_to(row, angles.shape) for row in (angles, speed, acceleration))
    crank, rate, second = (np.tile(row, designs) if row.ndim == 1 else row.ravel() for row in wide_rows)
    wide = many(formula, varied, angles.shape[-1])
    angle = Jet(crank, rate, second) if rates else crank
    return replace(wide.motion_at(angle, links=links, joints=joints), speed=rate, acceleration=second)


def transmissions(formula: ClosedForm, varied: Mapping[str, Array], motion: Motion) -> Array:
    """Return the transmission angles of designs in a motion of `solved`, (n p,) in [rad]."""
    designs = len(next(iter(varied.values())))
    points = {name: point.position for name, point in motion.points.items()}
    result = many(formula, varied, len(motion.angle) // designs).transmission_at(motion.angle, points)
    assert result is not None  # a measure that no formula defines is rejected before
    return result


def closed_form_starts(formula: ClosedForm, varied: Mapping[str, Array]) -> StartedDesigns:
    """Return the description of designs, and their poses at crank angle 0, if they close.

    The description is that of `mechanism`.
    """
    n, described = len(next(iter(varied.values()))), formula.mechanism
    wide, links = many(formula, varied, 1), [link.name for link in described.links]
    geometry = wide.geometry()
    ends: dict[str, Ends] = {}
    for joint in described.joints:
        point_a, point_b = geometry.joints.get(joint.name, (ORIGIN, ORIGIN))
        frame_a, frame_b = geometry.frames.get(joint.name, joint.a.frame), joint.b.frame
        ends[joint.name] = _vectors(point_a, n), _frame(frame_a, n), _vectors(point_b, n), _frame(frame_b, n)
    points = {name: _vectors(local, n) for name, local in geometry.points.items()}
    with np.errstate(all="ignore"):
        frames = dict(wide.start_frames(n) or ())
    guess = {name: Pose(link_frames.rows(frames[name].origin, n), frames[name].rotation(n)) for name in links}
    return StartedDesigns(DesignArrays(described, ends, points), guess, {described.crank.name: np.zeros(n)})


def _vectors(components: Sequence[Any], n: int) -> Array:
    return np.stack([np.broadcast_to(component, n) for component in components]).astype(np.float64)


def _frame(frame: Array, n: int) -> Array:
    return np.broadcast_to(frame if frame.ndim == 3 else frame[..., None], (3, 3, n))


def swing_arcs(cranks: CrankRanges) -> tuple[Array, Array]:
    """Return lower and upper ends of the interval over which each crank swings, (n,) in [rad].

    It is the interval with crank angle zero, otherwise the longest. NaN if there is none or it is uncertain.
    """
    count = cranks.discriminants.shape[1]
    order = np.arange(count) - count // 2
    harmonics = np.fft.fftshift(cranks.discriminants, axes=1)
    low, high = np.full(len(harmonics), np.nan), np.full(len(harmonics), np.nan)
    lead = np.abs(harmonics[:, -1]) > MIN_LEADING * np.abs(harmonics).max(1)
    index = np.flatnonzero(lead & np.isfinite(harmonics).all(1) & ~cranks.full)
    if not len(index):
        return low, high
    roots = polynomial_roots(harmonics[index])
    off = np.abs(np.abs(roots) - 1.0)
    certain = ((off < REAL) | (off > NEARLY_REAL)).all(1)
    number = (off < REAL).sum(1)
    for real in range(2, count, 2):
        rows = np.flatnonzero(certain & (number == real))
        if len(rows):
            angles, own = np.angle(roots[rows][off[rows] < REAL]).reshape(len(rows), real), index[rows]
            ends = np.sort(_polished(angles, harmonics[own], order))
            low[own], high[own] = _chosen(ends, harmonics[own], order)
    return low, high


def _values(angles: Array, harmonics: Complex, order: Array, derivative: int = 0) -> Array:
    """Return polynomials (n, k) or a derivative at angles (n, m)."""
    powers = np.exp(1j * angles[..., None] * order) * (1j * order) ** derivative
    return (powers * harmonics[:, None]).sum(-1).real


def _polished(angles: Array, harmonics: Complex, order: Array, derivative: int = 0) -> Array:
    """Return roots (n, m) of polynomials or of a derivative by Newton's method from approximate ones."""
    for _ in range(NEWTON_STEPS):
        next_derivative = _values(angles, harmonics, order, derivative + 1)
        step = _values(angles, harmonics, order, derivative) / np.where(
            next_derivative == 0.0, np.inf, next_derivative
        )
        angles = angles - np.clip(step, -REVOLUTION / GRID, REVOLUTION / GRID)
    return angles


def _chosen(ends: Array, harmonics: Complex, order: Array) -> tuple[Array, Array]:
    """Return the interval with crank angle zero, otherwise the longest, between increasing roots (n, m)."""
    after = np.concatenate([ends[:, 1:], ends[:, :1] + REVOLUTION], 1)
    width = after - ends
    open_ = _values(0.5 * (ends + after), harmonics, order) > 0.0
    holds_zero = np.mod(-ends, REVOLUTION) < width
    best = np.argmax(np.where(open_, width + 2.0 * REVOLUTION * holds_zero, -1.0), 1)
    row = np.arange(len(ends))
    low, wide, zero = ends[row, best], width[row, best], holds_zero[row, best]
    low = np.where(zero & (low > 0.0), low - REVOLUTION, low)
    valid = open_[row, best] & (width.min(1) > MIN_ROOT_DISTANCE)
    return np.where(valid, low, np.nan), np.where(valid, low + wide, np.nan)
