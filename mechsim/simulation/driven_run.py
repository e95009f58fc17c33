"""A model driven through one crank motion, by solved poses or by time stepping, and its verdict."""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import compress
from time import perf_counter

import mujoco
import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.mechanism.finding import POSITION_TOLERANCE, Outcome
from mechsim.mechanism.limits import require_steps
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import CrankProfile, constant
from mechsim.numerics.arrays import Array
from mechsim.numerics.convergence import half_extent
from mechsim.numerics.resources import ProcessorBudget, require_memory
from mechsim.simulation import loop_jacobian
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.configurations import (
    change_points_text,
    in_another_assembly,
    passed_change_points,
    pose_errors,
    require_regular_start,
    undecided_note,
)
from mechsim.simulation.loop_jacobian import CLOSED_ERROR
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mobility import (
    floating_bodies_note,
    require_path_within_limits,
    require_within_limits,
)
from mechsim.simulation.poses import follow
from mechsim.simulation.poses.follow import interpolated_motion, moved_away
from mechsim.simulation.recording import States, evaluate
from mechsim.simulation.result import Run
from mechsim.simulation.settings import Settings
from mechsim.simulation.state import SCALAR, is_disabled
from mechsim.simulation.stepping import (
    SAMPLES,
    Progress,
    Steps,
    functions_in_loops,
    interval_count,
    no_progress,
    record_interval,
    step,
)

# number of last states to examine
LAST_STATES = 20
# distance from a singular pose, as from `ModelLoops.conditioning`, below which a state is nearly singular
NEAR_SINGULAR = 1e-2
STIFFNESS_MESSAGE = "stiffness, as no other cause was found; take smaller steps, or softer loops"


@quiet()
def limit_or_contact(model: mujoco.MjModel, time: Array, qpos: Array, qvel: Array) -> str:
    """Return the limit or the contact that was active in the last states, as text; empty without one.

    Args:
        model: model of the run.
        time: instants of the states in [s], (n,).
        qpos: (n, nq).
        qvel: (n, nv).
    """
    data = mujoco.MjData(model)
    for i in range(max(0, len(time) - LAST_STATES), len(time)):
        data.qpos[:], data.qvel[:] = qpos[i], qvel[i]
        mujoco.mj_forward(model, data)
        if int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT) in data.efc_type[: data.nefc].tolist():
            # the joint farthest beyond its range
            position, (low, high) = data.qpos[model.jnt_qposadr], model.jnt_range.T
            beyond = np.where(model.jnt_limited, np.maximum(low - position, position - high), -np.inf)
            name = model.joint(int(np.argmax(beyond))).name or "a joint"
            return f"a limit: at {time[i]:.4g} s {name} is at the end of its range"
        if data.ncon:
            pair = [model.body(model.geom_bodyid[g]).name or "the world" for g in data.contact[0].geom]
            return f"a contact: at {time[i]:.4g} s {pair[0]} and {pair[1]} touch"
    return ""


def near_singular(time: Array, distance: Array) -> str:
    """Return the nearby singular pose, as text; empty without one.

    Args:
        time: instants of the states in [s], (n,).
        distance: distance of each state from a singular pose, (n,), 0 to about 1.
    """
    nearest = int(np.argmin(distance)) if len(distance) else 0
    if not len(distance) or not distance[nearest] < NEAR_SINGULAR:
        return ""
    return f"a singular pose: at {time[nearest]:.4g} s the loops are within {distance[nearest]:.1g} of one"


RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)
EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
DISCRETE = int(mujoco.mjtIntegrator.mjINT_DISCRETE)


def stiffness_cause(model: mujoco.MjModel) -> str:
    """Return the element that requires shorter steps than the model's, as one clause; empty if none does.

    A spring is stable for steps below 2/w, where w is its circular frequency with the inertia that MuJoCo
    assigns to the DOF in the reference configuration; an explicit damper below twice its time constant.
    """
    if int(model.opt.integrator) == DISCRETE:
        return ""
    step, what = min(_longest_steps(model), default=(np.inf, ""))
    own = float(model.opt.timestep)
    if step >= own:
        return ""
    return (
        f"stiffness: {what} needs steps below {step:.2g} s, but they are {own:g} s; take shorter steps or "
        "the integrator discrete, or make it softer"
    )


