"""Branch points of a path: location between nodes, segments through them, and the other branch."""

from dataclasses import replace

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.collocation import Interpolant, nodes_between
from mechsim.numerics.loop_solver import MIN_SHARE_RATIO, E, Linearised, Q
from mechsim.numerics.path_segments import PathStates, Segment

# largest and smallest half length of a segment centred on a change point
MAX_HALF_LENGTH, MIN_HALF_LENGTH = 0.1, 5e-4
# nodes of such a segment; even, so that none lies at the change point, where the Jacobian is singular
NODES = 24
# largest truncation error of its polynomial, in [rad] or relative to the characteristic length
MAX_TRUNCATION = 1e-11
# first and last spacing of the points at which the signed distance is sampled to locate a change point
FIRST_SPACING, LAST_SPACING = 1e-3, 3e-7
# step along the null direction for second differences; smallest curvature ratio at which the crank moves the
# other branch; largest deviation of that branch from its prediction, relative to the distance between the
# branches; and number of halvings of the segment
OFFSET, MIN_CURVATURE, MAX_DEVIATION, HALVINGS = 1e-4, 1e-6, 0.3, 6


def change_point_between(path: PathStates[E, Q], segment: Segment[E, Q], a: float, b: float) -> float | None:
    """Return the change point between two nodes; None if assembly modes only approach each other.

    The result is also None if only the selected equations become dependent. With equal signs at both nodes
    the determinant touches zero: two pairs of modes meet at once.
    """

    def linearised_at(s: Array) -> Linearised | None:
        closed = path.closed(segment.solver, s, segment.evaluate(s))
        return None if closed is None else closed.linearised

    at_ends = linearised_at(np.array([a, b])) if abs(b - a) > LAST_SPACING else None
    if at_ends is None:
        return None
    signed_distances = at_ends.signed_distance
    same_side = bool(signed_distances[0] * signed_distances[1] > 0.0)

    def signed(linearised: Linearised, s: Array) -> Array:
        return np.where(
            same_side & ((s - root) * (b - a) > 0.0), -linearised.signed_distance, linearised.signed_distance
        )

    signed_distances = signed_distances * np.array([1.0, -1.0 if same_side else 1.0])
    root, rate = a - signed_distances[0] * (b - a) / (signed_distances[1] - signed_distances[0]), 0.0
    for spacing in (min(0.1 * abs(b - a), FIRST_SPACING), 0.03 * FIRST_SPACING):
        # a parabola through three points on either side of the estimated root
        around = root + spacing * np.array([-2.0, -1.0, 1.0, 2.0])
        linearised = linearised_at(around)
        if linearised is None:
            return None
        distances = signed(linearised, around)
        if not np.all(np.sign(distances[[0, 1]]) == -np.sign(distances[[2, 3]])):
            return None
        parabola = np.polynomial.Polynomial.fit((around - root) / spacing, distances, 2)
        roots = parabola.roots()
        real = roots[np.abs(roots.imag) < 1e-12].real
        if not len(real):
            return None
        rate = float(parabola.deriv()(0.0)) / spacing
        root += spacing * float(real[np.argmin(np.abs(real))])
    nearest = root + LAST_SPACING * np.array([-2.0, -1.0, 1.0, 2.0])
    linearised_near = linearised_at(nearest)
    if (
        linearised_near is None
        or segment.solver.share(linearised_near).min() < MIN_SHARE_RATIO * segment.solver.share(at_ends).max()
    ):
        return None
    expected = rate * (nearest - root)
    return (
        root
        if np.abs(signed(linearised_near, nearest) - expected).max() < 0.2 * abs(rate) * LAST_SPACING
        else None
    )


