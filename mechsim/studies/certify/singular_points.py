"""Singular points of a crank's motion, enclosed by the Krawczyk test on augmented systems.

At a dead centre the loop equations F(q, s) = 0 have a fold: F = 0, A v = 0, l v = 1 with the Jacobian A is a
regular system for q, s and the null vector v (Moore and Spence, SIAM J. Numer. Anal. 17, 1980). At a change
point two solution curves cross: F + m w = 0, A' w = 0, w F_s = 0, w w = 1 is regular for q, s, w and m
(Moore, Numer. Funct. Anal. Optim. 2, 1980). The unfolding parameter m bounds the deviation of the equations
from an exact crossing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.motion import select_instants
from mechsim.numerics.arrays import Array
from mechsim.numerics.balls import OUTWARD, Ball, DualBall, ball
from mechsim.studies.certify.computed_motion import CentreConfigurations, ComputedMotion
from mechsim.studies.certify.loop_equations import concatenated
from mechsim.studies.certify.segments import rotations

# Newton iterations on an augmented system; half-width of the first tested box, its growth factor, its limit
ITERATIONS, FIRST_WIDTH, GROWTH, MAX_WIDTH = 30, 1e-14, 8.0, 1e-3
# largest half-width of an enclosed parameter in [rad]; largest |m| of a change point
PARAMETER_WIDTH, MAX_UNFOLDING = 1e-9, 1e-12
# largest distance in [rad] between a singular point and the middle of an interval with failed tests
MAX_DISTANCE = 1e-5
# half-width of coordinates on which the equations do not depend, in their units; largest entry of a Jacobian
# that counts as zero
OTHERS, DEPENDENT = 10.0, 1e-13
# number of configurations whose Jacobians determine the unknowns in each equation
SAMPLES = 5


@dataclass(frozen=True)
class SingularPoint:
    """An enclosure of a singular configuration on the path.

    Attributes:
        parameter: path parameter.
        width: half-width of the interval that contains it.
        kind: "dead centre", "change point", or "not enclosed" if no test succeeds.
    """

    JSON: ClassVar[tuple[str, ...]] = ("at=parameter", "width", "kind")

    parameter: float
    width: float
    kind: str


Indices = NDArray[np.intp]
# variables (1, d, 1) with seeds -> residuals (1, d, 1) of an augmented system
System = Callable[[DualBall], DualBall]


@dataclass(frozen=True)
class AugmentedSystems:
    """The augmented systems at one configuration, for equations that determine a subset of the unknowns.

    Attributes:
        motion: motion of a crank.
        centre: the single configuration to which ball joint coordinates are relative.
        rows: indices of the equations, (u,).
        columns: indices of the coordinates that they determine, (u,).
        normal: row l that fixes the length of the null vector, (1, u).
    """

    motion: ComputedMotion
    centre: CentreConfigurations
    rows: Indices
    columns: Indices
    normal: Array

    def _evaluated(self, variables: DualBall) -> tuple[DualBall, DualBall, DualBall]:
        """Return F, A and F_s; the first variables are the unknown coordinates and the crank angle."""
        equations = self.motion.equations
        tree, crank = equations.tree, equations.driven[0]
        selection = np.zeros((tree.count, variables.value.shape[-2]))
        selection[self.columns, np.arange(len(self.columns))] = tree.units[self.columns]
        selection[crank, len(self.columns)] = 1.0
        others = np.setdiff1d(equations.unknown, self.columns)
        fixed, radius = self.centre.values.copy(), np.zeros(self.centre.values.shape)
        fixed[:, [*self.columns, crank]] = 0.0
        radius[:, others] = OTHERS * tree.units[others]
        q = selection @ variables + Ball(fixed[..., None], radius[..., None])
        residual, jacobian = equations.evaluate(q, rotations(equations, self.centre))
        residual, jacobian = residual[..., self.rows, :], jacobian[..., self.rows, :]
        return residual, jacobian[..., self.columns], jacobian[..., crank : crank + 1]

    def fold(self, variables: DualBall) -> DualBall:
        """Return the residuals of a fold in q, s and v."""
        residual, jacobian, _ = self._evaluated(variables)
        v = variables[..., len(self.rows) + 1 :, :]
        return concatenated([residual, jacobian @ v, self.normal @ v - 1.0], -2)

    def crossing(self, variables: DualBall) -> DualBall:
        """Return the residuals of a crossing in q, s, m and w."""
        residual, jacobian, by_crank = self._evaluated(variables)
        u = len(self.rows)
        m, w = variables[..., u + 1 : u + 2, :], variables[..., u + 2 :, :]
        return concatenated([residual + w * m, jacobian.T @ w, by_crank.T @ w, w.T @ w - 1.0], -2)


def determined_subsets(jacobians: Array) -> list[tuple[Indices, Indices]]:
    """Return rows and columns of equations that determine an equal number of unknowns, smallest sets first.

    The sets follow from the common zeros of square Jacobians (n, u, u). If several loops are singular at
    once, as in an inversor, the first of them is also singular by itself.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import maximum_bipartite_matching

    pattern: NDArray[np.bool_] = np.abs(jacobians).max(0) > DEPENDENT
    matched = maximum_bipartite_matching(csr_array(pattern), perm_type="column")
    if (matched < 0).any():
        return []
    # equation i depends on unknowns that other equations determine
    reach = pattern[:, matched] | np.eye(len(pattern), dtype=np.bool_)
    for _ in range(len(pattern)):
        reach = reach @ reach
    rows = sorted({tuple(np.flatnonzero(needed).tolist()) for needed in reach}, key=len)
    return [(np.array(subset, dtype=np.intp), matched[list(subset)]) for subset in rows]


