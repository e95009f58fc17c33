"""Dense or sparse matrices in MuJoCo's constraint solver: which are quicker, and whether they agree.

MuJoCo 4.0.0 factorises some sparse matrices wrongly (mended in 4.0.1): in 19 of 400 random chains with
random loops the accelerations were off by up to 140 times their size, and nothing warned. The pattern of
a model whose only constraints are equalities never changes, so one look tells.
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
# below so many freedoms, or where more than this part of the matrix is filled, sparse is no quicker by
# more than a tenth, or slower (validation/choices/matrices.py)
FREEDOMS, FILLED = 40, 0.25
# accelerations that differ by more than this part of the largest differ by more than rounding
SAME = 1e-6


def quicker(model: mujoco.MjModel) -> Jacobian:
    """Return which matrices a model whose only constraints are equalities is better stepped with."""
    if model.nv < FREEDOMS:
        return "dense"
    before = int(model.opt.jacobian)
    try:
        dense, filled = look(model, "dense")
        if filled > FILLED:
            return "dense"
        sparse, _ = look(model, "sparse")
    finally:
        model.opt.jacobian = before
    agree = float(np.abs(sparse - dense).max()) <= SAME * float(np.abs(dense).max())
    return "sparse" if agree else "dense"


def look(model: mujoco.MjModel, kind: Jacobian) -> tuple[Array, float]:
    """Return the accelerations, (nv,), at rates like no others, and what part of the matrix is filled."""
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

    MuJoCo's array is longer where rows moved nothing and were left out.
    """
    nv = data.model.nv
    return data.efc_J[: data.nefc * nv].reshape(data.nefc, nv)
