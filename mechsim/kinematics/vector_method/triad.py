"""The planar class III triad: a link on three legs, with all its assembly modes.

Pose and legs are written as in `leg_vectors`: points of the plane are complex numbers.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.kinematics.vector_method.trig_polynomial import polynomial_roots
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet, Values, constant_jet


def flat(point: Array) -> Any:
    """Return (n, 3) points as complex numbers x + iy, (n,)."""
    return point[..., 0] + 1j * point[..., 1]


def xyz(point: Any) -> Any:
    """Return points of the plane as (3, n) vectors."""
    if isinstance(point, Jet):
        return Jet(xyz(point.value), xyz(point.rate), xyz(point.second))
    return np.stack([point.real, point.imag, np.zeros_like(point.real)])


def dot(u: Any, v: Any) -> Any:
    """Return the scalar product of plane vectors."""
    return u.real * v.real + u.imag * v.imag


def cross(u: Any, v: Any) -> Any:
    """Return the vector product of plane vectors, its component normal to the plane."""
    return u.real * v.imag - u.imag * v.real


Complex = NDArray[np.complex128]

EPS = float(np.finfo(np.float64).eps)
# roots of the sextic within this distance of the unit circle (as |log |z||) can be real: a double root is
# accurate only to the square root of rounding, a multiple root less
CIRCLE_DISTANCE = 2e-2
# leg-length error relative to the triad's size below which legs are closed
CLOSED = 64.0 * EPS
# poses nearer than this (rad, and relative to the size) are equal: two that meet are not more accurate
ROOT_TOLERANCE = 1e-7


def triad_modes(pivots: ArrayLike, platform: ArrayLike, legs: ArrayLike) -> Array:
    """Return every real assembly mode of triads.

    |position + exp(i theta) platform_k - pivot_k| = leg_k for the three legs k. Two differences of these are
    linear in the first leg; substituted into the first equation they give a trigonometric polynomial of
    degree 3 in theta, a sextic in z = exp(i theta). Newton's method on the three equations starts from its
    roots on the unit circle, so that the sextic neither accepts nor refines a root.

    Args:
        pivots: positions of the pivots, (..., 3, 2) in [m].
        platform: points of the link in its own frame, in the same order, (..., 3, 2) in [m].
        legs: lengths, (..., 3) in [m].

    Returns:
        x, y in [m] and theta in [0, 2 pi) rad of up to six poses, by increasing theta, (..., 6, 3); NaN for
        missing ones. Poses that coincide to rounding count once.

    Accuracy: legs close to a few ulp of the triad's size. Two poses are distinguished from 1e-7 (rad,
        relative to the size) on. If all three legs are shorter than 0.03 of the size, the six roots cluster,
        the sextic is ill-conditioned, and poses may be missed.

    Source: the six solutions after Gosselin & Merlet 1994; the elimination avoids the tangent of the half
        angle, as in Rojas & Thomas, IEEE T-RO 27 (2011).
    """
    a, b = (np.asarray(points, dtype=np.float64) @ np.array([1.0, 1j]) for points in (pivots, platform))
    r = np.asarray(legs, dtype=np.float64)
    shape = np.broadcast_shapes(a.shape, b.shape, r.shape)
    a, b, r = (np.broadcast_to(points, shape).reshape(-1, 3).T for points in (a, b, r))  # (3, n)
    scale = np.max([abs(a - a[0]).max(0), abs(b - b[0]).max(0), r.max(0)], axis=0)
    a0, b0 = a[0], b[0]
    a, b, r = (a - a0) / scale, (b - b0) / scale, r / scale

    problem, position, phase = _starts(a, b, r)
    selected = a[:, problem], b[:, problem], r[:, problem]
    position, phase = closed_triads(position, phase, *selected, steps=40)
    with np.errstate(invalid="ignore"):
        lengths = abs(np.stack(leg_vectors(position, phase, *selected[:2])))
        closed = abs(lengths - selected[2]).max(0) <= CLOSED
    poses = _collect(len(r[0]), problem[closed], position[closed], phase[closed])
    position = scale[:, None] * (poses[..., 0] + 1j * poses[..., 1]) + a0[:, None]
    position -= np.exp(1j * poses[..., 2]) * b0[:, None]
    poses[..., 0], poses[..., 1] = position.real, position.imag
    return poses.reshape(*shape[:-1], 6, 3)


def _sextic_roots(a: Complex, b: Complex, r: Array) -> Complex:
    """Return the roots z = exp(i theta) of the eliminant of triads with a[0] = b[0] = 0, (n, 6)."""
    z = np.exp(0.25j * np.pi * np.arange(8))[:, None]  # eight samples determine a polynomial of degree 3
    u2, u3 = z * b[1] - a[1], z * b[2] - a[2]
    e2, e3 = (r[k] ** 2 - r[0] ** 2 - abs(u) ** 2 for k, u in ((1, u2), (2, u3)))
    value = abs(e3 * u2 - e2 * u3) ** 2 - 4.0 * r[0] ** 2 * cross(u2, u3) ** 2
    harmonics = np.fft.fft(value, axis=0) / 8.0
    rising = np.concatenate([harmonics[-3:], harmonics[:4]])  # coefficients of z^0 .. z^6
    # a leading coefficient below rounding is set to rounding: its roots are far off the circle
    floor = EPS * np.maximum(abs(rising).max(0), np.finfo(np.float64).tiny)
    lost = abs(rising[6]) < floor
    rising[6] = np.where(lost, floor, rising[6])
    return polynomial_roots(rising.T)


def _starts(a: Complex, b: Complex, r: Array) -> tuple[NDArray[np.intp], Complex, Complex]:
    """Return starts of Newton's method: index of the problem, position and orientation, (m,) each."""
    roots = _sextic_roots(a, b, r)
    with np.errstate(divide="ignore"):
        off = abs(np.log(abs(roots)))
    problem, which = np.nonzero(off < CIRCLE_DISTANCE)
    theta, off = np.angle(roots[problem, which]), off[problem, which]
    # a pair moved off the circle by rounding is about as far apart along it
    theta = np.concatenate([theta, theta - off, theta + off])
    problem = np.tile(problem, 3)
    phase = np.exp(1j * theta)
    u = phase * b[1:, problem] - a[1:, problem]  # (2, m)
    farthest = np.argmax(abs(u), axis=0)
    u = np.take_along_axis(u, farthest[None], 0)[0]
    r1, r2 = r[0, problem], r[1 + farthest, problem]
    # the first leg lies on its circle and on the line given by the longer of the two differences;
    # both intersections are tried, because at some theta both may close
    length = np.maximum(abs(u), EPS)
    along = (r2**2 - r1**2 - length**2) / (2.0 * length)
    across = np.sqrt(np.maximum(r1**2 - along**2, 0.0))
    ahead = u / length
    position = np.concatenate([(along + 1j * across) * ahead, (along - 1j * across) * ahead])
    return np.tile(problem, 2), position, np.tile(phase, 2)


