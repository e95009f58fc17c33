"""The velocity-product terms of nonlinear constraints, which MuJoCo leaves out of its equalities."""

from collections.abc import Generator
from contextlib import contextmanager
from threading import RLock

import mujoco
import numpy as np

from mechsim.simulation.equality_rows import CouplingConstraint, RodPair
from mechsim.simulation.model_loops import ModelLoops

EQUALITY, JOINT = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY), int(mujoco.mjtEq.mjEQ_JOINT)

# held while callbacks are installed, which are global: the runs of several threads take turns
CALLBACKS = RLock()


def nonlinear_rows(loops: ModelLoops) -> list[CouplingConstraint | RodPair]:
    """Return the couplings and rods with velocity-product terms."""
    every, active = (*loops.couplings, *loops.rods), loops.model.eq_active0
    return [row for row in every if row.nonlinear and active[row.equality]]


@contextmanager
def velocity_products(loops: ModelLoops) -> Generator[None]:
    """Install a callback for nonlinear couplings and rods, and restore the previous one.

    It adds their velocity-product terms. MuJoCo makes a joint coupling q = f(p) compliant in proportion to
    1/m_q + 1/m_p with the inertias of both coordinates; the callback corrects this to 1/m_q + f'(p)^2 / m_p.
    A light cam under a preloaded follower, on a dwell, would otherwise yield as if it carried the load.
    """
    nonlinear = nonlinear_rows(loops)
    rows: list[int] = []

    # MuJoCo calls this after it computes the constraint violations and before it computes accelerations
    def opened(_: mujoco.MjModel, data: mujoco.MjData) -> None:
        if not rows:
            constrained = np.where(data.efc_type == EQUALITY, data.efc_id, -1).tolist()
            rows.extend(constrained.index(coupling.equality) for coupling in nonlinear)
        qpos, qvel = data.qpos[None], data.qvel
        for coupling, row in zip(nonlinear, rows, strict=True):
            stiffness, _, impedance, _ = data.efc_KBIP[row]
            if isinstance(coupling, RodPair):
                data.efc_pos[row] += coupling.stretching(data) / (stiffness * impedance)
                continue
            assert coupling.right is not None
            rate = float(qvel[coupling.right.dofs] @ coupling.right.weights)
            (_,), (first,), (second,) = coupling.values(coupling.right.value(qpos))
            data.efc_pos[row] -= second * rate**2 / (stiffness * impedance)
            data.efc_R[row] *= _mobility_ratio(loops.model, coupling, first)
            data.efc_D[row] = 1.0 / data.efc_R[row]

    with CALLBACKS:
        before = mujoco.get_mjcb_passive()
        mujoco.set_mjcb_passive(opened if nonlinear else before)
        try:
            yield
        finally:
            mujoco.set_mjcb_passive(before)


def _mobility_ratio(model: mujoco.MjModel, coupling: CouplingConstraint, rate: float) -> float:
    """Return the mobility of a coupling of two joints by its derivative, relative to that of derivative 1."""
    if coupling.right is None or model.eq_type[coupling.equality] != JOINT:
        return 1.0
    left, right = (model.dof_invweight0[side.dofs[0]] for side in (coupling.left, coupling.right))
    return float((left + rate**2 * right) / (left + right))
