"""Time stepping of a free mechanism until it completes its revolutions, its time ends, or it cannot go on."""

import copy
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from mujoco import batch

from mechsim.errors import AssemblyError
from mechsim.model.finding import Outcome
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.applied_controls import AppliedControls
from mechsim.simulation.dynamics.friction import STEPS, compliance
from mechsim.simulation.dynamics.inverse_dynamics import crank_tangent
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses import follow
from mechsim.simulation.recording import States
from mechsim.simulation.stepping import Progress, no_progress

TIME = int(mujoco.mjtState.mjSTATE_TIME)

# number of steps between two checks of the run's progress
BLOCK = 2000
# start-up under a stiff motor: its duration in decay times, and the number of short steps per time step. The
# energy of the start then balances to 2e-11 (measured on the four-bar under motors of 100 and 1000 N m)
DECAYS, SUBSTEPS = 40.0, 20
# fraction of the expected speed below which the crank is at rest, unless dry friction lets it creep faster
REST = 1e-5


@dataclass(frozen=True, slots=True)
class FreeSteps:
    """Recorded states of a free run, and its outcome.

    Attributes:
        time: (n,) in [s].
        qpos: (n, nq).
        qvel: (n, nv).
        outcome: of the run.
        reason: one sentence if the run did not end as requested.
        steps: number of steps taken.
        started: index of the last record of the start-up.
    """

    time: Array
    qpos: Array
    qvel: Array
    outcome: Outcome
    reason: str
    steps: int
    started: int = 0


@dataclass(frozen=True, slots=True)
class StartUp:
    """The start-up under a stiff motor, with shorter steps.

    Attributes:
        steps: number of time steps, a multiple of those between two records; each is divided into `SUBSTEPS`.
        record_step: number of short steps between two records.
    """

    steps: int
    record_step: int


