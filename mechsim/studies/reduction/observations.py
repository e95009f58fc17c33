"""Observations of a scene over its motion: contacts, joint ranges, active limits, redundant equalities."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import rank
from mechsim.simulation.matrices import dense_rows
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.reduction.reduced_scene import ReducedScene
from mechsim.studies.scene.run import run_scene

# number of instants observed, evenly over the motion
SAMPLES = 600
LIMIT_JOINT, LIMIT_TENDON, EQUALITY = (
    int(kind)
    for kind in (
        mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT,
        mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON,
        mujoco.mjtConstraint.mjCNSTR_EQUALITY,
    )
)
# relative singular value of the constraint Jacobian below which it counts as zero
RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Evidence:
    """Observations of a scene over its motion.

    Attributes:
        spec: of the scene.
        scene: the scene, compiled.
        tracked: names of the bodies that carry tracked points.
        tolerance: in [m], or in [N m] or [N] if forces are the measure.
        qpos: observed states, (n, nq).
        qvel: their rates, (n, nv).
        touched: geoms that touched another.
        limited: joints and tendons that were at a limit.
        forces: actuator -> its largest force.
        redundant: equalities that the others imply.
    """

    spec: mujoco.MjSpec
    scene: ReducedScene
    tracked: frozenset[str]
    tolerance: float
    qpos: Array
    qvel: Array
    touched: frozenset[str] = frozenset()
    limited: frozenset[str] = frozenset()
    forces: Mapping[str, float] = field(default_factory=dict[str, float])
    redundant: tuple[str, ...] = ()

    @property
    def model(self) -> mujoco.MjModel:
        """The model that was run."""
        return self.scene.model

    @property
    def length(self) -> float:
        """Characteristic length of the full scene, in [m]."""
        return self.scene.characteristic_length

    def values(self, joint: str) -> Array:
        """Return a hinge's or slide's coordinate over the motion, (n,) in [rad] or [m]."""
        return self.qpos[:, int(self.model.joint(joint).qposadr[0])]

    def rates(self, joint: str) -> Array:
        """Return a hinge's or slide's rate over the motion, (n,)."""
        return self.qvel[:, int(self.model.joint(joint).dofadr[0])]


@quiet()
def observe(spec: mujoco.MjSpec, scene: ReducedScene, tracked: frozenset[str], tolerance: float) -> Evidence:
    """Run a scene over its motion and record what its elements do."""
    run = run_scene(scene, records=SAMPLES)
    model, data = scene.model, mujoco.MjData(scene.model)
    touched, limited = set[int](), set[str]()
    forces = np.zeros(model.nu)
    needed: set[int] = set()
    steps = np.round(run.time / model.opt.timestep).astype(int)
    for i, (qpos, qvel, step) in enumerate(zip(run.qpos, run.qvel, steps, strict=True)):
        control = scene.controls(model, int(step), 1)[0]
        data.qpos[:], data.qvel[:] = qpos, qvel
        data.ctrl[:], data.qfrc_applied[:] = control[: model.nu], control[model.nu :]
        mujoco.mj_forward(model, data)
        touched |= set(data.contact.geom.ravel().tolist())
        limited |= _at_limits(model, data)
        forces = np.maximum(forces, np.abs(data.actuator_force))
        if i % 20 == 0:
            needed |= _needed(model, data)
    return Evidence(
        spec,
        scene,
        tracked,
        tolerance,
        run.qpos,
        run.qvel,
        frozenset(model.geom(g).name for g in touched if g >= 0),
        frozenset(limited),
        {model.actuator(a).name: float(forces[a]) for a in range(model.nu)},
        tuple(model.equality(e).name for e in range(model.neq) if e not in needed),
    )


def _at_limits(model: mujoco.MjModel, data: mujoco.MjData) -> set[str]:
    """Return the joints and tendons at a limit."""
    names: set[str] = set()
    for kind, index in zip(data.efc_type, data.efc_id, strict=True):
        if int(kind) == LIMIT_JOINT:
            names.add(model.joint(int(index)).name)
        elif int(kind) == LIMIT_TENDON:
            names.add(model.tendon(int(index)).name)
    return names


def _needed(model: mujoco.MjModel, data: mujoco.MjData) -> set[int]:
    """Return the equalities that the others do not imply."""
    owner = np.asarray(data.efc_id)[np.asarray(data.efc_type) == EQUALITY]
    jacobian = _equality_jacobian(model, data)
    full_rank, needed = rank(jacobian, RANK_TOLERANCE, floor=0.0), set[int]()
    for equality in set(owner.tolist()):
        if rank(jacobian[owner != equality], RANK_TOLERANCE, floor=0.0) < full_rank:
            needed.add(int(equality))
    return needed


def _equality_jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Return the constraint Jacobian of the equalities, (m, nv)."""
    chosen = np.flatnonzero(np.asarray(data.efc_type) == EQUALITY)
    if not mujoco.mj_isSparse(model):
        return dense_rows(data)[chosen].copy()
    jacobian = np.zeros((len(chosen), model.nv))
    for row, i in zip(jacobian, chosen, strict=True):
        address, count = int(data.efc_J_rowadr[i]), int(data.efc_J_rownnz[i])
        row[data.efc_J_colind[address : address + count]] = data.efc_J[address : address + count]
    return jacobian
