"""Forces of rigid constraints, from MuJoCo's soft ones.

A soft constraint's force falls short of a rigid one's by a part that grows with the softness and with how
little its rows weigh. MuJoCo asked again, with the force found acting from outside, finds what is lacking,
short by the same part; and rounding of the first answer is mended with it.
"""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array

# factor on MuJoCo's inverse weights at which forces are looked for. Harder, rounding over it is left where
# rows repeat each other; softer, two passes leave 1e-3 near a dead centre
# (validation/robustness/torque_scale.py)
SOFTNESS = 1e-5
# steps of Newton's method in each pass, and passes
ITERATIONS, PASSES = 10, 3
# of the correction before it: a third that is no smaller part is rounding
SHRINKING = 0.1


def soften(model: mujoco.MjModel, compliance: float) -> float:
    """Make a model's constraints fit to look for their forces.

    Args:
        model: compiled; its inverse weights are multiplied.
        compliance: factor on them so far.

    Returns:
        The factor by which they were multiplied, 1 or more.
    """
    factor = max(1.0, SOFTNESS / compliance)
    model.body_invweight0[:] *= factor
    model.dof_invweight0[:] *= factor
    model.opt.iterations = ITERATIONS
    return factor


def rigid_forces(
    look: Callable[[Array], Mapping[str, Array]], states: int, freedoms: int
) -> dict[str, Array]:
    """Return what MuJoCo makes of states whose constraints are rigid, with "qfrc_constraint" their force.

    Args:
        look: MuJoCo's fields of the states under generalised forces (n, nv) beside what acts otherwise.
        states: their number n.
        freedoms: nv.
    """
    force = np.zeros((states, freedoms))
    fields, before = look(force), np.full(states, np.inf)
    for number in range(PASSES):
        if number:
            fields = look(force)
        lacking = fields["qfrc_constraint"]
        size = np.abs(lacking).max(1, initial=0.0)
        good = (size < SHRINKING * before) | (number < 2)
        force, before = force + np.where(good[:, None], lacking, 0.0), size
    return {**fields, "qfrc_constraint": force}
