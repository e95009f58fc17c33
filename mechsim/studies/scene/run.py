"""Runs of a scene in plain MuJoCo: the recorded motion, and the processor time of a simulated second."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from mujoco import batch

from mechsim.mechanism.limits import MAX_SCENE_STEPS, require_steps
from mechsim.numerics.arrays import Array, worst
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.coordinates import actuator_names
from mechsim.simulation.state import SCALAR, PointJacobians, PosedBodies
from mechsim.simulation.stepping import rollout
from mechsim.studies.scene.exact_closure import points_on
from mechsim.studies.scene.scene import UserScene

# default number of records after the first
RECORDS = 400
# largest number of records; forces are interpolated between them
MAX_REFERENCE_RECORDS = 4000
# processor time in [s] below which a measurement is repeated, and largest number of repetitions
MIN_MEASURED_TIME, MAX_REPETITIONS = 0.01, 8
TIMING_ROUNDS = 5
# fraction of a step by which rounding moves an instant that is a multiple of the step
STEP_ROUNDING = 1e-6


@dataclass(frozen=True)
class SceneRun:
    """The recorded motion of a scene.

    Attributes:
        scene: the scene.
        model: its model with the settings of the run.
        time: instants of the records in [s], (n,); the first is zero.
        qpos: coordinates, (n, nq).
        qvel: velocities, (n, nv).
        seconds: processor time of the steps in this thread, in [s].
        steps: number of steps.
        broken: reason for an early end; empty for a complete run.
    """

    scene: UserScene
    model: mujoco.MjModel
    time: Array
    qpos: Array
    qvel: Array
    seconds: float
    steps: int
    broken: str = ""

    @property
    def seconds_per_second(self) -> float:
        """Processor time of a simulated second; infinite for a diverged run."""
        return np.inf if self.broken else self.seconds / (self.steps * float(self.model.opt.timestep))

    @cached_property
    def nodes(self) -> "SceneRun":
        """The run with at most about `MAX_REFERENCE_RECORDS` records."""
        rows = slice(None, None, max(1, len(self.time) // MAX_REFERENCE_RECORDS))
        return replace(self, time=self.time[rows], qpos=self.qpos[rows], qvel=self.qvel[rows])

    @cached_property
    def points(self) -> Array:
        """Positions of the tracked points, (n, k, 3) in [m]."""
        position, rotation, _ = self._kinematics
        return points_on(position, rotation, self.scene.tracked.values())

    @property
    def coordinates(self) -> dict[str, Array]:
        """Coordinates of hinges and slides, (n,) each in [rad] or [m]."""
        # the first joints of a mechanism are those of its model
        joints = zip(self.scene.mechanism.joints, self.model.jnt_type, self.model.jnt_qposadr, strict=False)
        return {joint.name: self.qpos[:, address] for joint, kind, address in joints if kind in SCALAR}

    @property
    def displacement_range(self) -> float:
        """Largest distance of a tracked point from its initial position, in [m]."""
        return worst(np.linalg.norm(self.points - self.points[0], axis=2))

    @cached_property
    def velocities(self) -> Array:
        """Velocities of the tracked points, (n, k, 3) in [m/s]."""
        jacobian = self._kinematics[2]
        velocities = [
            np.einsum("nij,nj->ni", jacobian(body, self.points[:, k])[0], self.qvel)
            for k, (body, _) in enumerate(self.scene.tracked.values())
        ]
        return np.stack(velocities, 1) if velocities else np.empty((len(self.qpos), 0, 3))

    @cached_property
    @quiet()
    def _kinematics(self) -> tuple[Array, Array, PointJacobians]:
        """Positions and rotations of the bodies, and Jacobians of points."""
        return PosedBodies(self.model).poses(self.qpos)

    @cached_property
    def forces(self) -> Array:
        """Forces of actuators, then drive forces of prescribed joints, (n, nu + driven) in [N m] or [N]."""
        model, scene = self.model, self.scene
        data, dofs = mujoco.MjData(model), scene.driven_dofs
        controls, applied = scene.inputs_at(self.time)
        out = np.empty((len(self.time), model.nu + len(dofs)))
        inertial = np.empty(model.nv)
        armatures = np.array([scene.drive_inertias[name][1] for name in scene.joint_laws])
        with quiet():
            for i, row in enumerate(out):
                data.qpos[:], data.qvel[:] = self.qpos[i], self.qvel[i]
                data.ctrl[:], data.qfrc_applied[:] = controls[i], applied[i]
                mujoco.mj_forward(model, data)
                row[: model.nu] = data.actuator_force
                if len(dofs):
                    mujoco.mj_rne(model, data, 1, inertial)
                    others = data.qfrc_passive + data.qfrc_constraint + data.qfrc_actuator
                    row[model.nu :] = (inertial - others)[dofs] + armatures * data.qacc[dofs]
        return out

    @property
    def forces_by_name(self) -> Mapping[str, Array]:
        """The forces by actuator, and by prescribed joint as "drive of JOINT", (n,) each."""
        names = [*actuator_names(self.model), *(f"drive of {name}" for name in self.scene.joint_laws)]
        return dict(zip(names, self.forces.T, strict=True))


@quiet()
def run_scene(
    scene: UserScene,
    model: mujoco.MjModel | None = None,
    *,
    records: int | None = RECORDS,
    duration: float | None = None,
    phase: float = 0.0,
) -> SceneRun:
    """Step a scene over its motion.

    Args:
        scene: the scene.
        model: its model with other settings; None for the scene's own model.
        records: approximate number of records after the first; None for every step.
        duration: in [s]; None for the duration of the scene.
        phase: fraction of a step, 0 to 1, at which motion laws are evaluated; 0 for a loop in Python.
    """
    model = scene.model if model is None else model
    timestep = float(model.opt.timestep)
    seconds = duration or scene.duration
    what = f"{scene.path}: a motion of {seconds:g} s with a time step of {timestep:g} s"
    require_steps(what, seconds / timestep, "give a shorter --duration or longer steps", MAX_SCENE_STEPS)
    total = max(1, int(np.ceil(seconds / timestep - STEP_ROUNDING)))
    interval = 1 if records is None else max(1, total // records)
    sims = batch.Batch(model, 1, 1)
    start = mujoco.MjData(model)
    if scene.key is not None:
        mujoco.mj_resetDataKeyframe(model, start, model.key(scene.key).id)
        for name in ("act", "mocap_pos", "mocap_quat"):
            sims.bind(name)[:] = getattr(start, name)

    def controls(steps: slice) -> Array:
        return scene.controls(model, steps.start, steps.stop - steps.start, phase)[None]

    run = rollout(sims, timestep, scene.start, total, interval, controls)
    states = run.states
    broken = f"MuJoCo's state became invalid after {states.time[-1]:.6g} s" if run.diverged else ""
    return SceneRun(scene, model, states.time, states.qpos, states.qvel, run.processor, run.count, broken)


def step_times(
    runs: Sequence[tuple[UserScene, mujoco.MjModel]],
    rounds: int = TIMING_ROUNDS,
) -> Array:
    """Return the processor time of a simulated second of each model, (models,) in [s].

    Each round runs every model once in a new order, so that a slow period of the computer affects all. The
    median over the rounds is returned.

    Args:
        runs: scenes and their models.
        rounds: number of rounds.
    """
    random = np.random.default_rng(0)
    times = np.full((rounds + 1, len(runs)), np.nan)
    for number in range(rounds + 1):  # the first round fills the caches and is discarded
        for i in random.permutation(len(runs)):
            times[number, i] = _time_of(*runs[i])
    return np.median(times[1:], axis=0)


def _time_of(scene: UserScene, model: mujoco.MjModel) -> float:
    spent, simulated, runs = 0.0, 0.0, 0
    while not spent > 0.0 or (spent < MIN_MEASURED_TIME and runs < MAX_REPETITIONS):
        runs += 1
        run = run_scene(scene, model, records=2)
        if run.broken:
            return np.inf
        spent += run.seconds
        simulated += run.steps * float(model.opt.timestep)
    return spent / simulated