def enclosed_singular_point(motion: ComputedMotion, approximate: float) -> SingularPoint:
    """Return the singular point nearest to a path parameter, as an enclosure or as not enclosed."""
    missing = SingularPoint(approximate, np.inf, "not enclosed")
    equations = motion.equations
    if not motion.motion_laws.crank or equations.radii:
        return missing
    samples = np.linspace(motion.low, motion.high, SAMPLES + 2)[1:-1]
    index = int(np.searchsorted(samples, approximate))
    samples = np.insert(samples, index, approximate)
    all_samples = motion.configurations(samples)
    all_samples.values[:, equations.driven] = motion.driven(samples)[0]
    _, jacobian = equations.evaluate(ball(all_samples.values[..., None]), rotations(equations, all_samples))
    jacobians = jacobian.mid[..., equations.unknown]
    start, matrix = select_instants(all_samples, slice(index, index + 1)), jacobians[index]
    for rows, columns in determined_subsets(jacobians):
        u, _, vh = np.linalg.svd(matrix[np.ix_(rows, columns)])
        unknown = equations.unknown[columns]
        systems = AugmentedSystems(motion, start, rows, unknown, vh[-1:])
        q = start.values[0, unknown] / equations.tree.units[unknown]
        candidates = (
            ("dead centre", systems.fold, [*q, approximate, *vh[-1]]),
            ("change point", systems.crossing, [*q, approximate, 0.0, *u[:, -1]]),
        )
        for kind, system, guess in candidates:
            enclosure = _enclosure(system, np.array(guess))
            if enclosure is None:
                continue
            parameter, width = float(enclosure.mid[len(q)]), float(enclosure.rad[len(q)])
            unfolding = float(enclosure.magnitude[len(q) + 1]) if kind == "change point" else 0.0
            same = abs(parameter - approximate) < MAX_DISTANCE
            if same and width < PARAMETER_WIDTH and unfolding < MAX_UNFOLDING:
                return SingularPoint(parameter, width, kind)
    return missing


def _variables(x: Ball) -> DualBall:
    return DualBall(x[None, :, None], ball(np.eye(len(x.mid))[:, None, :, None]))


def _enclosure(system: System, x: Array) -> Ball | None:
    """Return balls that are proven to contain a solution of the system, from a guess (d,); else None."""
    inverse: Array = np.eye(len(x))
    for _ in range(ITERATIONS):
        result = system(_variables(ball(x)))
        matrix = result.derivative.mid[:, 0, :, 0].T
        if not np.isfinite(matrix).all() or np.linalg.matrix_rank(matrix) < len(x):
            return None
        inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        step = inverse @ result.value.mid[0, :, 0]
        x = x - step
        if np.abs(step).max() < FIRST_WIDTH:
            break
    offset = ball(inverse) @ system(_variables(ball(x))).value[0]
    width = np.full((len(x), 1), FIRST_WIDTH)
    while width.max() < MAX_WIDTH:
        box = system(_variables(Ball(x, width[:, 0])))
        enclosed = box.derivative[:, 0, :, 0].T
        contraction = (np.eye(len(x)) - ball(inverse) @ enclosed).magnitude
        image = (offset.magnitude + contraction @ width * OUTWARD) * OUTWARD
        if (image < width).all():
            return Ball(x, image[:, 0])
        width = GROWTH * np.maximum(image, width)
    return None
