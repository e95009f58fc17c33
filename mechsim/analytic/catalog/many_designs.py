"""Many designs of one closed form solved together: the formulas of the catalogue on arrays of parameters."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.catalog.base import CLEAR, ClosedForm, TwoBranchForm
from mechsim.analytic.catalog.parameter_checks import HUGE
from mechsim.analytic.vector_method import link_frames
from mechsim.analytic.vector_method.jets import Jet
from mechsim.analytic.vector_method.link_frames import GROUND_FRAME
from mechsim.analytic.vector_method.trig_polynomial import SignedRoot, TrigPolynomial
from mechsim.model.design_arrays import DesignArrays, Ends, StartedDesigns
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, ORIGIN, Pose
from mechsim.model.motion import JointMotion, Motion, PointMotion
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array

# distance of a root from the unit circle up to which it is real, and up to which that is not certain
REAL, NEARLY = 1e-6, 1e-2
# real roots nearer to each other in [rad], and leading coefficients smaller than this part of the largest,
# leave a design to be solved by itself
APART, LEAST = 1e-2, 1e-8
NEWTON = 3

Complex = NDArray[np.complex128]


AXES = "xyz"
# places in the turn at which margins are looked at before their lowest are sought, Newton steps to
# those, and a margin, as a part of the largest harmonic, that may be a change point or the end of a range
PLACES, NEWTON, CLOSE = 48, 6, 1e-7
# a polynomial without change points: an array of parameters holds only designs that have none
PLAIN = SignedRoot(TrigPolynomial(np.array([1.0 + 0.0j])), ())

Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Turning:
    """Over which part of the turn designs can stand.

    Attributes:
        full: whether the crank turns fully, (n,).
        doubtful: whether margins come so near to nought that only the exact roots tell, (n,).
        lowest: the crank angle at which each comes nearest to falling apart, or is farthest open, (n,).
        margins: coefficients of the margins as `numpy.fft` orders them, (n, 2 degree + 1).
        clear: whether they stand clear of dead centres with the crank at nought, (n,); they are begun there.
    """

    full: Bools
    doubtful: Bools
    lowest: Array
    margins: NDArray[np.complex128]
    clear: Bools


def can_be_many(form: ClosedForm, varied: Iterable[str]) -> bool:
    """Whether a closed form takes arrays of these parameters; parts of a place are called pivot.x."""
    takes = form.broadcast | form.idle
    return isinstance(form, TwoBranchForm) and {one.partition(".")[0] for one in varied} <= takes


def can_be_begun(form: ClosedForm, varied: Iterable[str]) -> bool:
    """Whether `started` tells where designs of these parameters begin."""
    return form.begins_alone and {one.partition(".")[0] for one in varied} <= form.broadcast | form.idle


def allowed(form: ClosedForm, varied: Mapping[str, Array]) -> Bools:
    """Return which designs have parameters that their declarations allow, (n,)."""
    rules = {one.name: one.metadata for one in fields(form)}
    good = np.ones(len(next(iter(varied.values()))), dtype=np.bool_)
    for name, values in varied.items():
        rule = rules[name.partition(".")[0]]
        if "options" in rule:
            good &= np.isin(values, np.array(rule["options"], dtype=np.float64))
            continue
        good &= np.abs(values) < (HUGE if rule["unit"] == "m" else np.inf)
        if rule.get("positive"):
            good &= values > 1.0 / HUGE
    return good


def many(form: ClosedForm, varied: Mapping[str, Array], repeat: int) -> ClosedForm:
    """Return a closed form whose varied parameters are arrays, each number so many times in a row.

    Only its formulas are of use: `frames`, `margin`, `local_points`; nothing is checked.
    """
    one = object.__new__(type(form))
    values = {parameter.name: getattr(form, parameter.name) for parameter in fields(form)}
    for name, row in varied.items():
        parameter, dot, axis = name.partition(".")
        wide = np.repeat(row, repeat)
        if dot:
            place = list(values[parameter])
            place[AXES.index(axis)] = wide
            values[parameter] = tuple(place)
        else:
            values[parameter] = wide
    for name, value in values.items():
        object.__setattr__(one, name, value)
    # in place of what `cached_property` would find
    own: dict[str, object] = vars(one)
    own["_root"] = PLAIN
    return one


def turning(form: TwoBranchForm, varied: Mapping[str, Array]) -> Turning:
    """Return over which part of the turn designs can stand: by their margins' lowest values.

    A margin is a trigonometric polynomial; each of its minima is found from evenly spread places.
    """
    count, n = 2 * form.margin_degree + 1, len(next(iter(varied.values())))
    at = REVOLUTION * np.arange(count) / count
    with np.errstate(all="ignore"):
        sampled = many(form, varied, count).margin(np.tile(at, n))  # pyright: ignore[reportAttributeAccessIssue]
    harmonics = np.fft.fft(sampled.reshape(n, count)) / count
    order = np.fft.fftfreq(count, 1.0 / count)
    scale = np.abs(harmonics).max(1)
    places = REVOLUTION * np.arange(PLACES) / PLACES
    heights = (harmonics @ np.exp(1j * np.outer(order, places))).real
    minima = (heights <= np.roll(heights, 1, 1)) & (heights <= np.roll(heights, -1, 1))
    of, which = np.nonzero(minima)
    found, own = places[which], harmonics[of]
    for _ in range(NEWTON):
        turned = own * np.exp(1j * np.outer(found, order))
        slope, bend = (turned @ (1j * order)).real, (turned @ (1j * order) ** 2).real
        step = np.divide(-slope, bend, out=np.zeros_like(slope), where=np.abs(bend) > 0.0)
        found = found + np.clip(step, -REVOLUTION / PLACES, REVOLUTION / PLACES)
    low = (own * np.exp(1j * np.outer(found, order))).sum(1).real
    least = np.full(n, np.inf)
    np.minimum.at(least, of, low)
    lowest = np.zeros(n)
    lowest[of[low == least[of]]] = found[low == least[of]] % REVOLUTION
    known = np.isfinite(least) & (scale > 0.0)
    doubtful = ~known | (np.abs(least) <= CLOSE * scale)
    clear = heights[:, 0] > CLEAR * heights.max(1)
    return Turning(known & (least > CLOSE * scale), doubtful, lowest, harmonics, clear)


def closed_at(form: TwoBranchForm, varied: Mapping[str, Array], angles: Array) -> Bools:
    """Return which designs' loops close at all of some crank angles (p,) in [rad], (n,)."""
    designs = len(next(iter(varied.values())))
    with np.errstate(all="ignore"):
        margins = many(form, varied, len(angles)).margin(np.tile(angles, designs))  # pyright: ignore[reportAttributeAccessIssue]
    return (margins.reshape(designs, -1) > 0.0).all(1)