def _longest_steps(model: mujoco.MjModel) -> Iterator[tuple[float, str]]:
    """Yield the longest stable step in [s] of each spring, damper and servo, and its name."""
    damped = is_disabled(model, mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    integrator = int(model.opt.integrator)
    explicit = integrator == RK4 or (integrator == EULER and damped)

    def longest(stiffness: float, power: float = 0.5) -> float:
        """Return the step for a spring, or by the power 1 for a damper, with unit mass."""
        return float(2.0 / stiffness**power) if stiffness > 0.0 else np.inf

    for j in np.flatnonzero(np.isin(model.jnt_type, SCALAR)):
        dof, name = int(model.jnt_dofadr[j]), model.joint(j).name
        weight = model.dof_invweight0[dof]
        yield longest(model.jnt_stiffness[j] * weight), f"the spring of joint {name}"
        if explicit:
            yield longest(model.dof_damping[dof] * weight, 1.0), f"the damper of joint {name}"
    for t in range(model.ntendon):
        name, weight = model.tendon(t).name, model.tendon_invweight0[t]
        yield longest(model.tendon_stiffness[t] * weight), f"the spring of tendon {name}"
    for a in np.flatnonzero(model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)):
        joint = int(model.actuator_trnid[a, 0])
        weight = model.dof_invweight0[model.jnt_dofadr[joint]] * model.actuator_gear[a, 0] ** 2
        name = f"actuator {model.actuator(a).name}"
        yield longest(-model.actuator_biasprm[a, 1] * weight), name
        if explicit or integrator == EULER:
            yield longest(-model.actuator_biasprm[a, 2] * weight, 1.0), name


# notes on the changes that stepping makes to a custom model
CHANGED = (
    "the model's own time step, integrator, solver and constraint compliance were replaced by the settings "
    "of the run, and its drivers carry virtual inertia; gravity, masses, friction and actuators are its own"
)
TOUCHING = ", and so are contacts of bodies that the drivers do not determine"
UNTOUCHED = ", and contacts do not act, because the drivers determine all poses"
# bytes per recorded number, with intermediate arrays
BYTES_PER_NUMBER = 32.0
# number of crank angles at which a profile is probed for closure
PROBES = 64
# distance of the crank from its prescribed angle, in [rad], above which the drive fails
MAX_DRIVE_ERROR = np.pi
# distance from a singular pose at which six significant digits of rates remain
MIN_CONDITIONING = 1e-7


# steps a revolution are a multiple of this where a cam is stepped
DEGREES = 360.0


