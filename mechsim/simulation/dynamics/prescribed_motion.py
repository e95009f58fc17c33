"""Drive torque and reactions under a prescribed crank motion, by solved poses or by time stepping."""

import copy
import time as timer
from dataclasses import replace

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.actuators import NO_LIMIT, Actuator
from mechsim.mechanism.forces import Forces, forces_of
from mechsim.mechanism.masses import masses_of
from mechsim.mechanism.mechanism import Mechanism, described
from mechsim.mechanism.motion_laws import CrankProfile, MotionLaws
from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation import loop_jacobian
from mechsim.simulation.configurations import passed_change_points, require_regular_start, undecided_note
from mechsim.simulation.custom_model import at_initial_state
from mechsim.simulation.dynamics.inverse_dynamics import (
    forces_of_states,
    inverse_dynamics,
    state_at_crank,
    stiffen_friction,
)
from mechsim.simulation.dynamics.loaded_model import LoadedModel, loaded_model
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.poses.follow import interpolated_motion
from mechsim.simulation.recording import CHUNK, States, evaluate
from mechsim.simulation.result import Driven, Method
from mechsim.simulation.run import laws_of, requested_profile
from mechsim.simulation.settings import Settings
from mechsim.simulation.source import HasMechanism
from mechsim.simulation.stepping import (
    NotSteppedError,
    functions_in_loops,
    interval_count,
    record_interval,
    require_steps_resolve,
    step,
)
from mechsim.units import si

# constraints ten thousand times stiffer than positions require: near a dead centre the constraint violation
# caused an error of 1e-3 of the torque in an elliptic trammel (validation/robustness/torque_scale.py)
HARD = Settings(compliance=1e-12)
# conditioning of the loops below which a note warns of errors in stepped forces. At 2e-3, with a third crank
# 0.1 mm off the line of pivots, the error was 3e-5 of the torque; at 7e-3 it was less than the tolerance
BARELY = 5e-3


