"""A scene stepped in plain MuJoCo over its motion, the steps in C, and what was recorded of it."""

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from mujoco import batch

from mechsim.model.limits import MAX_SCENE_STEPS, require_steps
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.scene.scene import UserScene

# steps in one call into C
BLOCK = 4096
TIME = int(mujoco.mjtState.mjSTATE_TIME)
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
# instants recorded after the first where nothing else is asked
RECORDS = 400


@dataclass(frozen=True)
class SceneRun:
    """What was recorded of a run.

    Attributes:
        scene: that was run.
        model: with which it was.
        time: of the records in [s], (n,); time zero is the first.
        qpos: (n, nq).
        qvel: (n, nv).
        seconds: processor time of the steps, of this thread: that of a process under a limit tells
            milliseconds only.
        steps: taken.
        broken: why the run is none, in words; empty where it is one.
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
        """Processor time of a simulated second; infinite where it broke."""
        return np.inf if self.broken else self.seconds / (self.steps * float(self.model.opt.timestep))

    @cached_property
    def points(self) -> Array:
        """The tracked points, (n, k, 3) in [m]."""
        sims = batch.Batch(self.model, len(self.qpos), 1)
        position, matrix = sims.bind("xpos"), sims.bind("xmat")
        sims.bind("qpos")[:] = self.qpos
        with quiet():
            sims.forward(stage=int(mujoco.mjtStage.mjSTAGE_POS))
        matrix = matrix.reshape(*matrix.shape[:2], 3, 3)
        places = self.scene.places.values()
        found = [position[:, body] + matrix[:, body] @ local for body, local in places]
        return np.stack(found, 1) if found else np.empty((len(self.qpos), 0, 3))

    @cached_property
    def velocities(self) -> Array:
        """The tracked points' velocities, (n, k, 3) in [m/s]."""
        sims = batch.Batch(self.model, len(self.qpos), 1)
        sims.bind("qpos")[:] = self.qpos
        with quiet():
            found = [
                np.einsum("nij,nj->ni", sims.jac(body, self.points[:, k])[0], self.qvel)
                for k, (body, _) in enumerate(self.scene.places.values())
            ]
        return np.stack(found, 1) if found else np.empty((len(self.qpos), 0, 3))

    @cached_property
    def efforts(self) -> Array:
        """Forces of the actuators, then what prescribes each joint, (n, nu + driven) in [N m] and [N]."""
        model, scene = self.model, self.scene
        data, dofs = mujoco.MjData(model), scene.driven_dofs
        controls, forces = scene.prescribed(self.time)
        out = np.empty((len(self.time), model.nu + len(dofs)))
        moved, own = np.empty(model.nv), np.array([scene.wheels[name][1] for name in scene.drive])
        with quiet():
            for i, row in enumerate(out):
                data.qpos[:], data.qvel[:] = self.qpos[i], self.qvel[i]
                data.ctrl[:], data.qfrc_applied[:] = controls[i], forces[i]
                mujoco.mj_forward(model, data)
                row[: model.nu] = data.actuator_force
                if len(dofs):
                    mujoco.mj_rne(model, data, 1, moved)
                    given = data.qfrc_passive + data.qfrc_constraint + data.qfrc_actuator
                    row[model.nu :] = (moved - given)[dofs] + own * data.qacc[dofs]
        return out


@quiet()
def stepped(
    scene: UserScene,
    model: mujoco.MjModel | None = None,
    *,
    records: int | None = RECORDS,
    duration: float | None = None,
    held: float = 0.0,
) -> SceneRun:
    """Step a scene over its motion.

    Args:
        scene: to run.
        model: its model with other settings; None for that of the scene.
        records: about so many are kept after the first; None keeps every step.
        duration: in [s], in place of the scene's.
        held: when in a step a control is its program's value, 0 to 1; as a loop in Python has it, 0.
    """
    model = scene.model if model is None else model
    timestep = float(model.opt.timestep)
    lasts = duration or scene.duration
    what = f"{scene.path}: a motion of {lasts:g} s with a time step of {timestep:g} s"
    require_steps(what, lasts / timestep, "give a shorter --duration or longer steps", MAX_SCENE_STEPS)
    total = max(1, int(np.ceil(lasts / timestep - 1e-6)))
    stride = 1 if records is None else max(1, total // records)
    sims = batch.Batch(model, 1, 1)
    start = mujoco.MjData(model)
    if scene.key is not None:
        mujoco.mj_resetDataKeyframe(model, start, model.key(scene.key).id)
        for name in ("act", "mocap_pos", "mocap_quat"):
            sims.bind(name)[:] = getattr(start, name)
    sims.bind("qpos")[:], sims.bind("qvel")[:] = scene.start
    kept: list[tuple[Array, Array, Array]] = [(np.zeros(1), scene.start[0][None], scene.start[1][None])]
    done, spent, broken = 0, 0.0, ""
    while done < total and not broken:
        count = min(BLOCK, total - done)
        control = scene.controls(model, done, count, held)[None]
        begin = clock.thread_time()
        out = sims.rollout(count, control=control, control_spec=CONTROL, record=("qpos", "qvel", TIME))
        spent += clock.thread_time() - begin
        number = np.arange(done + 1, done + count + 1)
        rows = np.flatnonzero((number % stride == 0) | (number == total))
        number, (qpos, qvel, time) = number[rows], (values[0, rows] for values in out.values())
        # MuJoCo sets a bad state back to time zero
        good = np.isfinite(qpos).all(1) & np.isfinite(qvel).all(1) & (time[:, 0] > timestep * (number - 0.5))
        kept.append((np.asarray(timestep * number[good], dtype=np.float64), qpos[good], qvel[good]))
        if not good.all() or sims.warning[..., 1].any():
            broken = f"MuJoCo's state went bad after {kept[-1][0][-1:].max(initial=timestep * done):.6g} s"
        done += count
    time, qpos, qvel = (np.concatenate(parts) for parts in zip(*kept, strict=True))
    return SceneRun(scene, model, time, qpos, qvel, spent, done, broken)


# of processor time that a run is to take at least, in [s]: clocks tell no less
LEAST = 0.01
# runs of a short motion in a round, at most, unless the clock tells nothing of them
MOST = 8
ROUNDS = 5


def step_times(
    runs: Sequence[tuple[UserScene, mujoco.MjModel]],
    rounds: int = ROUNDS,
    tell: Callable[[float], None] = lambda _: None,
) -> Array:
    """Return the processor time of a simulated second of each model, (models,) in [s].

    In each round every model is run once, in a new order, so that a slow minute of the machine falls on all;
    what counts is the median of the rounds.

    Args:
        runs: scenes, and models with which they run.
        rounds: how many.
        tell: told what part is done.
    """
    random = np.random.default_rng(0)
    times = np.full((rounds + 1, len(runs)), np.nan)
    for number in range(rounds + 1):  # the first is thrown away: it fills the caches
        for i in random.permutation(len(runs)):
            times[number, i] = _once(*runs[i])
        tell((number + 1) / (rounds + 1))
    return np.median(times[1:], axis=0)


def _once(scene: UserScene, model: mujoco.MjModel) -> float:
    spent, simulated, runs = 0.0, 0.0, 0
    while not spent > 0.0 or (spent < LEAST and runs < MOST):
        runs += 1
        run = stepped(scene, model, records=2)
        if run.broken:
            return np.inf
        spent += run.seconds
        simulated += run.steps * float(model.opt.timestep)
    return spent / simulated