def ranges(found: Turning) -> tuple[Array, NDArray[np.intp]]:
    """Return over how much of the turn cranks can stand, (n,) in [rad], and how many dead centres end it.

    Those in doubt are as if margins that touch nought did not.
    """
    count = found.margins.shape[1]
    degree = count // 2
    top = np.fft.fftshift(found.margins, axes=1)[:, ::-1]
    widest, ends = np.where(found.full, REVOLUTION, 0.0), np.zeros(len(top), dtype=np.intp)
    order = np.arange(-degree, degree + 1.0)
    for i in np.flatnonzero(~found.full & np.isfinite(top).all(1)):
        zeros = np.roots(top[i])
        real = np.sort(np.angle(zeros[np.abs(np.abs(zeros) - 1.0) < CLOSE**0.5]))
        gaps = np.diff(np.append(real, real[:1] + REVOLUTION))
        middle = (np.exp(1j * np.outer(real + 0.5 * gaps, order)) @ top[i][::-1]).real
        widest[i], ends[i] = gaps[middle > 0.0].sum(), len(real)
    return widest, ends


def solved(
    form: ClosedForm,
    varied: Mapping[str, Array],
    angles: Array,
    speed: ArrayLike,
    acceleration: ArrayLike = 0.0,
    *,
    rates: bool,
    joints: bool,
) -> Motion:
    """Return the motions of designs, one design after another.

    Args:
        form: what the parameters that do not vary are of.
        varied: parameter -> (n,) in SI.
        angles: crank angles, (p,) in [rad], or (n, p) where each design has its own.
        speed: of the crank, alike in [rad/s].
        acceleration: alike in [rad/s2].
        rates: False leaves velocities and accelerations nought.
        joints: whether joints are wanted, too.

    Returns:
        Points and joints with one coordinate at n p instants; not a number where a loop stands open.
    """
    designs = len(next(iter(varied.values())))
    wide_rows = (np.broadcast_to(row, angles.shape) for row in (angles, speed, acceleration))
    crank, pace, second = (np.tile(row, designs) if row.ndim == 1 else row.ravel() for row in wide_rows)
    wide = many(form, varied, angles.shape[-1])
    described = form.mechanism
    at = Jet(crank, pace, second) if rates else crank
    wanted = {link for link, _ in described.points.values()}
    if joints:
        wanted |= {link.name for link in described.links}
    with np.errstate(all="ignore"):
        frames: dict[str, link_frames.LinkFrame] = {GROUND: GROUND_FRAME}
        for name, frame in wide.frames(at):
            frames[name] = frame
            if wanted <= frames.keys():
                break
        points: dict[str, PointMotion] = {}
        for name, local in wide.local_points().items():
            place = frames[described.points[name][0]].point(local)
            points[name] = link_frames.point_motion(place, len(crank))
        found: dict[str, JointMotion] = {}
        for joint in described.joints if joints else ():
            if KINDS[joint.kind].single:
                coordinates = (
                    [at]
                    if joint.name == described.driver
                    else link_frames.joint_coordinates(
                        joint, frames[joint.a.link], frames[joint.b.link], wide.side_a(joint)
                    )
                )
                found |= link_frames.joint_motions(joint, coordinates, len(crank))
    return Motion("closed form", crank, pace, second, points, joints=found)


