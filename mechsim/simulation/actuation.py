"""The degrees of freedom that a stepped run moves by forces: drivers, and nonlinear couplings of them."""

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.simulation.equality_rows import CouplingConstraint, chained, rates
from mechsim.simulation.model_loops import ModelLoops


def followers(loops: ModelLoops) -> list[CouplingConstraint]:
    """Return the nonlinear couplings of coordinates that depend on the drivers only."""
    return [row for row in _chain(loops) if row.nonlinear]


def actuated_dofs(loops: ModelLoops) -> NDArray[np.int64]:
    """Return the DOFs that forces move: the crank or all drivers, then nonlinear followers."""
    nonlinear = [int(row.left.dofs[0]) for row in followers(loops)]
    return np.array([*loops.driven_dofs, *nonlinear], dtype=np.int64)


def actuated_rates(loops: ModelLoops, angle: Array, speed: Array) -> Array:
    """Return the rates of `actuated_dofs`, (n, k), at angles and speeds of the crank, (n,)."""
    values, speeds = {loops.crank_address: angle}, {loops.crank: speed}
    if loops.drivers is not None:
        value, rate, _ = loops.drivers.law(angle)
        values |= dict(zip(loops.drivers.addresses.tolist(), value, strict=True))
        speeds |= dict(zip(loops.drivers.dofs.tolist(), rate * speed, strict=True))
    chained_rates = rates(_chain(loops), values, speeds)
    return np.stack([chained_rates[int(dof)] for dof in actuated_dofs(loops)], 1)


def _chain(loops: ModelLoops) -> list[CouplingConstraint]:
    return chained(loops.couplings, loops.driven_dofs.tolist())