@dataclass(frozen=True, slots=True)
class DrivenRun:
    """A closed model and the crank motion of its run.

    Attributes:
        closed: the model.
        profile: profile of the crank.
        start: closed state and rates at time zero, (nq,) and (nv,).
        samples: instants recorded after the first; None takes about `SAMPLES` per revolution.
        progress: callback with the progress of a run as text and as a fraction.
        total: steps of the whole motion; None for the number in the settings.
        ending: note on the end of the run, if it differs from the requested one.
        budget: budget of processor time; a run that exceeds it ends in a BudgetError. None means no limit.
    """

    closed: ClosedModel
    profile: CrankProfile
    start: tuple[Array, Array]
    samples: int | None = None
    progress: Progress = no_progress
    total: int | None = None
    ending: str = ""
    budget: ProcessorBudget | None = None

    @property
    def cycle(self) -> float:
        """Revolutions per cycle, over which steps are counted: one, or all of a shorter oscillation."""
        return 1.0 if self.profile.steady else min(1.0, self.profile.turns)

    @property
    def min_steps(self) -> int:
        """Minimum number of steps per cycle, for the motion's shape and its records."""
        least = max(self.profile.min_instants, self.samples or 0)
        return int(np.ceil(least * self.cycle / self.profile.turns - 1e-9))

    def stepped(self, settings: Settings, tolerance: float | None = None) -> Run:
        """Return the motion stepped in time, and its outcome for a tolerance in [m]; None for the default."""
        steps, motion = self._stepped(settings)
        outcome: Outcome = "passed"
        broken, estimate = self._failure(steps, motion), np.inf
        tolerance = default_tolerance(self.closed, motion) if tolerance is None else tolerance
        if broken:
            outcome, motion = "diverged", replace(motion, broken=broken)
        else:
            states = steps.states.qpos
            errors, positions = pose_errors(self.closed, motion, states)
            estimate = float(errors.max())
            if in_another_assembly(self.closed, motion, states, errors, positions):
                outcome = "changed assembly"
            elif not estimate <= tolerance:
                outcome = "failed"
        # the notes on a stepped run; empty without any
        no_contacts = is_disabled(self.closed.model, mujoco.mjtDisableBit.mjDSBL_CONTACT)
        changed = CHANGED + (UNTOUCHED if no_contacts else TOUCHING)
        undecided = undecided_note(self.closed.loops, passed_change_points(self.closed, self.profile))
        notes = self.closed.note, changed if self.closed.custom else "", undecided, self.ending
        return Run(
            motion=motion,
            outcome=outcome,
            tolerance=tolerance,
            estimate=estimate,
            steps=steps.count,
            seconds=steps.seconds,
            settings=steps.settings,
            timestep=steps.timestep,
            method="step",
            note="; ".join(filter(None, notes)),
        )

    def position_error(self, settings: Settings) -> float:
        """Return the largest position error of a run in [m]; inf on failure."""
        steps, motion = self._stepped(settings)
        if self._failure(steps, motion):
            return np.inf
        return float(pose_errors(self.closed, motion, steps.states.qpos)[0].max())

    def over_first_turn(self) -> "DrivenRun":
        """Return the run over the first revolution, if it has more of them and constant speed.

        Under motion laws the result is the whole run, because no fraction of it represents the rest.
        """
        if not self.profile.steady or self.profile.turns <= 1.0 or not self.closed.loops.drivers.crank:
            return self
        (start,), (speed,), _ = self.profile.state(np.zeros(1))
        return replace(self, profile=constant(float(speed), 1.0, float(start)), samples=None)

    def require_decided(self) -> None:
        """Reject a motion whose start or continuation dynamics do not determine.

        Raises:
            InputError: if the motion must stay on the branch at a change point, where speeds would jump.
            AssemblyError: if the start is a change point.
        """
        loops, change_points = self.closed.loops, passed_change_points(self.closed, self.profile)
        require_regular_start(loops, change_points, float(self.profile.state(np.zeros(1))[0][0]))
        if change_points and loops.change_point == "branch":
            raise InputError(
                f"{loops.name} must stay on the branch at {change_points_text(loops, change_points)}, where "
                "its links would jump in speed; no stepped motion does that: run it by pose, or let it "
                "continue smoothly"
            )

    def _stepped(self, settings: Settings) -> tuple[Steps, Motion]:
        loops = replace(self.closed.loops, model=copy.copy(self.closed.model))
        total, every = self._counts(settings)
        steps = step(loops, settings, self.profile, self.start, total, every, progress=self._report_progress)
        states = replace(steps.states, force=steps.force)
        return steps, evaluate(loops, self.closed.track, states, "step")

    def _report_progress(self, progress: str, fraction: float) -> None:
        """Report the progress of a run; raise if the budget is spent."""
        self.progress(progress, fraction)
        if self.budget is not None and fraction < 1.0:
            self.budget.require_left(progress)

    def _counts(self, settings: Settings) -> tuple[int, int]:
        """Return the number of steps of the run and the number between two records."""
        steps = self.profile.turns * settings.steps_per_turn
        what = f"a motion of {self.profile.turns:g} turns with {settings.steps_per_turn:,} steps a turn"
        if self.total is not None:
            what = f"a motion of {self.profile.turns:g} turns with the given time step"
        require_steps(what, self.total or steps, "take fewer turns or a shorter duration, or longer steps")
        total = self.total or interval_count(self.profile, settings.steps_per_turn)
        degrees = DEGREES * self.profile.turns
        whole = self.total is None and self.profile.steady and degrees.is_integer()
        if whole and functions_in_loops(self.closed.loops):
            # laws of cams change at whole degrees, mostly: the order is the fourth if a step ends there
            total = int(np.ceil(total / degrees) * degrees)
        interval = record_interval(self.profile, total, self.samples)
        return (total if self.samples is None else interval * self.samples), interval

    def _cause(self, steps: Steps) -> str:
        """Return the cause of a divergence: a singular pose, a limit, a contact, else stiffness."""
        loops, states = self.closed.loops, steps.states
        distance = loop_jacobian.conditioning(loops, loops.linearised(states.qpos)[1])
        cause = near_singular(states.time, distance)
        cause = cause or limit_or_contact(self.closed.model, states.time, states.qpos, states.qvel)
        if cause:
            return cause
        run = replace(loops, model=copy.copy(loops.model))
        assert steps.settings is not None
        replace(steps.settings, compliance=1.0).apply(run, steps.timestep)  # weights are then inertia
        return stiffness_cause(run.model) or STIFFNESS_MESSAGE

    def _failure(self, steps: Steps, motion: Motion) -> str:
        """Return the reason why a run failed, as a sentence; empty if it did not."""
        if steps.diverged:
            time = steps.states.time[-1]
            return f"MuJoCo's state became invalid after {time:.6g} s, by {self._cause(steps)}"
        target = self.profile.state(steps.states.time)[0]
        names, values, targets, slides = ("the crank",), motion.angle[None], target[None], np.zeros(1)
        loops, drivers = self.closed.loops, self.closed.loops.drivers
        if not drivers.crank:
            values, slides = steps.states.qpos[:, drivers.addresses].T, drivers.slides
            names, targets = drivers.names, drivers.law(target)[0]
        for name, value, intended, slide in zip(names, values, targets, slides, strict=True):
            unit, limit = ("m", loops.characteristic_length) if slide else ("rad", 1.0)
            lost = np.abs(value - intended) > MAX_DRIVE_ERROR * limit
            if lost.any():
                index = int(np.argmax(lost))
                return (
                    f"after {steps.states.time[index]:.6g} s {name} is at {value[index]:.6g} {unit} "
                    f"instead of {intended[index]:.6g}: the linkage moves its virtual drive inertia"
                )
        return ""


