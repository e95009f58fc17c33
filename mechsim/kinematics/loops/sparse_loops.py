"""Loop equations of many coordinates as sparse systems, for steps of least norm, null spaces, multipliers."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim.kinematics.loops.constraints import TreeLoops
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses
from mechsim.numerics.arrays import Array
from mechsim.numerics.banded import LeastNormSystems, SparseMatrices, least_norm_systems
from mechsim.numerics.loop_solver import LoopSystem
from mechsim.numerics.rank import RANK_TOLERANCE, least_norm


def loop_systems(
    loops: TreeLoops, q: Coordinates, poses: LinkPoses | None = None
) -> tuple[Array, LeastNormSystems | None]:
    """Return residuals (rows, n) and the Jacobians by the unknowns as sparse systems; None if not banded."""
    residual, jacobian, _ = loops.sparse(q, poses)
    unknown = np.full(loops.count, -1)
    unknown[loops.unknown] = np.arange(len(loops.unknown))
    columns = unknown[jacobian.columns]
    own = columns >= 0
    shape = loops.rows, len(loops.unknown)
    entries = SparseMatrices(jacobian.rows[own], columns[own], jacobian.values[own], shape)
    return residual, least_norm_systems(entries, loops.bands)


@dataclass(frozen=True)
class SparseStep:
    """Loop equations linearised about n configurations, for `newton.newton`.

    Attributes:
        loops: the equations.
        q: the configurations.
        rhs: residuals, (n, rows).
        systems: the equations that are not zero; None if they are not banded.
        tolerance: fraction of the largest singular value below which others are zero in dense equations.
    """

    loops: TreeLoops
    q: Coordinates
    rhs: Array
    systems: LeastNormSystems | None
    tolerance: float = RANK_TOLERANCE

    @property
    def matrix(self) -> Array:
        """Jacobians by the unknowns, (n, rows, unknowns)."""
        return self.loops.linearise(self.q)[1][:, self.loops.unknown].transpose(2, 0, 1)

    def solution(self, right: Array, /) -> Array:
        """Return the solutions of least norm, (n, unknowns), of right sides (n, rows)."""
        if self.systems is None:
            return least_norm(self.matrix, right, self.tolerance)
        steps, valid = self.systems.least_norm(right[:, self.systems.rows])
        if not valid.all():
            others = replace(self, q=self.q.select(~valid), rhs=right[~valid], systems=None)
            steps[~valid] = others.solution(right[~valid])
        return steps


@dataclass(frozen=True)
class SparseLoops(LoopSystem[Coordinates]):
    """Loop equations for `newton.newton`, whose steps are of least norm.

    Attributes:
        tolerance: as that of the steps.
    """

    loops: TreeLoops
    tolerance: float = RANK_TOLERANCE

    def linearise(self, q: Coordinates, /) -> Any:
        """Return the equations linearised about n configurations."""
        residual, systems = loop_systems(self.loops, q)
        return SparseStep(self.loops, q, residual.T, systems, self.tolerance)