def step_freely(
    loaded: LoadedModel,
    loops: ModelLoops,
    start: tuple[Array, Array],
    total: int,
    record_step: int,
    turns: float | None,
    fastest: float,
    progress: Progress = no_progress,
    start_up: StartUp | None = None,
) -> FreeSteps:
    """Step a prepared model.

    Args:
        loaded: the mechanism and its forces, which determine the controls.
        loops: of the prepared model.
        start: closed state and rates, (nq,) and (nv,).
        total: maximum number of steps.
        record_step: number of steps between two records.
        turns: revolutions of the crank after which the run ends; None takes all steps.
        fastest: expected maximum crank speed in [rad/s].
        progress: called after every block.
        start_up: shorter steps at the start.
    """
    address, dof = loops.crank_address, loops.crank
    timestep = float(loops.model.opt.timestep)
    soft, creep = _softened(loaded, start, timestep)
    rest = max(REST * fastest, creep)
    records = [(np.zeros(1), start[0][None], start[1][None])]
    outcome, reason, finished = ("done" if turns is None else "time over"), "", 0
    state, began = start, 0.0
    if start_up is not None:
        records += _start_up(loaded, loops, start, soft, start_up)
        state, finished, began = (records[-1][1][-1], records[-1][2][-1]), start_up.steps, records[-1][0][-1]
    started = sum(len(time) for time, _, _ in records) - 1
    advance = _advance(loaded, loops, state, soft, began)
    while finished < total:
        count = min(record_step * max(1, BLOCK // record_step), total - finished)
        time, qpos, qvel, bad = advance(count, record_step)
        number = np.arange(1.0, len(time) + 1.0) * record_step + finished
        valid = np.isfinite(qpos).all(1) & np.isfinite(qvel).all(1) & (time > timestep * (number - 0.5))
        last = len(time) if valid.all() else int(np.argmin(valid))
        finished += count
        if turns is not None:
            arrived = (qpos[:last, address] - start[0][address]) * np.sign(turns) >= REVOLUTION * abs(turns)
            if arrived.any():
                last, outcome = int(np.argmax(arrived)) + 1, "done"
        records.append((timestep * number[:last], qpos[:last], qvel[:last]))
        if outcome == "done" and turns is not None:
            break
        if bad or not valid.all():
            outcome, reason = "diverged", f"MuJoCo's state became invalid after {timestep * finished:.6g} s"
            break
        made = (
            0.0
            if turns is None
            else float(abs(qpos[-1, address] - start[0][address])) / REVOLUTION / abs(turns)
        )
        progress(f"{finished:,} steps", min(1.0, max(made, finished / total)))
        end = _given_up(loaded, records, turns, rest, address, dof)
        if end is not None:
            outcome, reason = end
            break
    time, qpos, qvel = (np.concatenate(chunks) for chunks in zip(*records, strict=True))
    if outcome == "time over":
        made = (qpos[-1, address] - start[0][address]) / REVOLUTION
        reason = f"{made:.6g} of {turns:g} turns in {time[-1]:.6g} s"
    return FreeSteps(time, qpos, qvel, outcome, reason, finished, started)  # pyright: ignore[reportArgumentType]


def _start_up(
    loaded: LoadedModel, loops: ModelLoops, start: tuple[Array, Array], soft: list[float], start_up: StartUp
) -> list[tuple[Array, Array, Array]]:
    """Return the records of the start-up."""
    short = replace(loops, model=copy.copy(loops.model))
    short.model.opt.timestep /= SUBSTEPS
    advance = _advance(loaded, short, start, soft, 0.0)
    _, qpos, qvel, _ = advance(start_up.steps * SUBSTEPS, start_up.record_step)
    time = float(short.model.opt.timestep) * start_up.record_step * np.arange(1.0, len(qpos) + 1.0)
    return [(time, qpos, qvel)]


def _given_up(
    loaded: LoadedModel, records: list[Any], turns: float | None, rest: float, address: int, dof: int
) -> tuple[Outcome, str] | None:
    """Return outcome and reason of a run that cannot complete its revolutions; None while it still may."""
    if turns is None or _over_time(loaded):
        return None
    angle = np.concatenate([qpos[:, address] for _, qpos, _ in records])
    speed = np.concatenate([qvel[:, dof] for _, _, qvel in records]) * np.sign(turns)
    displacement = abs(float(angle[-1] - angle[0]))
    from_rest = speed[0] == 0.0
    if (np.abs(records[-1][2][:, dof]) < rest).all():
        if from_rest and displacement < 1e-3:
            return "cannot start", f"the crank stays at {angle[0]:.6g} rad: what drives it is too weak"
        return "stopped", f"the crank came to rest at {angle[-1]:.6g} rad"
    ahead = np.flatnonzero(speed > rest)
    back = np.flatnonzero(speed < -rest)
    if back.size and (not ahead.size or back[-1] > ahead[0]):
        index = int(np.argmax(angle * np.sign(turns)))
        made = abs(angle[index] - angle[0]) / REVOLUTION
        where = f"{angle[index]:.6g} rad, {made:.3g} turns from its start"
        reason = f"the crank turns back at {where}; give more torque or speed"
        return ("cannot start" if from_rest else "turned back"), reason
    return None


def _over_time(loaded: LoadedModel) -> bool:
    return any(course.over == "time" for course in loaded.forces.load_profiles)


def _softened(loaded: LoadedModel, start: tuple[Array, Array], timestep: float) -> tuple[list[float], float]:
    """Return the speeds below which dry friction by controls is linear in speed, and the crank's creep.

    A crank at rest under friction creeps at most at the speed that friction removes in two steps.
    """
    if not loaded.dry:
        return [], 0.0
    unit, none = np.zeros(1), np.zeros((1, loaded.model.nv))
    rest = States(unit, start[0][None], none)
    inertia = loaded.look(loaded.looking(), rest, loaded.nothing(1))["inertia"]
    rates = crank_tangent(loaded, rest.qpos, inertia)
    moving = loaded.look(loaded.looking(), States(unit, rest.qpos, rates), loaded.nothing(1))
    turning = moving["actuator_velocity"][0]
    whole = float((rates[0] @ inertia[0] @ rates[0]).item())
    soft = compliance(loaded.dry, turning, whole, timestep)
    locked = sum(unit.magnitude * float(np.sqrt((turning[unit.actuators] ** 2).sum())) for unit in loaded.dry)
    return soft, STEPS * timestep * locked / whole


def _advance(
    loaded: LoadedModel, loops: ModelLoops, start: tuple[Array, Array], soft: list[float], began: float
) -> Any:
    """Return a function that takes steps and returns time, qpos, qvel, and whether MuJoCo warned."""
    steady = not loaded.dry and all(course.over is None for course in loaded.forces.load_profiles)
    if steady and not any(coupling.nonlinear for coupling in loops.couplings):
        return _in_c(loaded, loops, start, began)
    return _with_callback(loaded, loops, start, soft, began)


def _in_c(loaded: LoadedModel, loops: ModelLoops, start: tuple[Array, Array], began: float) -> Any:
    """Return a function that steps under constant controls, entirely in C."""
    sims = batch.Batch(loops.model, 1, 1)
    sims.bind("qpos")[:], sims.bind("qvel")[:] = start
    if loops.model.nu:
        sims.bind("ctrl")[:] = loaded.controls(np.zeros(1), np.zeros(1))

    def advance(count: int, record_step: int) -> tuple[Array, Array, Array, bool]:
        out = sims.rollout(count, record=("qpos", "qvel", TIME))
        qpos, qvel, time = (values[0, record_step - 1 :: record_step] for values in out.values())
        return began + time[:, 0], qpos, qvel, bool(sims.warning[..., 1].any())

    return advance


def _with_callback(
    loaded: LoadedModel, loops: ModelLoops, start: tuple[Array, Array], soft: list[float], began: float
) -> Any:
    """Return a function that steps under controls of angle, time and rates, set at every stage of a step."""
    model, data = loops.model, mujoco.MjData(loops.model)
    data.qpos[:], data.qvel[:] = start
    data.time = began
    controls = AppliedControls(loaded, loops, soft=soft)

    def advance(count: int, record_step: int) -> tuple[Array, Array, Array, bool]:
        rows = []
        with controls.installed():
            for _ in range(count // record_step):
                mujoco.mj_step(model, data, nstep=record_step)
                rows.append((data.time, data.qpos.copy(), data.qvel.copy()))
        time, qpos, qvel = (np.array(values) for values in zip(*rows, strict=True))
        return time, qpos, qvel, bool(any(warning.number for warning in data.warning))

    return advance


# longest expected time of a revolution in [s], for a crank that nothing drives
SLOWEST = 100.0
# number of crank angles in a revolution at which inertia and damping are evaluated
PROBES = 24
# longest step as a fraction of the shortest decay time; the Runge-Kutta method is stable up to 2.8
PART_OF_DECAY = 0.5


@dataclass(frozen=True, slots=True)
class ExpectedSpeed:
    """Expected speed and decay time of a free run.

    Attributes:
        speed: approximate maximum crank speed, in [rad/s].
        decay: shortest time in which damping and motor slow the crank to 1/e, in [s]; may be infinite.
    """

    speed: float
    decay: float

    def timestep(self, step: float) -> float:
        """Return a time step no longer than the decay allows, in [s]."""
        return min(step, PART_OF_DECAY * self.decay)


def expect_speed(
    loaded: LoadedModel, angle: float, speed: float, turns: float | None, duration: float | None
) -> ExpectedSpeed:
    """Return the expected speed and decay time, from the energy that motor, loads and weight can supply.

    Motor and loads act over the requested revolutions, or over one. The motor's no-load speed and the
    duration limit the speed.
    """
    inertia, damping = _along(loaded, angle)
    weight = float(loaded.model.body_mass.sum() * np.linalg.norm(loaded.model.opt.gravity))
    stored = 2.0 * weight * loaded.mechanism.characteristic_length
    forces, torque, limit, fall = loaded.forces, 0.0, np.inf, 0.0
    if forces.motor is not None:
        torque, fall = abs(float(forces.motor.torque(0.0))), -forces.motor.derivative
        limit = abs(forces.motor.no_load)
    if forces.crank_torque is not None:
        around = np.linspace(0.0, REVOLUTION, 73)
        torque += float(np.abs(forces.crank_torque.evaluate(around, np.zeros(73))).max())
    for spring in forces.springs:
        stored += 0.5 * spring.stiffness * loaded.mechanism.characteristic_length**2
    least = float(inertia.min())
    distance = REVOLUTION * abs(turns) if turns is not None else REVOLUTION
    driven = min(float(np.sqrt(2.0 * torque * distance / least)), limit)
    if duration is not None:
        driven = min(driven, torque * duration / least)
    # the crank is fastest where the inertia is least
    kept = np.sqrt((2.0 * stored + float(inertia[0]) * speed**2) / least)
    fastest = max(abs(speed), float(np.hypot(kept, driven)), REVOLUTION / SLOWEST)
    slowing = damping + fall
    return ExpectedSpeed(fastest, float((inertia / slowing).min()) if (slowing > 0.0).all() else np.inf)


def _along(loaded: LoadedModel, angle: float) -> tuple[Array, Array]:
    """Return generalised inertia [kg m2] and damping [N m s] of the crank over a revolution.

    If the loops do not close over the revolution, return those at one angle.
    """
    angles = angle + np.linspace(0.0, REVOLUTION, PROBES + 1)[:-1]
    try:
        qpos = follow.follow(loaded.loops, loaded.qpos, angles)
    except AssemblyError:
        qpos = follow.follow(loaded.loops, loaded.qpos, angles[:1])
    n, model = len(qpos), loaded.looking()
    rest = States(np.zeros(n), qpos, np.zeros((n, loaded.model.nv)))
    inertia = loaded.look(model, rest, loaded.nothing(n))["inertia"]
    rates = crank_tangent(loaded, qpos, inertia)
    fields = loaded.look(model, States(rest.time, qpos, rates), loaded.nothing(n))
    lost = -(fields["qfrc_damper"] * rates).sum(1)
    return (rates * (inertia @ rates[..., None])[..., 0]).sum(1), np.maximum(lost, 0.0)