def _collect(n: int, problem: NDArray[np.intp], position: Complex, phase: Complex) -> Array:
    """Return the distinct poses of each problem by increasing theta, (n, 6, 3), NaN for missing ones."""
    poses, order = np.full((n, 6, 3), np.nan), np.argsort(problem, kind="stable")
    ends = np.searchsorted(problem[order], np.arange(n + 1))
    for i, (first, last) in enumerate(pairwise(ends.tolist())):
        distinct: list[tuple[complex, complex]] = []
        for x, t in zip(position[order[first:last]], phase[order[first:last]], strict=True):
            if all(max(abs(x - y), abs(t - other)) >= ROOT_TOLERANCE for y, other in distinct):
                distinct.append((x, t))
        rows = sorted((np.angle(t) % (2.0 * np.pi), x.real, x.imag) for x, t in distinct[:6])
        poses[i, : len(rows)] = np.array(rows).reshape(-1, 3)[:, [1, 2, 0]]
    return poses


Three = Sequence[Any]  # one entry per leg: complex or float, number or array


def leg_vectors(position: Any, phase: Any, pivots: Three, platform: Three) -> Any:
    """Return the legs, from pivot to link, complex (3, ...)."""
    return [position + phase * b - a for a, b in zip(pivots, platform, strict=True)]


