"""Steps of Newton's method that close the loops of a model and move its degrees of freedom least."""

from collections.abc import Sequence

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import SPARSE, least_norm
from mechsim.simulation.loop_jacobian import Step
from mechsim.simulation.model_loops import ModelLoops


def nearest_steps(loops: ModelLoops, locked: Sequence[int] = ()) -> Step:
    """Return steps in which some degrees of freedom keep their values, for `loop_jacobian.close`."""
    free = np.delete(np.arange(loops.model.nv), np.array(locked, dtype=np.intp))
    solve = least_norm
    if len(free) >= SPARSE:
        from mechsim.numerics.banded import sparse_least_norm as solve

    def step(jacobian: Array, residual: Array) -> Array:
        result = np.zeros((len(jacobian), loops.model.nv))
        matrix = jacobian[:, :, free] * loops.scale[..., None] * loops.units[free]
        result[:, free] = loops.units[free] * solve(matrix, residual)
        return result

    return step
