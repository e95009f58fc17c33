"""Choice between dense and sparse matrices in MuJoCo's constraint solver, by speed and agreement.

MuJoCo 4.0.0 factorises some sparse matrices wrongly (fixed in 4.0.1): in 19 of 400 random chains with random
loops the accelerations were wrong by up to 140 times their magnitude, without a warning. The sparsity pattern
of a model whose only constraints are equalities is constant, so one comparison suffices.
"""

from typing import Literal

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array

Jacobian = Literal["dense", "sparse"]
KINDS: dict[Jacobian, int] = {
    "dense": int(mujoco.mjtJacobian.mjJAC_DENSE),
    "sparse": int(mujoco.mjtJacobian.mjJAC_SPARSE),
}
# below this number of DOFs, or above this fraction of nonzero entries, sparse matrices are at most a tenth
# quicker (validation/choices/matrices.py)
SPARSE_MIN_DOFS, SPARSE_MAX_FILL = 40, 0.25
# difference of accelerations, relative to the largest, above which it is not rounding
AGREEMENT_TOLERANCE = 1e-6


def quicker(model: mujoco.MjModel) -> Jacobian:
    """Return the quicker kind of matrices for a model whose only constraints are equalities."""
    if model.nv < SPARSE_MIN_DOFS:
        return "dense"
    before = int(model.opt.jacobian)
    try:
        dense, filled = look(model, "dense")
        if filled > SPARSE_MAX_FILL:
            return "dense"
        sparse, _ = look(model, "sparse")
    finally:
        model.opt.jacobian = before
    agree = float(np.abs(sparse - dense).max()) <= AGREEMENT_TOLERANCE * float(np.abs(dense).max())
    return "sparse" if agree else "dense"


def look(model: mujoco.MjModel, kind: Jacobian) -> tuple[Array, float]:
    """Return the accelerations, (nv,), at distinct rates, and the fraction of nonzero matrix entries."""
    model.opt.jacobian = KINDS[kind]
    data = mujoco.MjData(model)
    data.qvel[:] = np.sin(np.arange(model.nv) + 1.0)
    mujoco.mj_forward(model, data)
    filled = np.nan
    if kind == "dense":
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        touched = (dense_rows(data) != 0.0).astype(np.float64)
        filled = float(((inertia != 0.0) | (touched.T @ touched > 0.0)).mean())
    return data.qacc.copy(), filled


def dense_rows(data: mujoco.MjData) -> Array:
    """Return the Jacobian of the constraints of a model that keeps it dense, (nefc, nv).

    MuJoCo's array is longer where constraints without effect were left out.
    """
    nv = data.model.nv
    return data.efc_J[: data.nefc * nv].reshape(data.nefc, nv)
