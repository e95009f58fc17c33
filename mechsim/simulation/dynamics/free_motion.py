"""Free runs in MuJoCo: the crank moves under motor, loads, weight, springs and friction."""

import time as timer
from dataclasses import dataclass, replace

import numpy as np

from mechsim.errors import InputError
from mechsim.model.force_record import FreeRun
from mechsim.model.forces import Forces, forces_of
from mechsim.model.limits import MAX_STIFF_STEPS, require_steps
from mechsim.model.masses import masses_of
from mechsim.model.mechanism import Mechanism, described
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE
from mechsim.simulation import loop_jacobian
from mechsim.simulation.dynamics.angle_tolerance import FreeStepping, angle_within
from mechsim.simulation.dynamics.applied_controls import prepared
from mechsim.simulation.dynamics.free_steps import DECAYS, PART_OF_DECAY, StartUp, expect_speed, step_freely
from mechsim.simulation.dynamics.inverse_dynamics import (
    forces_of_states,
    loaded_state,
    powers,
    state_at_crank,
)
from mechsim.simulation.dynamics.loaded_model import LoadedModel, loaded_model
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.recording import CHUNK, States, evaluate
from mechsim.simulation.result import SteppedFreeRun
from mechsim.simulation.settings import COMPLIANCE, Settings
from mechsim.simulation.source import HasMechanism
from mechsim.simulation.stepping import Progress, no_progress
from mechsim.units import si

# a run for `turns` lasts at most this number times (1 + turns) revolutions at the expected speed
PATIENCE = 20.0
# for constraints that are redundant only while the loops are closed: stiff ones brake the mechanism by their
# inconsistency. Of compliances 1e-8 to 1e4 and time constants of 3 to 20 steps these conserve the energy best
# (Bennett linkage, 3e-7)
REDUNDANT = Settings(compliance=100.0, constant_steps=5.0, steps_per_turn=4000)
# for redundant constraints that are consistent
AGREEING = Settings(steps_per_turn=4000, compliance=COMPLIANCE)
# minimum number of records over which the work is integrated; every step if the run has fewer
FINEST = 10_000
# number of instants at which the energy of a trial is evaluated
CHECK_INTERVAL = 72
# Newton steps of the constraint solver: with one the energy drifts by 1e-5 a revolution, with two by 1e-9
ITERATIONS = 2
# a motor is stiff if the step that damping allows is at most this fraction of a revolution at no-load speed
STIFF = 1e-3
# remedy in the message if a stiff motor needs too many explicit steps
STIFF_REMEDY = (
    "give a flywheel, a weaker motor or fewer turns, or leave MuJoCo out (--method none): the equations of "
    "motion are solved by an implicit method"
)
# factor on the longest step that damping allows, in the coarsest trial. With 4, the work of a motor in the
# first instants has a relative error of 1e-3, because it is integrated over too few steps
COARSER = 2.0


