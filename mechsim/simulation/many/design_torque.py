"""The torque that drives stepped designs, from MuJoCo's own constraint forces."""

import copy

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.applied_forces import rigid_forces, soften
from mechsim.simulation.many.design_fields import Fields, loosened
from mechsim.simulation.many.design_models import Rows
from mechsim.simulation.many.stepped_designs import SteppedDesigns
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recorded_motion import CHUNK

OFF = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


def design_torque(stepped: SteppedDesigns, rows: Rows, records: Rows, compliance: float) -> Array:
    """Return the drive torque of some designs at some records, (designs, records) in [N m].

    As `dynamics.efforts.efforts_of` has it for one: what M q'' takes at the crank beyond gravity, gyroscopic
    forces and those of the constraints, the flywheel not counted.

    Args:
        stepped: designs with real inertias.
        rows: which of them.
        records: which of the recorded instants.
        compliance: factor on the inverse weights of the constraints, as they were stepped.
    """
    step = max(1, CHUNK // len(records))
    parts = [rows[first : first + step] for first in range(0, len(rows), step)]
    return np.concatenate([_torque(stepped, part, records, compliance) for part in parts])


def _torque(stepped: SteppedDesigns, rows: Rows, records: Rows, compliance: float) -> Array:
    model = copy.copy(stepped.loops.model)
    factor = soften(model, compliance)
    own = {name: one[rows] for name, one in stepped.fields.items()}
    for name in ("body_invweight0", "dof_invweight0"):
        own[name] = factor * own[name]
    seen = "qacc", "qfrc_constraint"
    driven = rigid_forces(
        lambda force: _looked(stepped, model, own, rows, records, seen, force),
        len(rows) * len(records),
        model.nv,
    )
    # without constraints and flywheel
    free = copy.copy(stepped.models.like.closed.model)
    free.opt.disableflags |= int(OFF)
    plain = {name: one[rows] for name, one in stepped.models.fields.items()}
    loosened(free, plain)
    whole = _looked(stepped, free, plain, rows, records, ("M", "qfrc_smooth"))
    crank = stepped.loops.crank
    spent = (_row(free, whole["M"], crank) * driven["qacc"]).sum(1)
    torque = spent - whole["qfrc_smooth"][:, crank] - driven["qfrc_constraint"][:, crank]
    return torque.reshape(len(rows), len(records))


def _looked(
    stepped: SteppedDesigns,
    model: mujoco.MjModel,
    fields: Fields,
    rows: Rows,
    records: Rows,
    names: tuple[str, ...],
    force: Array | None = None,
) -> Fields:
    """Return MuJoCo's fields at states of designs, a row a state, under generalised forces (n, nv)."""
    wide = {name: np.repeat(one, len(records), 0) for name, one in fields.items()}
    loops: ModelLoops = stepped.loops.with_fields(wide)
    at = np.ix_(rows, records)
    n = len(rows) * len(records)
    sims = loops.posed.simulations(model, n, 1)
    sims.bind("qpos")[:], sims.bind("qvel")[:] = (
        stepped.qpos[at].reshape(n, -1),
        stepped.qvel[at].reshape(n, -1),
    )
    if force is not None:
        sims.bind("qfrc_applied")[:] = force
    found = {name: sims.bind(name) for name in names}
    sims.forward()
    return {name: np.array(one) for name, one in found.items()}


def _row(model: mujoco.MjModel, sparse: Array, dof: int) -> Array:
    """Return a row of mass matrices that MuJoCo keeps sparse, below their diagonals, (n, nv)."""
    row = np.zeros((len(sparse), model.nv))
    for other in range(model.nv):
        first, count = int(model.M_rowadr[other]), int(model.M_rownnz[other])
        columns = model.M_colind[first : first + count]
        if other == dof:
            row[:, columns] = sparse[:, first : first + count]
        elif dof in columns:
            row[:, other] = sparse[:, first + int(np.flatnonzero(columns == dof)[0])]
    return row
