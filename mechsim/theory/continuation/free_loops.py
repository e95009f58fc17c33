"""The loop equations of a mechanism with free drivers, and the corrector that follows their solutions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.loop_solver import LoopSolver
from mechsim.analytic.loops.numerical_rank import significant
from mechsim.analytic.loops.tree_loops import TreeLoops, orthogonal
from mechsim.analytic.loops.tree_motion import Coordinates, LinkPoses
from mechsim.numerics.arrays import Array
from mechsim.theory.continuation.pose_features import PoseFeatures, all_rates, pose_features, split_motion

# residual of a converged pose, and limit on Newton steps
MAX_RESIDUAL, MAX_STEPS = 1e-12, 8
# Newton step, in radians or relative to the characteristic length, beyond which the corrector gives up
MAX_STEP = 0.3


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

    def flat(self, coordinates: Coordinates) -> Array:
        """Return coordinates as rows of numbers, (n, w)."""
        values = (coordinates.values / self.loops.units[:, None]).T
        return np.concatenate([values, coordinates.turns.reshape(-1, len(coordinates)).T], 1)

    def unflat(self, rows: Array) -> Coordinates:
        """Return coordinates from approximate rows of numbers, with the exact values of locked coordinates.

        Extrapolation changes locked coordinates by rounding, and no equation would correct them.
        """
        k = self.loops.tree.count
        values = rows[:, :k].T * self.loops.units[:, None]
        values[[*self.loops.driven]] = self.locked_values[:, None]
        turns = np.ascontiguousarray(rows[:, k:].T).reshape(-1, 3, 3, len(rows))
        if len(turns):
            turns = np.stack([orthogonal(orthogonal(matrix)) for matrix in turns])
        return Coordinates(values, turns)

    def solver(self, coordinates: Coordinates, direction: Array | None) -> LoopSolver:
        """Return a solver about one set of coordinates; its first null-space vector is the tangent."""
        from scipy.linalg import qr

        _, jacobian, poses = self.loops.linearise(coordinates)
        jacobian = jacobian[:, self.loops.unknown]
        tangent, idle = split_motion(self.loops, poses, np.linalg.svd(jacobian[..., 0])[2][self.rank :])
        if direction is not None and tangent @ direction < 0.0:
            tangent = -tangent
        rows = np.zeros(0, dtype=np.intp)
        if self.rank:
            pivoted: Any = qr(jacobian[..., 0].T, mode="economic", pivoting=True)
            rows = np.sort(pivoted[2][: self.rank])
        return LoopSolver(self.loops, rows, np.vstack([tangent, idle]), coordinates)

    def close(self, solver: LoopSolver, guess: Coordinates) -> CorrectedNodes | None:
        """Return a guess corrected perpendicular to the curve; None where Newton's method fails."""
        coordinates, system = guess, solver.linearise(guess)
        length, before = system.rhs[:, self.rank].copy(), np.inf
        for _ in range(MAX_STEPS):
            right = system.rhs.copy()
            right[:, self.rank] -= length
            worst = float(np.abs(right).max())
            if worst <= 1e-15 or (worst < 1e-13 and worst > 0.1 * before):
                break
            before = worst
            try:
                step = solver.step(system.matrix, right)
            except np.linalg.LinAlgError:
                return None
            if not np.abs(step).max() < MAX_STEP:
                return None
            coordinates = self.loops.displaced(coordinates, step)
            system = solver.linearise(coordinates)
        if not np.abs(system.residual).max(initial=0.0) < MAX_RESIDUAL:
            return None
        ahead = np.zeros(system.matrix.shape[1])
        ahead[self.rank] = 1.0
        try:
            right = np.broadcast_to(ahead[:, None], (len(coordinates), len(ahead), 1))
            along = np.linalg.solve(system.matrix, right)[..., 0].astype(np.float64, copy=False)
        except np.linalg.LinAlgError:
            return None
        rates = self.features.rates(system.poses, all_rates(self.loops, along))
        least = self.singular_value(system.jacobian)
        side = np.linalg.slogdet(system.matrix)[0]
        return CorrectedNodes(
            coordinates, self.features.values(system.poses), rates, along, length, least, side
        )

    def singular_value(self, jacobian: Array) -> Array:
        """Return the singular value of Jacobians (rows, count, n) that vanishes at branch points, (n,)."""
        if not self.rank:
            return np.ones(jacobian.shape[2])
        by_unknowns = jacobian[:, self.loops.unknown].transpose(2, 0, 1)
        values = np.linalg.svd(by_unknowns, compute_uv=False)[:, self.rank - 1]
        return values.astype(np.float64, copy=False)

    def corrected(self, solver: LoopSolver, rows: Array, singular: NDArray[np.bool_]) -> LinkPoses:
        """Return the poses of approximate rows corrected to rounding level; singular ones stay unchanged."""
        coordinates = self.unflat(rows)
        system = solver.linearise(coordinates)
        for _ in range(2):
            right = np.where(singular[:, None], 0.0, system.rhs)
            right[:, self.rank :] = 0.0
            matrix = np.where(singular[:, None, None], np.eye(system.matrix.shape[1]), system.matrix)
            coordinates = self.loops.displaced(coordinates, solver.step(matrix, right))
            system = solver.linearise(coordinates)
        return system.poses

    def nearest_singularity(
        self, rows: Callable[[Array], Array], low: float, high: float
    ) -> tuple[float, float, float]:
        """Return the pose nearest to a branch point between two arcs.

        Args:
            rows: arc (n,) -> flattened coordinates.
            low: arc at one end.
            high: arc at the other.

        Returns:
            The arc, the singular value that vanishes at a branch point, and the residual along its left
            singular vector.
        """
        best = 0.5 * (low + high)
        lower, upper = low, high
        for _ in range(11):
            arcs = np.linspace(lower, upper, 25)
            jacobian = self.loops.linearise(self.unflat(rows(arcs)))[1]
            i = int(np.argmin(self.singular_value(jacobian)))
            best = float(arcs[i])
            lower, upper = float(arcs[max(i - 2, 0)]), float(arcs[min(i + 2, 24)])
        residual, jacobian, _ = self.loops.linearise(self.unflat(rows(np.array([best]))))
        u, values, _ = np.linalg.svd(jacobian[:, self.loops.unknown, 0])
        return best, float(values[self.rank - 1]), float(abs(u[:, self.rank - 1] @ residual[:, 0]))


def free_loops(loops: TreeLoops, coordinates: Coordinates) -> FreeLoops:
    """Return the equations with free drivers about one set of closed coordinates.

    Raises:
        MobilityError: unless exactly one degree of freedom besides passive ones is undetermined there.
    """
    _, jacobian, poses = loops.linearise(coordinates)
    _, values, right = np.linalg.svd(jacobian[:, loops.unknown, 0])
    rank = int(significant(values).sum())
    _, idle = split_motion(loops, poses, right[rank:])
    return FreeLoops(
        loops,
        coordinates.values[[*loops.driven], 0],
        rank,
        pose_features(loops.tree, poses, all_rates(loops, idle)),
    )
