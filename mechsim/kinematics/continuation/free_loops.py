"""The loop equations of a mechanism with free drivers, and the corrector that follows their solutions."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import MobilityError
from mechsim.kinematics.loops.constraints import TreeLoops, TreeSolver
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses, twists
from mechsim.kinematics.loops.path import regularised
from mechsim.kinematics.loops.tree import SpanningTree
from mechsim.kinematics.vector_method.vectors import array_cross as cross
from mechsim.mechanism.links import GROUND
from mechsim.numerics.arrays import CLOSED, Array
from mechsim.numerics.loop_solver import NEARBY, Linearised
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.peaks import PEAK_POINTS, peak
from mechsim.numerics.rank import pivot_columns, right_vectors, significant

# component of a unit motion below which a coordinate or a point is at rest
REST = 1e-6


@dataclass(frozen=True, slots=True)
class PoseFeatures:
    """Points and directions of links that determine each link's pose up to passive rotation.

    A link without passive motion contributes its origin, divided by the characteristic length, and its axes,
    divided by sqrt 2, so that the norm of their rates is the norm of its twist. A link that can rotate
    passively contributes its points on the axis of that rotation.

    Attributes:
        tree: of the mechanism.
        links: index of the link of each feature, (k,).
        local: point or direction in the link's frame, (3, k).
        is_point: whether it is a point; otherwise a direction, (k,).
        weights: factor on each, (k,).
    """

    tree: SpanningTree
    links: NDArray[np.intp]
    local: Array
    is_point: NDArray[np.bool_]
    weights: Array

    def values(self, poses: LinkPoses) -> Array:
        """Return the features of n poses, (n, 3 k)."""
        features = self._placed(poses)
        return (features * self.weights[:, None]).reshape(-1, features.shape[2]).T

    def rates(self, poses: LinkPoses, rates: Array) -> Array:
        """Return the rates of the features, (n, 3 k), at coordinate rates (count, n) in SI."""
        twist = twists(self.tree, poses, rates)[self.links].transpose(1, 0, 2)
        derivatives = np.where(self.is_point[:, None], twist[:3], 0.0) + cross(twist[3:], self._placed(poses))
        return (derivatives * self.weights[:, None]).reshape(-1, derivatives.shape[2]).T

    def _placed(self, poses: LinkPoses) -> Array:
        """Return the points and directions in the ground frame, (3, k, n)."""
        rotated = np.einsum("kijn,jk->ikn", poses.rotation[self.links], self.local)
        origins = poses.position[self.links].transpose(1, 0, 2)
        return rotated + np.where(self.is_point[:, None], origins, 0.0)


def pose_features(tree: SpanningTree, poses: LinkPoses, idle: Array) -> PoseFeatures:
    """Return the features of a mechanism whose passive motions at one pose are (count, idle) in SI."""
    mechanism, length = tree.mechanism, tree.mechanism.characteristic_length
    spins = np.zeros(len(mechanism.links), dtype=np.bool_)
    if idle.shape[1]:
        twist = np.abs(twists(tree, poses, idle)).max(2)
        spins = np.maximum(twist[:, :3].max(1) / length, twist[:, 3:].max(1)) > REST
    rows: list[tuple[int, tuple[float, ...], bool, float]] = []
    # after a round of a closed curve its parameter has another value at the same pose
    parameters = {mechanism.joint(name).b.link for name in tree.closed_parameters}
    for i, link in enumerate(mechanism.links):
        if link.name in parameters:
            continue
        if not spins[i]:
            rows.append((i, (0.0, 0.0, 0.0), True, 1.0 / length))
            rows += [(i, tuple(axis), False, np.sqrt(0.5)) for axis in np.eye(3).tolist()]
            continue
        points = [end.point for end in mechanism.ends(link.name)]
        points += [point for name, point in mechanism.points.values() if name == link.name]
        rows += [(i, point, True, 1.0 / length) for point in dict.fromkeys(points)]
    links, local, is_point, weights = zip(*rows, strict=True)
    features = PoseFeatures(tree, np.array(links), np.array(local).T, np.array(is_point), np.array(weights))
    if not idle.shape[1]:
        return features
    at_rest = np.abs(features.rates(poses, idle)).max(0).reshape(3, -1).max(0) <= REST
    return PoseFeatures(
        tree,
        features.links[at_rest],
        features.local[:, at_rest],
        features.is_point[at_rest],
        features.weights[at_rest],
    )


def all_rates(loops: TreeLoops, directions: Array) -> Array:
    """Return rates of all coordinates in SI, (count, n), from scaled rates of the unknowns, (n, u)."""
    rates = np.zeros((loops.tree.count, len(directions)))
    rates[loops.unknown] = directions.T * loops.units[loops.unknown, None]
    return rates


def split_motion(loops: TreeLoops, poses: LinkPoses, free: Array) -> tuple[Array, Array]:
    """Split the null space into the motion of joint coordinates or tracked points and the passive motions.

    Args:
        loops: of the mechanism, its drivers free.
        poses: one pose.
        free: orthonormal null-space basis of the unknowns in their units, (dofs, unknowns).

    Returns:
        The motion, (unknowns,), and the passive ones, (dofs - 1, unknowns).

    Raises:
        MobilityError: where more than one direction moves any of them, or none does.
    """
    tree, mechanism = loops.tree, loops.tree.mechanism
    rates = all_rates(loops, free)
    addresses = list(tree.index_of.values())
    twist = twists(tree, poses, rates)
    observed = [rates[addresses] / loops.units[addresses, None]]
    for link, local in mechanism.points.values():
        if link != GROUND:
            i = tree.links[link]
            arm = poses.position[i] + np.einsum("ijn,j->in", poses.rotation[i], np.array(local))
            observed.append((twist[i, :3] + cross(twist[i, 3:], arm)) / mechanism.characteristic_length)
    _, values, right = np.linalg.svd(np.concatenate(observed), full_matrices=True)
    count = int((values > REST).sum())
    if count == 1:
        return right[0] @ free, right[1:] @ free
    if count == 0:
        raise MobilityError(
            f"{mechanism.name} has no degree of freedom, so there is no curve to trace; add one",
            "overdetermined",
        )
    raise MobilityError(
        f"{mechanism.name}: {count} degrees of freedom are undetermined, and a curve has one; "
        f"lock or couple {count - 1} of them",
        "underdetermined",
    )


# a branch point has a singular value below this fraction of the largest, and a residual of at most this
SINGULAR_RATIO, MAX_RESIDUAL = 1e-7, 2e-13
# multiple of its largest change between two arcs of a grid that it does not lose between them
MAX_CHANGES = 4.0
# relative error of the singular values of nodes, which only show where to search for a branch point
NODE_ERROR = 1e-2
# Newton's method from the prediction of a node, to rounding; and two steps from a pose that is interpolated
CORRECTOR = NewtonSettings(tolerance=1e-15, max_displacement=NEARBY.max_displacement)
FINAL = NewtonSettings(max_iterations=2, last_step=0.0)


@dataclass(frozen=True)
class PlacedNodes:
    """The equations of nodes at given lengths along the tangent of a solver, for `numerics.newton`.

    Attributes:
        solver: the equations; its first null-space vector is the tangent.
        rank: number of independent equations: the row after them measures the length.
        length: of each node, (n,).
    """

    solver: TreeSolver
    rank: int
    length: Array

    def linearise(self, q: Coordinates) -> Linearised:
        """Return the equations linearised about n configurations."""
        linearised = self.solver.linearise(q)
        linearised.rhs[:, self.rank] -= self.length
        return linearised

    def retract(self, q: Coordinates, step: Array) -> Coordinates:
        """Return configurations displaced by steps of the unknowns, (n, u)."""
        return self.solver.retract(q, step)


@dataclass(frozen=True)
class PerpendicularNodes:
    """The equations of nodes that move perpendicular to a curve, for `numerics.newton`.

    Attributes:
        solver: the equations.
        rank: number of independent ones; those after them do not count.
        singular: nodes that do not move, (n,).
    """

    solver: TreeSolver
    rank: int
    singular: NDArray[np.bool_]

    def linearise(self, q: Coordinates) -> Linearised:
        """Return the equations linearised about n configurations."""
        linearised = self.solver.linearise(q)
        linearised.rhs[:, self.rank :] = linearised.rhs[self.singular] = 0.0
        if not self.singular.any():
            return linearised
        return replace(linearised, systems=regularised(linearised.matrix, self.singular))

    def retract(self, q: Coordinates, step: Array) -> Coordinates:
        """Return configurations displaced by steps of the unknowns, (n, u)."""
        return self.solver.retract(q, step)


@dataclass(frozen=True, slots=True)
class CorrectedNodes:
    """Corrected nodes of a curve.

    Attributes:
        coordinates: of the nodes.
        features: of their poses, (n, 3 k).
        rates: derivatives of the features by the solver's path parameter, (n, 3 k).
        tangents: rates of the unknown coordinates in their units, (n, unknowns).
        length: the solver's path parameter, (n,).
        singular_values: that vanish at branch points, (n,).
        determinant_sign: changes at a branch point, (n,).
    """

    coordinates: Coordinates
    features: Array
    rates: Array
    tangents: Array
    length: Array
    singular_values: Array
    determinant_sign: Array


@dataclass(frozen=True)
class FreeLoops:
    """The equations of a mechanism with one degree of freedom, whose solutions are a curve.

    Attributes:
        loops: its equations, no driver prescribed.
        locked_values: of the locked coordinates, (locks,) in [m] or [rad].
        rank: number of independent equations.
        features: identify poses.
    """

    loops: TreeLoops
    locked_values: Array
    rank: int
    features: PoseFeatures

    def unflat(self, rows: Array) -> Coordinates:
        """Return coordinates from approximate rows of numbers, with the exact values of locked coordinates.

        Extrapolation changes locked coordinates by rounding, and no equation would correct them.
        """
        return self.loops.unflat(rows, self.locked_values[:, None])

    def solver(
        self, coordinates: Coordinates, direction: Array, before: TreeSolver | None = None
    ) -> TreeSolver:
        """Return a solver about one set of coordinates; its first null-space vector is the tangent.

        Args:
            coordinates: the coordinates.
            direction: of the unknowns, in which the tangent points.
            before: solver about a set nearby, whose equations are the only ones of many in a band.
        """
        system = None if before is None or before.band is None else before.linearise(coordinates)
        if before is not None and system is not None and system.others_vanish:
            rows, poses = before.rows, system.poses
            ahead = np.eye(len(before.null_space), len(self.loops.unknown), self.rank)
            free = np.linalg.qr(system.solution(ahead).T)[0].T
        else:
            _, jacobian, poses = self.loops.linearise(coordinates)
            jacobian = jacobian[:, self.loops.unknown, 0]
            free = right_vectors(jacobian)[1][self.rank :]
            rows = np.zeros(0, dtype=np.intp)
            if self.rank:
                rows = np.sort(pivot_columns(jacobian.T)[0][: self.rank])
        tangent, idle = split_motion(self.loops, poses, free)
        if tangent @ direction < 0.0:
            tangent = -tangent
        return TreeSolver(self.loops, rows, np.vstack([tangent, idle]), coordinates)

    def close(self, solver: TreeSolver, guess: Coordinates) -> CorrectedNodes | None:
        """Return a guess corrected perpendicular to the curve; None where Newton's method fails."""
        length = self.loops.along(guess, solver.reference.repeated(len(guess)), solver.null_space)[0][:, 0]
        try:
            result = newton(PlacedNodes(solver, self.rank, length), guess, CORRECTOR)
        except np.linalg.LinAlgError:
            return None
        coordinates, system = result.q, result.linearised
        largest = float(np.abs(system.residual).max(initial=0.0))
        if not (largest < CLOSED and np.isfinite(result.displacement).all()):
            return None
        ahead = np.zeros_like(system.rhs)
        ahead[:, self.rank] = 1.0
        try:
            along = system.solution(ahead)
        except np.linalg.LinAlgError:
            return None
        rates = self.features.rates(system.poses, all_rates(self.loops, along))
        features, least = self.features.values(system.poses), system.smallest_of_all(self.rank, NODE_ERROR)
        return CorrectedNodes(coordinates, features, rates, along, length, least, system.determinant[0])

    def corrected(
        self, solver: TreeSolver, rows: Array, singular: NDArray[np.bool_]
    ) -> tuple[Coordinates, LinkPoses]:
        """Return approximate rows corrected to rounding level, and their poses; singular ones stay."""
        result = newton(PerpendicularNodes(solver, self.rank, singular), self.unflat(rows), FINAL)
        return result.q, result.linearised.poses

    def branch_point(
        self, solver: TreeSolver, rows: Callable[[Array], Array], low: float, high: float, largest: float
    ) -> float | None:
        """Return the arc of the branch point between two arcs; None if there is none.

        Args:
            solver: solves the poses between them.
            rows: arc (n,) -> flattened coordinates.
            low: arc at one end.
            high: arc at the other.
            largest: maximum of the singular value that vanishes at a branch point.
        """

        def singularity(arcs: Array) -> Array:
            return -solver.linearise(self.unflat(rows(arcs))).smallest_of_all(self.rank)

        grid = np.linspace(low, high, PEAK_POINTS)
        values = singularity(grid)
        if -values.max() > MAX_CHANGES * np.abs(np.diff(values)).max():
            return None
        best, negative = peak(singularity, grid)
        if not -negative < SINGULAR_RATIO * largest:
            return None
        residual, jacobian, _ = self.loops.linearise(self.unflat(rows(np.array([best]))))
        u, _, _ = np.linalg.svd(jacobian[:, self.loops.unknown, 0])
        return best if abs(u[:, self.rank - 1] @ residual[:, 0]) < MAX_RESIDUAL else None


def free_loops(loops: TreeLoops, coordinates: Coordinates) -> FreeLoops:
    """Return the equations with free drivers about one set of closed coordinates.

    Raises:
        MobilityError: unless exactly one degree of freedom besides passive ones is undetermined there.
    """
    _, jacobian, poses = loops.linearise(coordinates)
    values, right = right_vectors(jacobian[:, loops.unknown, 0])
    rank = int(significant(values).sum())
    _, idle = split_motion(loops, poses, right[rank:])
    return FreeLoops(
        loops,
        coordinates.values[[*loops.driven], 0],
        rank,
        pose_features(loops.tree, poses, all_rates(loops, idle)),
    )
