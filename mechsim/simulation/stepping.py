"""Time stepping in MuJoCo under a driven crank or driven joints."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter, thread_time

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.mechanism.motion_laws import CrankProfile, MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import Progress, no_progress, require_memory
from mechsim.simulation import recording
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recording import States
from mechsim.simulation.settings import Settings, set_armature
from mechsim.simulation.state import SLIDE

# steps per call into C: enough that the call's cost is negligible, few enough for memory
STEPS_PER_CALL = 4096
# bytes per step of a drive with variable speed
BYTES_PER_STEP = 64.0
# default number of records per revolution
SAMPLES = 72
# closed state and rates at time zero, (nq,) and (nv,)
Start = tuple[Array, Array]
TIME = int(mujoco.mjtState.mjSTATE_TIME)
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)


@dataclass(frozen=True, slots=True)
class Steps:
    """The recorded states of a stepped run.

    Attributes:
        timestep: in [s].
        numbers: numbers of steps before each record, (n,); the first is zero.
        states: at time zero and after every `interval` steps, up to the end of the run.
        count: steps taken.
        seconds: time of the steps, in [s].
        processor: processor time of the steps in this thread, in [s].
        diverged: whether MuJoCo warned of a bad state or a number was not finite; the records precede it.
        force: on the crank at each state, (n,) in [N m], None at constant speed; or on all `actuated_dofs` of
            the loops, (n, k) in [N m] or [N].
        settings: in effect, with all automatic choices made; None for a model with its own settings.
    """

    timestep: float
    numbers: NDArray[np.int64]
    states: States
    count: int
    seconds: float
    processor: float
    diverged: bool
    force: Array | None = None
    settings: Settings | None = None


def interval_count(profile: CrankProfile, per_turn: float = SAMPLES) -> int:
    """Return the number of intervals in a motion for at least `per_turn` per revolution."""
    return max(profile.min_instants, int(np.ceil(profile.turns * per_turn - 1e-9)))


def record_interval(profile: CrankProfile, total: int, samples: int | None) -> int:
    """Return the number of steps between two records of a motion of `total` steps.

    Args:
        profile: of the motion.
        total: number of steps.
        samples: number of records after the first; None takes about `SAMPLES` per revolution.
    """
    if samples is not None:
        return -(-total // samples)
    return max(1, int(total / max(profile.min_instants, SAMPLES * profile.turns)))


@quiet()
def step(
    loops: ModelLoops,
    settings: Settings,
    profile: CrankProfile,
    start: Start,
    total: int,
    interval: int,
    controls: Array | None = None,
    progress: Progress = no_progress,
) -> Steps:
    """Step a model along a crank profile.

    The crank has a virtual inertia so large that no reaction of the linkage changes its speed. A variable
    speed results from a torque, constant over each step, that gives the prescribed speed at the end of the
    step (measured in validation/choices/crank_actuation.py). With several drivers each has its virtual
    inertia and its force, and the path parameter advances freely. A coordinate with a nonlinear coupling to
    the drivers also has both, because MuJoCo's constraints omit the velocity-product term.

    Args:
        loops: of the model; its settings are replaced.
        settings: of the stepping.
        profile: the crank's motion.
        start: closed state and rates at time zero, (nq,) and (nv,).
        total: steps over the whole profile.
        interval: number of steps between two records; the last step is recorded too.
        controls: of the model's actuators at the start of each step, (total, nu); None without controls.
        progress: callback after every block.
    """
    timestep, moved = profile.duration / total, recording.actuated_dofs(loops)
    driven = not profile.steady or len(moved) > 1 or not loops.drivers.crank
    if driven:
        needed, remedy = BYTES_PER_STEP * len(moved), "take {most} steps at the most"
        require_memory(f"the drive's torque at {total:,} steps", total, needed, remedy)
    kept = {row.equality for row in recording.followers(loops)}
    nonlinear = (row.equality for row in (*loops.couplings, *loops.rods) if row.nonlinear)
    renewed = not kept.issuperset(nonlinear)
    used = settings.apply(loops, timestep)
    torque = None
    if driven:
        # the crank's virtual inertia on all driven DOFs; on a slide the mass that has this inertia at the
        # distance of the characteristic length
        model, inertia = loops.model, loops.model.dof_armature[loops.crank]
        slides = model.jnt_type[model.dof_jntid[moved]] == SLIDE
        set_armature(model, moved, np.where(slides, inertia / loops.characteristic_length**2, inertia))
        # MuJoCo scales the compliance of couplings by these
        model.dof_invweight0[moved] = 1.0 / model.dof_armature[moved]
        model.eq_active0[list(kept)] = 0
        rescale_coupled_tendons(loops, model)
        # the force on each driver over each step, (steps, drivers) in [N m] or [N]
        angle, speed, _ = profile.state(timestep * np.arange(total + 1.0))
        rates = recording.actuated_rates(loops, angle, speed)
        torque = np.diff(rates, axis=0) / timestep * loops.model.dof_armature[moved]

    def inputs(steps: slice) -> Array | None:
        """Return the controls of actuators and drives over some steps, (1, steps, nu + nv); None without."""
        if controls is None and torque is None:
            return None
        control = np.zeros((1, steps.stop - steps.start, loops.model.nu + loops.model.nv))
        if controls is not None:
            control[0, :, : loops.model.nu] = controls[steps]
        if torque is not None:
            control[0][:, loops.model.nu + moved] = torque[steps]
        return control

    stepping = start, total, interval, inputs, progress
    if renewed:
        run = _renewed_rollout(loops, *stepping)
    else:
        run = rollout(batch.Batch(loops.model, 1, 1), timestep, *stepping)
    force = None if torque is None else torque[np.minimum(run.numbers, total - 1)]
    if force is not None and len(moved) == 1 and loops.drivers.crank:
        force = force[:, 0]
    return replace(run, force=force, settings=used)


# steps of a block -> controls of actuators and applied forces, (1, steps, nu + nv)
Inputs = Callable[[slice], Array | None]


def rollout(
    sims: batch.Batch,
    timestep: float,
    start: Start,
    total: int,
    interval: int,
    controls: Inputs,
    progress: Progress = no_progress,
) -> Steps:
    """Step one simulation in blocks, until it diverges.

    Args:
        sims: the simulation.
        timestep: its time step in [s].
        start: state and rates at time zero, (nq,) and (nv,).
        total: steps.
        interval: number of steps between two records; the last step is recorded too.
        controls: controls and forces of a block.
        progress: callback after every block.
    """
    sims.bind("qpos")[:], sims.bind("qvel")[:] = start
    records = [(np.zeros(1, dtype=np.int64), start[0][None], start[1][None])]
    count, seconds, processor, diverged = 0, 0.0, 0.0, False
    while count < total and not diverged:
        steps = slice(count, min(count + STEPS_PER_CALL, total))
        control = controls(steps)
        begin, busy = perf_counter(), thread_time()
        out = sims.rollout(
            steps.stop - count, control=control, control_spec=CONTROL, record=("qpos", "qvel", TIME)
        )
        seconds += perf_counter() - begin
        processor += thread_time() - busy
        number = np.arange(count + 1, steps.stop + 1)
        kept = np.flatnonzero((number % interval == 0) | (number == total))
        number, (qpos, qvel, time) = number[kept], (values[0, kept] for values in out.values())
        # MuJoCo resets a bad state to time zero
        valid = np.isfinite(qpos).all(1) & np.isfinite(qvel).all(1) & (time[:, 0] > timestep * (number - 0.5))
        records.append((number[valid], qpos[valid], qvel[valid]))
        diverged = bool(not valid.all() or sims.warning[..., 1].any())
        count = steps.stop
        progress(f"{count:,} of {total:,} steps", count / total)
    numbers, qpos, qvel = (np.concatenate(columns) for columns in zip(*records, strict=True))
    states = States(timestep * numbers.astype(np.float64), qpos, qvel)
    return Steps(timestep, numbers, states, count, seconds, processor, diverged)


def _renewed_rollout(
    loops: ModelLoops, start: Start, total: int, interval: int, controls: Inputs, progress: Progress
) -> Steps:
    """Step a model with the velocity-product terms of its rods and couplings, which MuJoCo omits.

    Couplings by functions get their Taylor polynomials at the state before each step.

    A polynomial of degree 4 is exact to the fifth power of the motion in a step. With RK4 the error falls
    with the fourth power of the step, where steps end at the ends of a cam's segments: 2e-7, 1e-8, 5e-10 and
    4e-12 m in `cam_follower` with 360 to 2,880 steps a revolution.
    """
    from mechsim.simulation.velocity_products import velocity_products

    model, data = loops.model, mujoco.MjData(loops.model)
    timestep = float(model.opt.timestep)
    data.qpos[:], data.qvel[:] = start
    records, seconds, processor, diverged = [(0, *start)], perf_counter(), thread_time(), False
    with velocity_products(loops, data) as expand:
        for count in range(total):
            expand()
            control = controls(slice(count, count + 1))
            if control is not None:
                data.ctrl[:], data.qfrc_applied[:] = np.split(control[0, 0], [model.nu])
            mujoco.mj_step(model, data)
            diverged = bool(data.warning.number.any() or not np.isfinite(data.qpos).all())
            if diverged:
                break
            if (count + 1) % interval == 0 or count + 1 == total:
                records.append((count + 1, data.qpos.copy(), data.qvel.copy()))
            if count % STEPS_PER_CALL == 0:
                progress(f"{count:,} of {total:,} steps", count / total)
    numbers, qpos, qvel = (np.array(column) for column in zip(*records, strict=True))
    spent = perf_counter() - seconds, thread_time() - processor
    states = States(timestep * numbers.astype(np.float64), qpos, qvel)
    return Steps(timestep, numbers, states, int(numbers[-1]), *spent, diverged)


def functions_in_loops(loops: ModelLoops) -> list[str]:
    """Return the couplings by functions of coordinates that do not follow from the drivers alone.

    Their Taylor polynomials change at every step.
    """
    kept = {row.equality for row in recording.followers(loops)}
    functions = (row for row in loops.couplings if row.function is not None and row.equality not in kept)
    return [loops.model.equality(row.equality).name for row in functions]


class NotSteppedError(InputError):
    """MuJoCo cannot step the motion; its solved configurations are exact."""


def require_steps_resolve(motion_laws: MotionLaws) -> None:
    """Reject motion laws with pulses that are too short for time steps."""
    if motion_laws.pulses:
        raise NotSteppedError("the motion laws have pulses too short for time steps; take --method pose")


def rescale_coupled_tendons(loops: ModelLoops, model: mujoco.MjModel) -> None:
    """Update the inverse weights of coupled sums of coordinates to the current inertias.

    MuJoCo regularises these constraints by the inverse weights at compilation, without virtual inertia. A
    light driven link then made a coupling yield by 1 %.
    """
    weights = model.dof_invweight0.copy()
    # a free crank has no virtual inertia
    driven = [dof for dof in loops.driven_dofs if model.dof_armature[dof]]
    weights[driven] = np.minimum(weights[driven], 1.0 / model.dof_armature[driven])
    for coupling in loops.couplings:
        if model.eq_type[coupling.equality] != int(mujoco.mjtEq.mjEQ_TENDON):
            continue
        ends = int(model.eq_obj1id[coupling.equality]), int(model.eq_obj2id[coupling.equality])
        for tendon, side in zip(ends, (coupling.left, coupling.right), strict=True):
            if side is not None:
                model.tendon_invweight0[tendon] = float(side.weights**2 @ weights[side.dofs])