def first_state(closed: ClosedModel, profile: CrankProfile) -> tuple[Array, Array]:
    """Return the closed state and the rates at time zero of a crank motion, (nq,) and (nv,).

    Raises:
        AssemblyError: if the loops do not close over the whole motion.
    """
    angle, speed, _ = profile.state(np.linspace(0.0, profile.duration, PROBES))
    qpos = follow.follow(closed.loops, closed.qpos, angle)[:1]
    return qpos[0], loop_jacobian.tangent(closed.loops, closed.loops.linearised(qpos)[1])[0] * speed[0]


def default_tolerance(closed: ClosedModel, motion: Motion) -> float:
    """Return the default position tolerance of a motion, in [m]."""
    length = closed.loops.characteristic_length
    names = compress(closed.track.points, closed.driven_points)
    extent = half_extent(motion.points[name].position for name in names)
    if closed.undetermined_points.all():
        # the drivers move no point
        extent = length
    return max(POSITION_TOLERANCE * extent, CLOSED_ERROR * length)


def solved_run(
    closed: ClosedModel,
    profile: CrankProfile,
    samples: int | None,
    tolerance: float | None = None,
    progress: Progress = no_progress,
) -> Run:
    """Return a crank motion with separately solved poses; the default tolerance is `POSITION_TOLERANCE`.

    Raises:
        AssemblyError: if the crank cannot make the whole motion.
    """
    samples = samples or interval_count(profile)
    time = np.linspace(0.0, profile.duration, samples + 1)
    angle, speed, acceleration = profile.state(time)
    if not profile.steady:
        # the loops may fail to close between two samples
        first_state(closed, profile)
    begin = perf_counter()
    qpos, path = follow.follow_path(closed.loops, closed.qpos, angle)
    seconds = perf_counter() - begin
    require_path_within_limits(closed, angle)
    require_within_limits(closed, qpos)
    near_rows = list(path.near_change_points(angle))
    away = moved_away(qpos, near_rows)
    loops, track = closed.loops, closed.track
    jacobian = loops.linearised(away)[1]
    singular = loop_jacobian.conditioning(loops, jacobian) < MIN_CONDITIONING
    if singular.any():
        where = loops.drivers.text(float(angle[np.argmax(singular)]))
        raise AssemblyError(
            f"{loops.name}: the pose at {where} is singular, as where links lie flat on each other; its "
            "continuation is undetermined; keep a distance from it"
        )
    states = States(time, away, loop_jacobian.tangent(loops, jacobian) * speed[:, None], acceleration)
    motion = evaluate(loops, track, states, "pose", progress)
    motion = interpolated_motion(motion, closed, qpos, near_rows, (speed, acceleration))
    assert motion.closure is not None
    estimate = float(motion.closure.max(initial=0.0))
    tolerance = default_tolerance(closed, motion) if tolerance is None else tolerance
    return Run(
        motion=motion,
        outcome="passed" if estimate <= tolerance else "failed",
        tolerance=tolerance,
        estimate=estimate,
        steps=len(qpos),
        seconds=seconds,
        method="pose",
        note="; ".join(filter(None, (closed.note, floating_bodies_note(closed)))),
    )


def check_records(closed: ClosedModel, profile: CrankProfile, samples: int | None) -> None:
    """Raise InputError if memory is too small for the recorded instants."""
    records = samples or SAMPLES * profile.turns
    model, track = closed.model, closed.track
    numbers = 24 * len(track.links) + 9 * len(track.points) + 3 * model.njnt + model.nq + model.nv
    require_memory(
        f"{records:.3g} instants of {profile.turns:g} turns",
        records,
        BYTES_PER_NUMBER * numbers,
        "take {most} instants at the most: fewer turns, or records farther apart",
    )
