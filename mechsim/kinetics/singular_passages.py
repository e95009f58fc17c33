"""Singular configurations through which a run passes: there its drivers do not determine the motion."""

from collections.abc import Callable
from typing import Any

import numpy as np

from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, constraint_jacobians
from mechsim.kinetics.forward_dynamics import Trajectory
from mechsim.kinetics.gaps import gaps_of
from mechsim.numerics.arrays import Array

# largest and least number of instants at which singular configurations are searched, of those in each step
# in C, and of operations
INSTANTS, LEAST, WITHIN, OPERATIONS = 1000, 200, 4, 2e8
# participation of the drivers, relative to the largest in the run, below which a minimum is refined, and
# below which the configuration is nearly singular
REFINED, SINGULAR = 0.2, 1e-2
# e above: singular values of 1e-3 still count as regular to 1e-3
SMALL = 1e-9


def singular_passages(
    equations: EquationsOfMotion, coordinates_at: Callable[[Array], Coordinates], trajectory: Trajectory
) -> tuple[float, ...]:
    """Return the instants of (nearly) singular configurations inside a run, in [s].

    The drivers' rows of the null space of the constraint Jacobian G = dPhi/dq lose rank there: the mechanism
    can move while its drivers rest, as at a dead centre or where a leg is stretched (Gosselin and Angeles,
    1990). The smallest singular value of these rows is their participation; its minima are refined. With
    the singular values s_i of G, e (G'G + e I)^-1 has the eigenvalues e / (e + s_i^2): 1 in the null space.

    Args:
        equations: equations of motion.
        coordinates_at: times (n,) in [s] -> coordinates.
        trajectory: solution of the run.
    """
    tree = equations.loops.tree
    free = [name for name in equations.model.mechanism.drivers if name not in equations.prescribed]
    # an open contact is a motion of its own
    rows = [tree.index_of[name] for name in (*free, *gaps_of(equations.model.mechanism))]
    # without a degree of freedom, motion laws determine all of it
    if not (0 < equations.rank < len(equations.free) and rows):
        return ()

    chosen = np.eye(tree.count)[equations.free][:, rows]
    # drivers beyond the degrees of freedom add zeros
    omitted = max(0, len(rows) - (len(equations.free) - equations.rank))

    def participation(times: Array) -> Array:
        jacobian = constraint_jacobians(equations, coordinates_at(times))
        regular = np.einsum("nri,nrj->nij", jacobian, jacobian) + SMALL * np.eye(len(equations.free))
        squares = SMALL * chosen.T @ np.linalg.solve(regular, chosen)
        least = np.linalg.eigvalsh(squares)[:, omitted] if len(rows) > 1 else squares[:, 0, 0]
        return np.sqrt(np.maximum(least, 0.0))

    resolved = max(LEAST, WITHIN * trajectory.steps) if trajectory.executed == "C" else INSTANTS
    count = max(20, min(INSTANTS, resolved, int(OPERATIONS / tree.count**3)))
    times = np.linspace(0.0, trajectory.end, count + 1)
    values = participation(times)
    inner, limit = values[1:-1], float(values.max())
    lowest = (inner < values[:-2]) & (inner <= values[2:]) & (inner < REFINED * limit)
    if not lowest.any():
        return ()
    from scipy.optimize import minimize_scalar

    def refined(i: int) -> Any:
        """Return the minimum between the instants next to inner one i."""
        interval = times[i], times[i + 2]
        return minimize_scalar(
            lambda t: float(participation(np.array([t]))[0]), bounds=interval, method="bounded"
        )

    minima = [refined(i) for i in np.flatnonzero(lowest).tolist()]
    return tuple(float(minimum.x) for minimum in minima if minimum.fun < SINGULAR * limit)
