"""Static determinacy: the components of joint forces and moments that the loop constraints determine."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import significant
from mechsim.numerics.rounding import ROUNDING
from mechsim.simulation.dynamics.applied_forces import coupling_forces, loop_forces, together
from mechsim.simulation.dynamics.inverse_dynamics import loaded_state, row_scale
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.dynamics.reactions import transmitted
from mechsim.simulation.poses import follow
from mechsim.simulation.recording import States

# joint -> whether fx, fy, fz, mx, my, mz is determined, (6,)
DeterminedComponents = Mapping[str, NDArray[np.bool_]]

# crank angle between two evaluated poses, in [rad], and number of poses
STEP, POSES = 0.05, 4


def determined_components(loaded: LoadedModel) -> DeterminedComponents:
    """Return which components of the joints' forces and moments the loop constraints determine."""
    determined = {joint.name: np.ones(6, dtype=np.bool_) for joint in loaded.mechanism.joints}
    qpos = follow.follow(loaded.loops, loaded.qpos, loaded.angle + _rotated(loaded))
    jacobian = loaded.loops.linearise(qpos)[1]
    rows = jacobian.shape[1]
    if not rows:
        return determined
    scale = row_scale(loaded, rows)
    u, values, _ = np.linalg.svd(jacobian * scale[:, None] * loaded.loops.units)
    rank = int(significant(values).sum(1).min())
    if rank == rows:
        return determined
    n = len(qpos)
    state = loaded_state(loaded, States(np.zeros(n), qpos, np.zeros((n, loaded.model.nv))))
    units = np.array([1.0] * 3 + [loaded.mechanism.characteristic_length] * 3)

    def carried(multipliers: Array) -> dict[str, Array]:
        stressed = together(
            loop_forces(loaded, state.plain, multipliers),
            coupling_forces(loaded, state.plain, state.jacobian, multipliers),
        )
        fields = loaded.look(loaded.looking(native=False), state.states, stressed)
        transmitted_forces = {
            joint.name: transmitted(loaded, joint, fields, multipliers) for joint in loaded.mechanism.joints
        }
        return {
            name: np.concatenate([stresses.force, stresses.moment], 1) / units
            for name, stresses in transmitted_forces.items()
        }

    alone = carried(np.zeros((n, rows)))
    for k in range(rank, rows):
        stressed = carried(scale * u[:, :, k] * loaded.loops.characteristic_length)
        for name, stresses in stressed.items():
            determined[name] &= np.abs(stresses - alone[name]).max(0) <= ROUNDING
    return determined


def _rotated(loaded: LoadedModel) -> Array:
    """Return the crank angles of reachable poses relative to the closed state, (n,) in [rad]."""
    displaced = STEP * np.arange(float(POSES))
    for sign in (1.0, -1.0):
        try:
            follow.follow(loaded.loops, loaded.qpos, loaded.angle + sign * displaced)
        except AssemblyError:
            continue
        return sign * displaced
    return np.zeros(1)