def moments(legs: Three, phase: Any, platform: Three) -> Any:
    """Return the moment of each leg vector about the origin of the link's frame, (3, ...)."""
    return [(leg * (phase * b).conjugate()).imag for leg, b in zip(legs, platform, strict=True)]


def determinant(legs: Three, arms: Three) -> Any:
    """Return the determinant of the rows (leg_x, leg_y, moment): zero where the triad is singular.

    It vanishes exactly when the three lines of the legs meet in a point or are parallel.
    """
    (l1, l2, l3), (m1, m2, m3) = legs, arms
    return m1 * cross(l2, l3) + m2 * cross(l3, l1) + m3 * cross(l1, l2)


def inverse(legs: Three, arms: Three) -> tuple[Any, Any]:
    """Return the columns of the inverse of the rows (leg_x, leg_y, moment).

    Column k is the rate of the link's pose if leg k alone grows at the rate 1/leg: position (complex),
    orientation.
    """
    (l1, l2, l3), (m1, m2, m3) = legs, arms
    whole = determinant(legs, arms)
    shift = [
        1j * (l3 * m2 - l2 * m3) / whole,
        1j * (l1 * m3 - l3 * m1) / whole,
        1j * (l2 * m1 - l1 * m2) / whole,
    ]
    return shift, [cross(l2, l3) / whole, cross(l3, l1) / whole, cross(l1, l2) / whole]


def closed_triads(
    position: Any, phase: Any, pivots: Three, platform: Three, legs: Three, steps: int
) -> tuple[Any, Any]:
    """Return position and orientation with closed legs, by Newton's method from each start."""
    with np.errstate(all="ignore"):
        for _ in range(steps):
            vectors = leg_vectors(position, phase, pivots, platform)
            # (|leg|^2 - r^2)/2 as a product, which keeps the digits of a small error
            gaps = [
                0.5 * (abs(leg) - length) * (abs(leg) + length)
                for leg, length in zip(vectors, legs, strict=True)
            ]
            shift, turning = inverse(vectors, moments(vectors, phase, platform))
            position = position - sum(column * gap for column, gap in zip(shift, gaps, strict=True))
            swing = sum(column * gap for column, gap in zip(turning, gaps, strict=True))
            phase = phase * (1.0 - 1j * swing)
            phase = phase / abs(phase)
    return position, phase


def carried(position: Any, phase: Any, pivots: Sequence[Values], platform: Three) -> tuple[Jet, Jet]:
    """Return a closed pose as jets, from the pivots as jets.

    The legs have constant lengths: (|leg|^2)/2 has first and second derivative zero.
    """
    moved = [pivot if isinstance(pivot, Jet) else constant_jet(np.asarray(pivot)) for pivot in pivots]
    arms = [phase * point for point in platform]
    vectors = leg_vectors(position, phase, [pivot.value for pivot in moved], platform)
    columns = inverse(vectors, moments(vectors, phase, platform))

    def solved(right: Three) -> list[Any]:
        return [sum(c * value for c, value in zip(column, right, strict=True)) for column in columns]

    velocity, spin = solved([dot(leg, pivot.rate) for leg, pivot in zip(vectors, moved, strict=True)])
    rates = [velocity + 1j * spin * arm - pivot.rate for arm, pivot in zip(arms, moved, strict=True)]
    acceleration, spin_rate = solved(
        [
            dot(leg, pivot.second + spin**2 * arm) - dot(rate, rate)
            for leg, rate, arm, pivot in zip(vectors, rates, arms, moved, strict=True)
        ]
    )
    return (
        Jet(position, velocity, acceleration),
        Jet(phase, 1j * spin * phase, (1j * spin_rate - spin**2) * phase),
    )