@quiet()
def free_run(
    source: Mechanism | HasMechanism,
    forces: Forces | None = None,
    *,
    angle: float | str | None = None,
    speed: float | str = 0.0,
    turns: float | None = None,
    duration: float | str | None = None,
    tolerance: float | str | None = None,
    samples: int = 720,
    timestep: float | str | None = None,
    settings: Settings | None = None,
    cut: tuple[str, ...] | None = None,
    progress: Progress = no_progress,
) -> SteppedFreeRun:
    """Step a free mechanism in MuJoCo from an initial crank angle and speed.

    Quantities are numbers in SI, or text with a unit, as "600rpm".

    Args:
        source: a Mechanism, or an object that has one, as `ms.load` returns; links without an inertia are
            rods, as in `masses.with_inertia`.
        forces: applied forces, including the motor. None takes the forces of the source, as a file's
            `[forces]`, or no forces if it has none.
        angle: initial crank angle in [rad]; None takes the mechanism's start angle.
        speed: initial crank speed in [rad/s].
        turns: revolutions of the crank after which the run ends; negative backwards.
        duration: time after which the run ends in [s]; give it or `turns`.
        tolerance: tolerance of the crank angle at every instant in [rad]. Trials then determine the time
            step, and a run with steps twice as long gives the error (`angle_tolerance`).
        samples: number of instants recorded after the first; approximate if only `turns` is given.
        timestep: longest step in [s], shortened for evenly spaced records; None takes the settings' fraction
            of a revolution at the expected speed.
        settings: time-stepping settings; their virtual drive inertia is ignored.
        cut: joints at which the loops are cut; None lets the generator choose.
        progress: called with a text and the finished fraction, 0 to 1.

    Raises:
        InputError: if neither `turns` nor `duration` is given, or for invalid values.
        AssemblyError: if the loops do not close at the start.
    """
    angle, speed = si(angle, "rad", "the start angle"), si(speed, "rad/s", "the speed")
    duration, timestep = si(duration, "s", "the duration"), si(timestep, "s", "the time step")
    tolerance = si(tolerance, "rad", "the tolerance")
    _check(
        speed=speed,
        turns=turns,
        duration=duration,
        tolerance=tolerance,
        timestep=timestep,
        samples=float(samples),
    )
    if turns is None and duration is None:
        raise InputError("a free run needs turns of the crank, or a duration above 0, after which to end")
    mechanism = described(source)
    loaded = loaded_model(mechanism, forces_of(source, forces), cut)
    open_choice = settings is None and _is_redundant(loaded)
    settings = settings or Settings()
    first = mechanism.start if angle is None else angle
    plan = _Plan(
        loaded,
        settings,
        state_at_crank(loaded, first, speed),
        turns,
        duration,
        samples,
        0.0,
        np.inf,
        progress,
    )
    if timestep is None or duration is None or tolerance is not None or open_choice:
        expected = expect_speed(loaded, first, speed, turns, duration)
        plan = replace(plan, fastest=expected.speed, longest=expected.timestep(np.inf))
    if open_choice:
        settings = _steadier(plan)
        plan = replace(plan, settings=settings)
    if tolerance is not None:
        if timestep is not None:
            raise InputError("a free run was given a time step and a tolerance; leave one of them out")
        # the Runge-Kutta method is stable up to five times `longest`; only trials take steps above it
        plan = replace(plan, longest=COARSER * plan.longest)
        stepping, report = angle_within(plan.let_run, tolerance, REVOLUTION / plan.fastest / plan.longest)
        record = _recorded(plan, stepping)
        if record.free.outcome == "done" and not report.satisfied:
            record = replace(record, free=replace(record.free, outcome="failed", reason=report.reason))
        return replace(record, tolerance_report=report)
    if timestep is None:
        return _recorded(plan, plan.let_run(settings.steps_per_turn))
    return _recorded(plan, plan.let_run(settings.steps_per_turn, timestep=timestep))