def started(form: ClosedForm, varied: Mapping[str, Array]) -> StartedDesigns:
    """Return the description of designs, and how they stand with the crank at nought, where they can.

    As `form.mechanism` describes one.
    """
    n, described = len(next(iter(varied.values()))), form.mechanism
    wide, links = many(form, varied, 1), [link.name for link in described.links]
    at = wide.joint_points()
    ends: dict[str, Ends] = {}
    for joint in described.joints:
        point_a, point_b = at.get(joint.name, (ORIGIN, ORIGIN))
        frame_a, frame_b = wide.side_a(joint), joint.b.frame
        ends[joint.name] = _place(point_a, n), _frame(frame_a, n), _place(point_b, n), _frame(frame_b, n)
    points = {name: _place(local, n) for name, local in wide.local_points().items()}
    with np.errstate(all="ignore"):
        frames = dict(wide.begin_frames(n))
    guess = {
        name: Pose(link_frames.place(frames[name].origin, n), frames[name].rotation(n)) for name in links
    }
    return StartedDesigns(DesignArrays(described, ends, points), guess, {described.crank.name: np.zeros(n)})


def _place(parts: Sequence[Any], n: int) -> Array:
    return np.stack([np.broadcast_to(part, n) for part in parts]).astype(np.float64)


def _frame(frame: Array, n: int) -> Array:
    return np.broadcast_to(frame if frame.ndim == 3 else frame[..., None], (3, 3, n))


def swing_arcs(found: Turning) -> tuple[Array, Array]:
    """Return lower and upper ends of the arc over which each crank swings, (n,) in [rad].

    That is the arc with crank angle zero, otherwise the longest. NaN where there is none, or none that is
    certain.
    """
    count = found.margins.shape[1]
    order = np.arange(count) - count // 2
    harmonics = np.fft.fftshift(found.margins, axes=1)
    low, high = np.full(len(harmonics), np.nan), np.full(len(harmonics), np.nan)
    lead = np.abs(harmonics[:, -1]) > LEAST * np.abs(harmonics).max(1)
    index = np.flatnonzero(lead & np.isfinite(harmonics).all(1) & ~found.full)
    if not len(index):
        return low, high
    roots = _roots(harmonics[index])
    off = np.abs(np.abs(roots) - 1.0)
    certain = ((off < REAL) | (off > NEARLY)).all(1)
    number = (off < REAL).sum(1)
    for real in range(2, count, 2):
        rows = np.flatnonzero(certain & (number == real))
        if len(rows):
            at = np.angle(roots[rows][off[rows] < REAL]).reshape(len(rows), real)
            ends = _chosen(
                np.sort(_polished(at, harmonics[index[rows]], order)), harmonics[index[rows]], order
            )
            low[index[rows]], high[index[rows]] = ends
    return low, high


def _roots(harmonics: Complex) -> Complex:
    """Return the complex roots of polynomials with coefficients (n, k + 1) by rising power, (n, k)."""
    n, degree = len(harmonics), harmonics.shape[1] - 1
    companion = np.zeros((n, degree, degree), dtype=np.complex128)
    companion[:, 1:, :-1] = np.eye(degree - 1)
    companion[:, :, -1] = -harmonics[:, :-1] / harmonics[:, -1:]
    return np.linalg.eigvals(companion).astype(np.complex128)


def _values(at: Array, harmonics: Complex, order: Array, derivative: int = 0) -> Array:
    """Return polynomials (n, k) or a derivative at angles (n, m)."""
    turned = np.exp(1j * at[..., None] * order) * (1j * order) ** derivative
    return (turned * harmonics[:, None]).sum(-1).real


def _polished(at: Array, harmonics: Complex, order: Array) -> Array:
    for _ in range(NEWTON):
        slope = _values(at, harmonics, order, 1)
        at = at - _values(at, harmonics, order) / np.where(slope == 0.0, np.inf, slope)
    return at


def _chosen(ends: Array, harmonics: Complex, order: Array) -> tuple[Array, Array]:
    """Return the arc with crank angle zero, otherwise the longest, between roots (n, m) that rise."""
    after = np.concatenate([ends[:, 1:], ends[:, :1] + REVOLUTION], 1)
    width = after - ends
    open_ = _values(0.5 * (ends + after), harmonics, order) > 0.0
    holds_zero = np.mod(-ends, REVOLUTION) < width
    best = np.argmax(np.where(open_, width + 2.0 * REVOLUTION * holds_zero, -1.0), 1)
    row = np.arange(len(ends))
    low, wide, zero = ends[row, best], width[row, best], holds_zero[row, best]
    low = np.where(zero & (low > 0.0), low - REVOLUTION, low)
    good = open_[row, best] & (width.min(1) > APART)
    return np.where(good, low, np.nan), np.where(good, low + wide, np.nan)
