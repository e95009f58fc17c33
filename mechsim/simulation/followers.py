"""Coordinates that couplings alone tie to the crank or the drivers: how they go is known before stepping.

MuJoCo's constraint asks for accelerations that leave out the bend of a coupling's polynomial. A coordinate
that bends with the crank is therefore stepped as the crank is, by flywheel and force, without its constraint.
"""

from collections.abc import Sequence

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.loop_constraints import CouplingConstraint, Sum


def chained(couplings: Sequence[CouplingConstraint], driven: Sequence[int]) -> list[CouplingConstraint]:
    """Return the couplings of one coordinate each that follow from driven freedoms, in their order."""
    known, chain, waiting = {*driven}, list[CouplingConstraint](), list(couplings)
    while True:
        found = next((one for one in waiting if _follows(one, known)), None)
        if found is None:
            return chain
        waiting = [one for one in waiting if one is not found]  # arrays have no plain equality
        chain.append(found)
        known.add(int(found.left.dofs[0]))


def _follows(coupling: CouplingConstraint, known: set[int]) -> bool:
    if coupling.right is None or len(coupling.left.dofs) != 1 or int(coupling.left.dofs[0]) in known:
        return False
    return {int(dof) for dof in coupling.right.dofs} <= known


def rates(
    chain: Sequence[CouplingConstraint], values: dict[int, Array], speeds: dict[int, Array]
) -> dict[int, Array]:
    """Return the rates of all coordinates of a chain, freedom -> (n,).

    Args:
        chain: from `chained`.
        values: of what is driven: place in qpos -> (n,) in [m] or [rad].
        speeds: of what is driven: freedom -> (n,) in [m/s] or [rad/s].
    """
    values, speeds = dict(values), dict(speeds)
    for one in chain:
        assert one.right is not None
        weight, place, dof = float(one.left.weights[0]), int(one.left.addresses[0]), int(one.left.dofs[0])
        wanted, slope = one.evaluate(_sum(one.right, values))
        values[place] = one.left.zeros[0] + wanted / weight
        right = sum(w * speeds[int(of)] for of, w in zip(one.right.dofs, one.right.weights, strict=True))
        speeds[dof] = np.asarray(slope * right / weight)
    return speeds


def _sum(side: Sum, values: dict[int, Array]) -> Array:
    parts = zip(side.addresses, side.zeros, side.weights, strict=True)
    return np.sum([weight * (values[int(place)] - zero) for place, zero, weight in parts], axis=0)