def segment_through(
    path: PathStates[E, Q], segment: Segment[E, Q], change_point: float, direction: int
) -> tuple[Segment[E, Q], float] | None:
    """Return the longest valid segment centred on a change point, and the refined change point; or None.

    Args:
        path: path of the poses.
        segment: segment that extends to both sides of the change point.
        change_point: its approximate parameter.
        direction: direction of continuation, +1 or -1.
    """
    max_half_length, half_length = abs(float(segment.nodes[-1] - segment.nodes[0])), MAX_HALF_LENGTH
    while half_length > MIN_HALF_LENGTH:
        if half_length <= max_half_length:
            nodes, weights = nodes_between(
                change_point - direction * half_length, change_point + direction * half_length, NODES
            )
            closed = path.closed(segment.solver, nodes, segment.evaluate(nodes))
            if closed is not None:
                signs = np.sign(closed.linearised.signed_distance)
                same_sign = abs(signs.sum()) == NODES
                sign_change = abs((signs * np.sign(nodes - change_point)).sum()) == NODES
                candidate = Segment(nodes, closed.states, weights, segment.solver)
                if (same_sign or sign_change) and candidate.truncation_error() < MAX_TRUNCATION:
                    values = np.linalg.det(closed.linearised.matrix)
                    determinants = replace(candidate, states=values[:, None])
                    vanishing = determinants.derivative() if same_sign else determinants
                    return candidate, _root_near(vanishing, change_point)
        half_length *= 0.5
    return None


def _root_near(determinants: Interpolant, guess: float) -> float:
    """Return a root of a polynomial (k, 1) by Newton's method; the guess if the method diverges from it."""
    root, derivative = np.array([guess]), determinants.derivative()
    for _ in range(3):
        root = root - determinants.evaluate(root)[0] / derivative.evaluate(root)[0]
    # with a null space of more than one dimension the derivative of the determinant vanishes
    return float(root[0]) if abs(root[0] - guess) < LAST_SPACING else guess


def branch_segment(
    path: PathStates[E, Q], segment: Segment[E, Q], change_point: float
) -> Segment[E, Q] | None:
    """Return the segment of the other branch about a change point.

    The determinant keeps its sign beyond the change point. The result is None if the crank does not move the
    other branch.

    Args:
        path: path of the poses.
        segment: segment centred on the change point.
        change_point: its parameter.
    """
    steepness = _branch_tangent(path, segment, change_point)
    if steepness is None:
        return None
    half_length = float(segment.nodes[-1]) - change_point
    for _ in range(HALVINGS):
        nodes, weights = nodes_between(change_point - half_length, change_point + half_length, NODES)
        offset = (nodes - change_point)[:, None] * steepness
        same_branch = path.closed(segment.solver, nodes, segment.evaluate(nodes))
        other_branch = path.closed(segment.solver, nodes, segment.evaluate(nodes) + offset)
        if same_branch is not None and other_branch is not None:
            candidate = Segment(nodes, other_branch.states, weights, segment.solver)
            distances = [branch.linearised.signed_distance for branch in (same_branch, other_branch)]
            deviation = np.abs(other_branch.states - segment.evaluate(nodes) - offset).max(1)
            near_prediction = (deviation < MAX_DEVIATION * np.abs(offset).max(1)).all()
            if (
                near_prediction
                and (distances[0] * distances[1] < 0.0).all()
                and candidate.truncation_error() < MAX_TRUNCATION
            ):
                return candidate
        half_length *= 0.5
    return None


def _branch_tangent(path: PathStates[E, Q], segment: Segment[E, Q], change_point: float) -> Array | None:
    """Return the difference of the derivatives of both branches at a change point, (w,); None if unbounded.

    Projected on the null directions, the loop equations are z (a x + b z) = 0, where x is the distance beyond
    the change point and z the displacement along the null direction. z = 0 is this branch, z = -a x / b the
    other.
    """
    parameter = np.array([change_point])
    q = path.unflat(segment.evaluate(parameter), parameter)
    loops, solver = path.loops, segment.solver
    u, _, vh = np.linalg.svd(solver.linearise(q).matrix[0])
    left_null_vector, null_direction = u[:, -1], np.zeros((loops.count, 1))
    null_direction[loops.unknown, 0] = vh[-1]

    def projected(rows: Q) -> Array:
        return solver.linearise(rows).matrix @ vh[-1] @ left_null_vector

    displaced = [loops.displaced(q, sign * OFFSET * null_direction) for sign in (1.0, -1.0)]
    beyond = parameter + OFFSET * np.array([1.0, -1.0])
    a = float(np.diff(projected(path.unflat(segment.evaluate(beyond), beyond))[::-1])[0])
    b = 0.5 * float(projected(displaced[0])[0] - projected(displaced[1])[0])
    if not abs(b) > MIN_CURVATURE * abs(a):
        return None
    return -a / b * (path.loops.flat(displaced[0]) - path.loops.flat(displaced[1]))[0] / (2.0 * OFFSET)