@quiet()
def driven(
    source: Mechanism | HasMechanism,
    forces: Forces | None = None,
    *,
    speed: float | str | None = None,
    turns: float = 1.0,
    profile: CrankProfile | None = None,
    motion_laws: MotionLaws | None = None,
    method: Method = "pose",
    samples: int | None = None,
    settings: Settings | None = None,
    cut: tuple[str, ...] | None = None,
    progress: Progress = no_progress,
) -> Driven:
    """Return drive torque, joint reactions and energies of a mechanism under a prescribed crank motion.

    Args:
        source: a Mechanism, or an object that has one, as `ms.load` returns; links without an inertia are
            rods, as in `masses.with_inertia`.
        forces: applied forces, without the motor, which the drive replaces. None takes the forces of the
            source, as a file's `[forces]`, or else gravity along -y.
        speed: constant crank speed in [rad/s], negative backwards, or text, as "600rpm"; or give `profile`.
        turns: of the crank, at constant speed.
        profile: the crank's angle over time.
        motion_laws: of the drivers, in place of speed or profile. None takes those of the source if neither
            speed nor profile is given.
        method: "pose" solves each pose and its forces by inverse dynamics, without integration, to rounding.
            "step" integrates in time; all values belong to the recorded instants and exclude the drive's own
            inertia. With nonlinear couplings, forces are those of the recorded states with closed loops.
        samples: instants recorded after the first, evenly spaced; None takes about 72 a turn.
        settings: time-stepping settings; None takes `HARD`.
        cut: joints at which the loops are cut; None lets the generator choose.
        progress: called with a text and the finished fraction, 0 to 1.

    Raises:
        InputError: for invalid values, or more instants than memory holds.
        AssemblyError: if the loops close nowhere, or only over a fraction of the motion.
    """
    if method not in ("pose", "step"):
        raise InputError(f"there is no method {method!r}; choose from pose, step")
    if samples is not None and not samples >= 1:
        raise InputError(f"{samples} samples requested; take at least 1")
    speed = si(speed, "rad/s", "the crank speed")
    motion_laws = laws_of(source, motion_laws, speed if profile is None else profile)
    mechanism, acting = described(source), forces_of(source, forces)
    acting.require_no_controllers(mechanism.name)
    acting = acting.under_drivers({*mechanism.drivers, *mechanism.locked})
    acting = replace(acting, actuators=tuple(map(_in_control, acting.actuators)))
    loaded = loaded_model(mechanism, acting, cut, follows_laws=not motion_laws.crank)
    loaded = at_initial_state(loaded, motion_laws)
    profile = profile or requested_profile(motion_laws, speed, turns, mechanism.start)
    if method == "pose":
        return _solved(loaded, profile, samples, progress)
    require_steps_resolve(motion_laws)
    # for the whole motion, so that unreachable crank angles are rejected before stepping
    passed = passed_change_points(loaded, profile)
    require_regular_start(loaded.loops, passed, float(profile.state(np.zeros(1))[0][0]))
    settings, note = settings or HARD, undecided_note(loaded.loops, passed)
    total = interval_count(profile, settings.steps_per_turn)
    interval = record_interval(profile, total, samples)
    run = _stepped(loaded, profile, settings, samples or -(-total // interval), interval, progress)
    return replace(run, note="; ".join(text for text in (note, run.note) if text))


def _in_control(actuator: Actuator) -> Actuator:
    """Return an actuator whose control contains its direct parts, which MuJoCo does not have."""
    if not any(actuator.direct):
        return actuator

    def control(time: Array) -> tuple[Array, Array, Array]:
        value, rate = actuator.input(time)
        return (actuator.gain[0] + actuator.direct[0]) * value + actuator.direct[1] * rate, rate, rate

    plain = {"gain": (1.0, 0.0, 0.0), "direct": (0.0, 0.0), "control_range": NO_LIMIT}
    return replace(actuator, control=control, **plain)


def _solved(loaded: LoadedModel, profile: CrankProfile, samples: int | None, progress: Progress) -> Driven:
    count = samples or interval_count(profile)
    time = np.linspace(0.0, profile.duration, count + 1)
    angle, speed, acceleration = profile.state(time)
    begin = timer.perf_counter()
    posed = inverse_dynamics(loaded, time, angle, speed, acceleration, progress)
    seconds = timer.perf_counter() - begin
    states = replace(posed.states, crank_acceleration=acceleration)
    motion = evaluate(loaded.loops, loaded.track, states, "pose")
    motion = interpolated_motion(motion, loaded, posed.qpos, posed.change_points, (speed, acceleration))
    return Driven(
        motion=motion,
        forces=posed.forces,
        outcome="done",
        method="pose",
        steps=len(time),
        seconds=seconds,
        masses=masses_of(loaded.mechanism),
    )


def _stepped(
    loaded: LoadedModel,
    profile: CrankProfile,
    settings: Settings,
    samples: int,
    record_step: int,
    progress: Progress,
) -> Driven:
    if functions := functions_in_loops(loaded.loops):
        raise NotSteppedError(
            f"coupling {functions[0]!r} is a function between coordinates that move with a loop, of which "
            "MuJoCo has no forces in steps along drivers; take --method pose"
        )
    total = samples * record_step
    first, speed, _ = (float(value[0]) for value in profile.state(np.zeros(1)))
    loops = replace(loaded.loops, model=copy.copy(loaded.loops.model))
    model = loops.model
    stiffen_friction(model, profile.duration / total)
    time = profile.duration / total * np.arange(float(total))
    controls = loaded.controls(profile.state(time)[0], time) if model.nu else None
    steps = step(
        loops, settings, profile, state_at_crank(loaded, first, speed), total, record_step, controls, progress
    )
    states = steps.states
    record = forces_of_states(loaded, model, settings.compliance_used, states, steps.force)
    drivers = [*record.drive_accelerations.values()]
    others = {"driver_acceleration": np.stack(drivers, 1)} if drivers else {}
    states = replace(states, crank_acceleration=record.acceleration, **others)
    motion = evaluate(loaded.loops, loaded.track, states, "step")
    if steps.diverged:
        motion = replace(motion, broken=f"MuJoCo's state became invalid after {states.time[-1]:.6g} s")
    return Driven(
        motion=motion,
        forces=record,
        outcome="diverged" if steps.diverged else "done",
        method="step",
        steps=steps.count,
        seconds=steps.seconds,
        settings=replace(settings, compliance=settings.compliance_used),
        timestep=steps.timestep,
        note=_conditioning_note(loaded, states),
        masses=masses_of(loaded.mechanism),
    )


def _conditioning_note(loaded: LoadedModel, states: States) -> str:
    """Return one sentence on where the loops of a run are nearly singular; an empty text if they are not."""
    loops, starts = loaded.loops, range(0, len(states.time), CHUNK)
    conditioning = np.concatenate(
        [loop_jacobian.conditioning(loops, loops.linearised(states.chunk(first).qpos)[1]) for first in starts]
    )
    least = int(np.argmin(conditioning))
    if not conditioning[least] < BARELY:
        return ""
    return (
        f"at {loops.drivers.text(float(states.qpos[least, loops.crank_address]))} the loops hardly hold the "
        f"links (conditioning {conditioning[least]:.2g}), as where a redundant crank lies almost in line "
        "with the others: forces grow there, and errors of stepped ones with them; solved poses have none "
        "(method pose)"
    )
