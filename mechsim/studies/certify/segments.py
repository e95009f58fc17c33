"""Krawczyk tests over segments of a motion.

On a segment the tube is the line q0 + q' (s - s0) with a half-width. The test covers each parameter s of the
segment, and each driver position and each mechanism in their intervals. It proves that exactly one solution
lies in the tube, and that the Jacobian is regular in the whole tube (Krawczyk 1969; Neumaier, Interval
Methods for Systems of Equations, 1990, section 5.1).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.motion import join, select_instants
from mechsim.numerics.arrays import Array
from mechsim.numerics.balls import OUTWARD, Ball, ball
from mechsim.studies.certify.computed_motion import CentreConfigurations, ComputedMotion
from mechsim.studies.certify.loop_equations import ClosureEquations, Number, concatenated

Bools = NDArray[np.bool_]
# the half-width of a tube is the sum of: a fraction of the displacement of the coordinates over the segment;
# a multiple of the effect of residual and tolerances on each coordinate, to which a fraction of the largest
# effect is added; and a minimum, ten times `CORRECTED`, so that tubes of drivers at rest contain the
# solutions of their neighbours
WIDTH_BY_RATE, WIDTH_BY_RESIDUAL, OF_LARGEST, MIN_WIDTH = 0.3, 3.0, 0.1, 1e-12
# largest number of segments tested at once: their arrays take some 40 MB
BATCH = 4096
# number of times that the test contracts a proven enclosure
CONTRACTIONS = 20
# maximum number of Newton iterations for the centre of a segment
CORRECTIONS = 4
# corrections of a centre below this limit in [rad] or characteristic lengths,
CORRECTED = 1e-13
# plus this fraction of the displacement of the coordinates over the segment, are not applied
CORRECTED_SHARE = 3e-3


@dataclass(frozen=True, slots=True)
class Segments:
    """n segments of a motion with their tubes; coordinates in their units.

    Attributes:
        low, high: path parameters, (n,).
        centre: parameter about which the tube is a line, (n,).
        half: largest distance from the centre, rounded up, (n,).
        values: coordinates at the centre in [m] and [rad], (n, count).
        quaternions: quaternions of ball joints at the centre, (n, balls, 4).
        rate: derivatives of the unknown coordinates by the parameter, (n, u).
        width: half-width of the tube in which the solution is unique, (n, u).
        enclosure: half-width of the tube that is proven to contain the solution, (n, u).
        singular_value: lower bound of the Jacobian's smallest singular value, (n,).
        proven: whether the test succeeded, (n,).
        misses: successive tests of the segment and its predecessors that failed even at the centre, (n,).
    """

    low: Array
    high: Array
    centre: Array
    half: Array
    values: Array
    quaternions: Array
    rate: Array
    width: Array
    enclosure: Array
    singular_value: Array
    proven: Bools
    misses: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.low)


@dataclass(frozen=True)
class Centres:
    """Corrected centres of tubes, with the linearised equations.

    Attributes:
        start: configurations.
        residual: residuals of the equations, (n, u, 1), as balls.
        inverse: approximate inverse of the Jacobian, (n, u, u).
        by_driven: the inverse times the Jacobian by the prescribed coordinates, (n, u, driven).
        rate: rates of the unknown coordinates, (n, u, 1).
    """

    start: CentreConfigurations
    residual: Ball
    inverse: Array
    by_driven: Array
    rate: Array


def _centres(
    equations: ClosureEquations, driven: Array, rate: Array, half: Array, guess: CentreConfigurations
) -> Centres:
    """Return centres corrected by Newton's method until the correction is small compared with the tube.

    Args:
        equations: equations to be solved.
        driven: prescribed coordinates, (n, driven).
        rate: rates of the prescribed coordinates in their units, (n, driven, 1).
        half: half-lengths of the segments, (n,).
        guess: approximate configurations.
    """
    values = guess.values.copy()
    values[:, equations.driven] = driven
    centres = _linearised(equations, CentreConfigurations(values, guess.quaternions), rate)
    for _ in range(CORRECTIONS):
        step = -(centres.inverse @ centres.residual.mid)[..., 0]
        largest = np.abs(step).max(1, initial=0.0)
        limit = CORRECTED + CORRECTED_SHARE * np.abs(centres.rate).max((1, 2), initial=0.0) * half
        move = np.isfinite(largest) & (largest > limit)
        if not move.any():
            break
        start = _moved(equations, centres.start, np.where(move[:, None], step, 0.0))
        centres = _linearised(equations, start, rate)
    return centres


def _linearised(equations: ClosureEquations, start: CentreConfigurations, rate: Array) -> Centres:
    residual, jacobian = equations.evaluate(ball(start.values[..., None]), rotations(equations, start))
    inverse = _inverse(jacobian.mid[..., equations.unknown])
    by_driven = inverse @ jacobian.mid[..., equations.driven]
    return Centres(start, residual, inverse, by_driven, -(by_driven @ rate))


def _moved(equations: ClosureEquations, start: CentreConfigurations, step: Array) -> CentreConfigurations:
    """Return configurations displaced by steps of the unknown coordinates in their units, (n, u)."""
    values, quaternions = start.values.copy(), start.quaternions.copy()
    values[:, equations.unknown] += step * equations.tree.units[equations.unknown]
    for i, first in enumerate(ball_columns(equations)):
        rotation = np.concatenate([np.ones((len(values), 1)), 0.5 * values[:, first : first + 3]], 1)
        product = quaternion_product(rotation, quaternions[:, i])
        quaternions[:, i] = product / np.linalg.norm(product, axis=1, keepdims=True)
        values[:, first : first + 3] = 0.0
    return CentreConfigurations(values, quaternions)


def batches(count: int) -> list[NDArray[np.intp]]:
    """Return the indices of segments that are tested at once."""
    return np.array_split(np.arange(count), max(1, -(-count // BATCH)))


def tested_segments(motion: ComputedMotion, low: Array, high: Array, guess: CentreConfigurations) -> Segments:
    """Return segments between parameters (n,) with the results of their tests.

    Args:
        motion: motion with the drivers and equations.
        low, high: ends of the segments; equal for a test at one parameter.
        guess: approximate configurations at the middles.
    """
    pieces = batches(len(low))
    if len(pieces) > 1:
        return join([tested_segments(motion, low[i], high[i], select_instants(guess, i)) for i in pieces])
    centre = 0.5 * (low + high)
    half = np.maximum(high - centre, centre - low) * OUTWARD
    equations, units = motion.equations, motion.equations.tree.units
    unknown, driven = equations.unknown, equations.driven
    with np.errstate(all="ignore"):
        values, rates, _ = motion.driven(centre)
        driven_rate = (ball(rates) * ball(units[driven]).reciprocal())[..., None]
        centres = _centres(equations, values, driven_rate.mid, half, guess)
        inverse, reach = ball(centres.inverse), half[:, None, None]
        correction = inverse @ centres.residual
        # the tube to be tested
        spread = motion.driver_spread(centre, half)
        effect = correction.magnitude + np.abs(centres.by_driven) @ (spread / units[driven])[..., None]
        effect = WIDTH_BY_RESIDUAL * (effect + OF_LARGEST * effect.max(1, initial=0.0, keepdims=True))
        by_rate = np.abs(centres.rate).max(1, initial=0.0, keepdims=True) * reach
        width = WIDTH_BY_RATE * by_rate + effect + MIN_WIDTH
        # bounds of the Krawczyk operator's offset (n, u, 1) and of |I - C A| (n, u, u) in the tube
        radius = np.zeros((*centres.start.values.shape, 1))
        radius[:, unknown] = (np.abs(centres.rate) * reach + width) * units[unknown, None]
        radius[:, driven] = driven_rate.magnitude * units[driven, None] * reach + spread[..., None]
        box = Ball(centres.start.values[..., None], radius * OUTWARD)
        _, jacobian = equations.evaluate(box, rotations(equations, centres.start))
        by_unknown, by_driven = jacobian[..., unknown], jacobian[..., driven]
        derivative = by_unknown @ centres.rate + by_driven @ driven_rate
        deviation = spread[..., None] / units[driven, None] * OUTWARD
        moved = correction + inverse @ derivative * Ball(np.zeros(reach.shape), reach)
        moved = moved + inverse @ (by_driven @ Ball(np.zeros(deviation.shape), deviation))
        offset = moved.magnitude
        contraction = (np.eye(len(unknown)) - inverse @ by_unknown).magnitude
        enclosure = (offset + contraction @ width * OUTWARD) * OUTWARD
        proven = (enclosure < width).all((1, 2)) & (low <= high)
        for _ in range(CONTRACTIONS):
            # the solution lies in the enclosure, which the test maps into a smaller enclosure
            enclosure = np.minimum(enclosure, (offset + contraction @ enclosure * OUTWARD) * OUTWARD)
        singular_value = _singular_value_bound(centres.inverse, contraction)
    return Segments(
        low,
        high,
        centre,
        half,
        centres.start.values,
        centres.start.quaternions,
        centres.rate[..., 0],
        width[..., 0],
        enclosure[..., 0],
        singular_value,
        proven,
        np.zeros(len(low), dtype=np.intp),
    )


def with_misses(motion: ComputedMotion, failed: Segments) -> Segments:
    """Return failed segments with their counts of tests that also fail at the centre."""
    if not len(failed):
        return failed
    at_centre = along_tangents(motion.equations, failed, np.zeros(len(failed)))
    alone = tested_segments(motion, failed.centre, failed.centre, at_centre)
    return replace(failed, misses=np.where(alone.proven, 0, failed.misses + 1))


def rotations(equations: ClosureEquations, configurations: CentreConfigurations) -> list[Number]:
    """Return enclosures of the rotations (n, 3, 3) of each ball joint from its quaternions."""
    return [_rotation(ball(configurations.quaternions[:, i])) for i in range(len(equations.tree.balls))]


def _rotation(quaternion: Ball) -> Ball:
    q = quaternion[..., None]
    outer = q @ q.T
    products = [[outer[..., i : i + 1, j : j + 1] for j in range(4)] for i in range(4)]
    (ww, wx, wy, wz), (_, xx, xy, xz), (_, _, yy, yz), (_, _, _, zz) = products
    rows = [
        [ww + xx - yy - zz, (xy - wz) * 2.0, (xz + wy) * 2.0],
        [(xy + wz) * 2.0, ww - xx + yy - zz, (yz - wx) * 2.0],
        [(xz - wy) * 2.0, (yz + wx) * 2.0, ww - xx - yy + zz],
    ]
    matrix = concatenated([concatenated(row, -1) for row in rows], -2)
    return matrix * (q.T @ q).reciprocal()


def ball_columns(equations: ClosureEquations) -> list[int]:
    """Return the index of the first component of each ball joint."""
    return [branch.first_angle for branch in equations.tree.balls]


def quaternion_product(a: Number, b: Number) -> Number:
    """Return products of quaternions (n, 4), real part first."""
    products = [
        b @ np.eye(4),
        b[..., [1, 0, 3, 2]] * np.array([-1.0, 1.0, -1.0, 1.0]),
        b[..., [2, 3, 0, 1]] * np.array([-1.0, 1.0, 1.0, -1.0]),
        b[..., [3, 2, 1, 0]] * np.array([-1.0, -1.0, 1.0, 1.0]),
    ]
    w, x, y, z = (a[..., i : i + 1] * product for i, product in enumerate(products))
    return w + x + y + z


def _inverse(matrix: Array) -> Array:
    """Return inverses (n, u, u); NaN for singular matrices."""
    finite = np.isfinite(matrix).all((1, 2), keepdims=True)
    try:
        return np.asarray(np.linalg.inv(np.where(finite, matrix, np.nan)), dtype=np.float64)
    except np.linalg.LinAlgError:
        if len(matrix) == 1:
            return np.full(matrix.shape, np.nan)
        return np.concatenate([_inverse(single[None]) for single in matrix])


def _singular_value_bound(inverse: Array, contraction: Array) -> Array:
    """Return lower bounds of the smallest singular values, (n,): (1 - |I - C A|) / |C| in spectral norm."""
    if not inverse.shape[1]:
        return np.full(len(inverse), np.inf)
    norms: list[Array] = []
    for matrix in (np.abs(inverse), contraction):
        columns, rows = (np.sum(matrix, axis).max(1) for axis in (1, 2))
        norms.append(np.sqrt(columns * rows) * OUTWARD)
    smallest: Array = np.maximum((1.0 - norms[1]) / norms[0] / OUTWARD, 0.0)
    return smallest


def segments_that_join(motion: ComputedMotion, segments: Segments) -> Bools:
    """Return whether neighbouring segments contain the same solution at their common end, (n - 1,).

    A proven solution at the common end must lie in the tubes of both segments.
    """
    n = len(segments)
    before, after = select_instants(segments, slice(n - 1)), select_instants(segments, slice(1, n))
    guess = along_tangents(motion.equations, before, before.high - before.centre)
    common = tested_segments(motion, before.high, before.high, guess)
    in_both = inside(motion.equations, common, before) & inside(motion.equations, common, after)
    return (before.high == after.low) & common.proven & in_both


def inside(equations: ClosureEquations, first: Segments, second: Segments) -> Bools:
    """Return whether the solutions of the first segments at their centres lie in the second tubes, (n,)."""
    unknown, units = equations.unknown, equations.tree.units[equations.unknown]
    y = Ball(np.zeros(first.rate.shape), first.enclosure)
    distance = y + (ball(first.values[:, unknown]) - second.values[:, unknown]) * (
        ball(1.0) * ball(units).reciprocal()
    )
    for i, column in enumerate(ball_columns(equations)):
        k = np.searchsorted(unknown, column) + np.arange(3)
        rotation = Ball.joined([ball(np.ones((len(first), 1))), y[:, k] * 0.5], -1)
        conjugate = ball(second.quaternions[:, i] * np.array([1.0, -1.0, -1.0, -1.0]))
        relative = quaternion_product(quaternion_product(rotation, ball(first.quaternions[:, i])), conjugate)
        vector = relative[:, 1:] * relative[:, :1].reciprocal() * 2.0
        distance.mid[:, k], distance.rad[:, k] = vector.mid, vector.rad
    along = (ball(first.centre) - second.centre)[:, None] * second.rate
    return np.asarray(((distance - along).magnitude <= second.width).all(1))


def along_tangents(equations: ClosureEquations, segments: Segments, by: Array) -> CentreConfigurations:
    """Return approximate configurations of segments at distances (n,) from their centres, along tangents."""
    step = np.nan_to_num(segments.rate * by[:, None], posinf=0.0, neginf=0.0)
    return _moved(equations, CentreConfigurations(segments.values, segments.quaternions), step)


def halves(segments: Segments, equations: ClosureEquations) -> tuple[Array, Array, CentreConfigurations]:
    """Return ends of both halves of segments, and approximate configurations at their middles."""
    guesses = [along_tangents(equations, segments, sign * 0.5 * segments.half) for sign in (-1.0, 1.0)]
    low = np.concatenate([segments.low, segments.centre])
    return low, np.concatenate([segments.centre, segments.high]), join(guesses)