@dataclass(frozen=True, slots=True)
class _Plan:
    """A free run without its time step.

    Attributes:
        loaded: the mechanism and its forces.
        settings: time-stepping settings.
        start: closed state and rates.
        turns: requested revolutions of the crank.
        duration: requested duration, in [s].
        samples: requested number of instants after the first.
        fastest: expected maximum crank speed, in [rad/s]; 0 if it is not needed.
        longest: longest time step that damping allows, in [s].
        progress: called with a text and the finished fraction.
    """

    loaded: LoadedModel
    settings: Settings
    start: tuple[Array, Array]
    turns: float | None
    duration: float | None
    samples: int
    fastest: float
    longest: float
    progress: Progress

    def let_run(self, steps: int, per_record: int = 1, *, timestep: float | None = None) -> FreeStepping:
        """Return the run with a number of steps per revolution at the expected speed.

        Args:
            steps: per revolution.
            per_record: factor by which the steps are finer than those of a reference run. Runs with the same
                ratio of `steps` to `per_record` are recorded at the same instants.
            timestep: step of the reference run, in [s]; None derives it from `steps`.
        """
        coarse = replace(self.settings, steps_per_turn=steps // per_record)
        step = timestep or min(coarse.timestep(self.fastest), self.longest)
        duration = self.duration
        if duration is None:
            assert self.turns is not None
            duration = PATIENCE * REVOLUTION * (1.0 + abs(self.turns)) / self.fastest
        total = likely = int(np.ceil(duration / step - 1e-9))
        if self.turns is not None and self.fastest > 0.0:
            likely = min(total, int(REVOLUTION * abs(self.turns) / self.fastest / step) + 1)
        self._require_feasible(step, likely)
        record_step = max(1, likely // max(self.samples, FINEST))
        if self.turns is None:
            total = record_step * -(-total // record_step)
            step = duration / total
        every = max(1, likely // record_step // self.samples)
        settings = replace(self.settings, steps_per_turn=steps)
        start_up = self._start_up(step, record_step, per_record)
        step, total, record_step = step / per_record, total * per_record, record_step * per_record
        # the residual that one Newton step leaves cannot move a driven crank, but it would move a free one
        loops = prepared(self.loaded, settings, step, ITERATIONS)
        begin = timer.perf_counter()
        run = step_freely(
            self.loaded,
            loops,
            self.start,
            total,
            record_step,
            self.turns,
            self.fastest,
            self.progress,
            start_up,
        )
        seconds = timer.perf_counter() - begin
        return FreeStepping(run, loops, settings, seconds, every)

    def _start_up(self, step: float, record_step: int, per_record: int) -> StartUp | None:
        """Return the start-up under a stiff motor; None without one, or if the run ends before it does."""
        end = self.duration if self.turns is None else abs(self.turns) * self._slowest
        if not self._is_stiff or end is None:
            return None
        steps = record_step * int(np.ceil(DECAYS / PART_OF_DECAY * self.longest / step / record_step))
        return StartUp(steps * per_record, per_record) if steps * step < end else None

    @property
    def _is_stiff(self) -> bool:
        """Whether the motor accelerates the crank to its speed in a small fraction of a revolution."""
        return self.longest <= STIFF * self._slowest

    @property
    def _slowest(self) -> float:
        """Time of a revolution at the motor's no-load speed in [s]; 0 without a motor."""
        motor = self.loaded.forces.motor
        return 0.0 if motor is None else REVOLUTION / abs(motor.no_load) if motor.no_load else np.inf

    def _require_feasible(self, step: float, likely: int) -> None:
        """Raise InputError if a stiff motor, which keeps the crank's speed, needs too many explicit steps."""
        if not self._is_stiff:
            return
        steps = float(likely)
        if self.turns is not None:
            steps = max(steps, abs(self.turns) * self._slowest / step)
        name = self.loaded.mechanism.name
        what = f"{name}: a free run under so stiff a motor, stepped by {step:.2g} s,"
        require_steps(what, steps, STIFF_REMEDY, MAX_STIFF_STEPS)


def _is_redundant(loaded: LoadedModel) -> bool:
    """Return whether some loop constraints depend linearly on others; rows of zeros are ignored."""
    _, jacobian = loaded.loops.linearise(loaded.qpos[None])
    sizes = np.abs(jacobian[0]).max(1, initial=0.0)
    rounding = loop_jacobian.rounding(loaded.loops)
    rows = jacobian[0][sizes > max(RANK_TOLERANCE * sizes.max(initial=0.0), rounding)]
    return len(rows) > 0 and int(np.linalg.matrix_rank(rows, RANK_TOLERANCE * float(sizes.max()))) < len(rows)


def _steadier(plan: _Plan) -> Settings:
    """Return the settings that conserve the energy better over a revolution with redundant constraints.

    The constraints of a third parallel crank are consistent, and stiff ones are accurate to rounding. Those
    of a Bennett linkage are consistent only while its loops are closed.
    """
    longest = REVOLUTION / plan.fastest
    short = replace(
        plan,
        turns=None,
        duration=min(plan.duration or longest, longest),
        samples=CHECK_INTERVAL,
        progress=no_progress,
    )

    def drift(settings: Settings) -> float:
        stepping = replace(short, settings=settings).let_run(settings.steps_per_turn)
        free = _recorded(short, stepping).free
        return free.energy_error if free.outcome == "done" else np.inf

    return AGREEING if drift(AGREEING) <= 2.0 * drift(REDUNDANT) else REDUNDANT


def _recorded(plan: _Plan, stepping: FreeStepping) -> SteppedFreeRun:
    """Return the run at its first, last and every `stepping.every`-th record; all records give the work."""
    loaded, run, loops = plan.loaded, stepping.steps, stepping.loops
    shown = np.unique([0, *range(run.started, len(run.time), stepping.every), len(run.time) - 1])
    kept = shown.astype(np.intp)
    states = States(run.time[kept], run.qpos[kept], run.qvel[kept])
    phases = [slice(0, run.started + 1), slice(run.started, None)]
    sums = [_work(loaded, States(run.time[k], run.qpos[k], run.qvel[k])) for k in phases]
    work, lost = (np.append(first[:-1], first[-1] + second) for first, second in zip(*sums, strict=True))
    forces = forces_of_states(loaded, loops.model, stepping.settings.compliance_used, states)
    motion = evaluate(loaded.loops, loaded.track, states, "step", crank_acceleration=forces.acceleration)
    return SteppedFreeRun(
        motion=motion,
        forces=forces,
        free=FreeRun(
            time=states.time,
            angle=forces.angle,
            speed=forces.speed,
            acceleration=forces.acceleration,
            kinetic=forces.kinetic,
            potential=forces.potential,
            work=work[kept],
            lost=lost[kept],
            motor=loaded.forces.motor_torque(forces.speed),
            outcome=run.outcome,
            reason=run.reason,
        ),
        steps=run.steps,
        seconds=stepping.seconds,
        timestep=float(loops.model.opt.timestep),
        settings=replace(stepping.settings, compliance=stepping.settings.compliance_used),
        masses=masses_of(loaded.mechanism),
    )


def _work(loaded: LoadedModel, states: States) -> tuple[Array, Array]:
    """Return the work of motor and loads, and the lost work, since the first state, (n,) each in [J]."""
    forces, n = loaded.forces, len(states.time)
    outer = forces.motor or forces.load_profiles
    if not (outer or forces.friction or any(spring.damping for spring in forces.springs)):
        return np.zeros(n), np.zeros(n)
    chunks = [powers(loaded, loaded_state(loaded, states.chunk(i))) for i in range(0, n, CHUNK)]
    lost, loads, motor = (np.concatenate(powers_of_chunks) for powers_of_chunks in zip(*chunks, strict=True))
    return _integral(states.time, loads + motor), _integral(states.time, lost)


def _integral(time: Array, power: Array) -> Array:
    """Return the time integral of a power from the first instant, by a quintic spline, (n,) in [J]."""
    from scipy.interpolate import make_interp_spline

    degree = min(5, len(time) - 1)
    if not power.any() or degree < 1:
        return np.zeros_like(power)
    work = make_interp_spline(time, power, k=degree - (1 - degree % 2)).antiderivative()
    return work(time) - work(time[0])


def _check(**values: float | None) -> None:
    for name, value in values.items():
        if value is not None and not abs(value) < np.inf:
            raise InputError(f"{name} of a free run is {value}; give a finite number")
        if value is not None and name in ("duration", "timestep", "samples", "tolerance") and not value > 0.0:
            raise InputError(f"{name} of a free run is {value}; give one above 0")
        if value == 0.0 and name == "turns":
            raise InputError("a free run of 0 turns ends where it starts; give turns other than 0")
