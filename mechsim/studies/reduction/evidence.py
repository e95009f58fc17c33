"""What parts of a scene did over its motion: what touched, how far joints went, which rows held."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.matrices import dense_rows
from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.reduction.lean_scene import LeanScene
from mechsim.studies.scenes.scene_run import stepped

# instants looked at, evenly over the motion
LOOKS = 600
LIMIT_JOINT, LIMIT_TENDON, EQUALITY = (
    int(kind)
    for kind in (
        mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT,
        mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON,
        mujoco.mjtConstraint.mjCNSTR_EQUALITY,
    )
)
# a singular value of the rows below this part of the largest is none
RANK = 1e-6


@dataclass(frozen=True)
class Evidence:
    """What was seen of a scene over its motion.

    Attributes:
        spec: of the scene.
        scene: the scene, compiled.
        tracked: names of the bodies that carry tracked points.
        bound: the tolerance in [m], or in [N m] or [N] where efforts count.
        qpos: states looked at, (n, nq).
        qvel: their rates, (n, nv).
        touched: geoms that touched another.
        limited: joints and tendons that were at a limit.
        efforts: actuator -> its largest force.
        redundant: equalities whose rows the others say already.
        row: equality -> how many rows it has.
    """

    spec: mujoco.MjSpec
    scene: LeanScene
    tracked: frozenset[str]
    bound: float
    qpos: Array
    qvel: Array
    touched: frozenset[str] = frozenset()
    limited: frozenset[str] = frozenset()
    efforts: Mapping[str, float] = field(default_factory=dict[str, float])
    redundant: tuple[str, ...] = ()

    @property
    def model(self) -> mujoco.MjModel:
        """The model that was run."""
        return self.scene.model

    @property
    def size(self) -> float:
        """Yardstick of the full scene's lengths, in [m]."""
        return self.scene.size

    def values(self, joint: str) -> Array:
        """Return a hinge's or slide's coordinate over the motion, (n,) in [rad] or [m]."""
        return self.qpos[:, int(self.model.joint(joint).qposadr[0])]

    def rates(self, joint: str) -> Array:
        """Return a hinge's or slide's rate over the motion, (n,)."""
        return self.qvel[:, int(self.model.joint(joint).dofadr[0])]


@quiet()
def evidence(spec: mujoco.MjSpec, scene: LeanScene, tracked: frozenset[str], bound: float) -> Evidence:
    """Run a scene over its motion and look at what its parts do."""
    run = stepped(scene, records=LOOKS)
    model, data = scene.model, mujoco.MjData(scene.model)
    touched, limited = set[int](), set[str]()
    efforts = np.zeros(model.nu)
    needed: set[int] = set()
    steps = np.round(run.time / model.opt.timestep).astype(int)
    for i, (qpos, qvel, step) in enumerate(zip(run.qpos, run.qvel, steps, strict=True)):
        control = scene.controls(model, int(step), 1)[0]
        data.qpos[:], data.qvel[:] = qpos, qvel
        data.ctrl[:], data.qfrc_applied[:] = control[: model.nu], control[model.nu :]
        mujoco.mj_forward(model, data)
        touched |= set(data.contact.geom.ravel().tolist())
        limited |= _at_limits(model, data)
        efforts = np.maximum(efforts, np.abs(data.actuator_force))
        if i % 20 == 0:
            needed |= _needed(model, data)
    return Evidence(
        spec,
        scene,
        tracked,
        bound,
        run.qpos,
        run.qvel,
        frozenset(model.geom(g).name for g in touched if g >= 0),
        frozenset(limited),
        {model.actuator(a).name: float(efforts[a]) for a in range(model.nu)},
        tuple(model.equality(e).name for e in range(model.neq) if e not in needed),
    )


def _at_limits(model: mujoco.MjModel, data: mujoco.MjData) -> set[str]:
    """Return the joints and tendons that stand at a limit."""
    found: set[str] = set()
    for kind, of in zip(data.efc_type, data.efc_id, strict=True):
        if int(kind) == LIMIT_JOINT:
            found.add(model.joint(int(of)).name)
        elif int(kind) == LIMIT_TENDON:
            found.add(model.tendon(int(of)).name)
    return found


def _needed(model: mujoco.MjModel, data: mujoco.MjData) -> set[int]:
    """Return the equalities some row of which no other equality says."""
    of = np.asarray(data.efc_id)[np.asarray(data.efc_type) == EQUALITY]
    rows = _rows(model, data)
    rank, found = _rank(rows), set[int]()
    for equality in set(of.tolist()):
        if _rank(rows[of != equality]) < rank:
            found.add(int(equality))
    return found


def _rows(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the rows of the equalities, (m, nv)."""
    chosen = np.flatnonzero(np.asarray(data.efc_type) == EQUALITY)
    if not mujoco.mj_isSparse(model):
        return dense_rows(data)[chosen].copy()
    rows = np.zeros((len(chosen), model.nv))
    for row, i in zip(rows, chosen, strict=True):
        place, count = int(data.efc_J_rowadr[i]), int(data.efc_J_rownnz[i])
        row[data.efc_J_colind[place : place + count]] = data.efc_J[place : place + count]
    return rows


def _rank(rows: Array) -> int:
    values = np.linalg.svd(rows, compute_uv=False) if len(rows) else np.zeros(1)
    return int((values > RANK * max(float(values[0]), 1e-300)).sum()) if len(rows) else 0
