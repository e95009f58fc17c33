"""What a machine needs while its crank moves as prescribed: by solved poses, and by stepping in time."""

import copy
import time as clock
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.forces import Forces
from mechsim.mechanism import Mechanism
from mechsim.mjcf import Loops, quiet
from mechsim.motion import Motion, join
from mechsim.simulation import pose
from mechsim.simulation.bench import Bench
from mechsim.simulation.efforts import Efforts, constrained, efforts, needed, situation, tangent
from mechsim.simulation.profile import Profile, constant
from mechsim.simulation.record import CHUNK, States, evaluate
from mechsim.simulation.settings import Settings
from mechsim.simulation.step import step

Array = NDArray[np.float64]
Outcome = Literal["done", "diverged"]

# instants recorded a turn where nothing else is asked
SAMPLES = 72
# crank angles at which a profile is probed beforehand
PROBES = 64
# factor on the inverse weights below which forces are not evaluated, and Newton steps for them: between
# an error of 1e-6 x factor and rounding over 1e4 x factor, measured 5e-10 of the drive torque
HARDEST, ITERATIONS = 1e-5, 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Driven:
    """A machine under a prescribed crank, as MuJoCo has it.

    Attributes:
        motion: at the recorded instants.
        efforts: at the same instants.
        outcome: "done" or "diverged".
        method: "pose" or "step".
        steps: time steps taken, or poses solved.
        seconds: time spent stepping or solving, the evaluation of the records not counted.
        settings: how it was stepped; None for method "pose".
        timestep: in [s]; None for method "pose".
    """

    motion: Motion
    efforts: Efforts
    outcome: Outcome
    method: Literal["pose", "step"]
    steps: int
    seconds: float
    settings: Settings | None = None
    timestep: float | None = None

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield time, angle, rates, torque, energies and reactions as columns of a table in SI."""
        motion, found = self.motion, self.efforts
        if motion.time is not None:
            yield "time", motion.time
        yield "angle", motion.angle
        yield "speed", motion.speed
        yield "acceleration", motion.acceleration
        for name in ("torque", "kinetic", "potential", "power_in", "power_loads", "power_lost"):
            yield name, getattr(found, name)
        for name, reaction in found.reactions.items():
            for kind, vector in (("f", reaction.force), ("m", reaction.moment)):
                for axis, column in zip("xyz", vector.T, strict=True):
                    yield f"{name}.{kind}{axis}", column
        for name, torque in found.gears.items():
            yield f"gear {name}", torque


@quiet()
def driven(
    mechanism: Mechanism,
    forces: Forces | None = None,
    *,
    speed: float | None = None,
    turns: float = 1.0,
    profile: Profile | None = None,
    method: Literal["pose", "step"] = "pose",
    samples: int | None = None,
    settings: Settings | None = None,
    cut: tuple[str, ...] | None = None,
) -> Driven:
    """Return drive torque, joint reactions and energies of a machine under a prescribed crank.

    Args:
        mechanism: links without an inertia are rods, as in `rods.with_inertia`.
        forces: what acts; the motor is left out, for the drive is in its place.
        speed: constant crank speed in [rad/s], negative backwards; or give `profile`.
        turns: of the crank, at constant speed.
        profile: the crank's angle over time.
        method: "pose" solves each pose, and by inverse dynamics what it needs: no integration, to
            rounding. "step" integrates in time; every number then belongs to the recorded instant,
            and the drive's own inertia is not in it.
        samples: instants recorded after the first, evenly spread; None takes about 72 a turn.
        settings: how to step.
        cut: joints at which the loops are cut; None lets the generator choose.

    Raises:
        InputError: for values that cannot be used.
        AssemblyError: if the loops close nowhere or only over part of the way.
    """
    if method not in ("pose", "step"):
        raise InputError(f"there is no method {method!r}; known are pose, step")
    if samples is not None and not samples >= 1:
        raise InputError(f"{samples} samples asked for; take at least 1")
    bench = Bench(mechanism, (forces or Forces()).without_motor(), cut)
    if profile is None:
        if speed is None:
            raise InputError("neither a crank speed nor a profile was given; give one of them")
        profile = constant(speed, turns, mechanism.start)
    if method == "pose":
        return _solved(bench, profile, samples)
    return _stepped(bench, profile, samples, settings or Settings())


def started(bench: Bench, angle: float, speed: float) -> tuple[Array, Array]:
    """Return the closed state at a crank angle and its rates at a crank speed, (nq,) and (nv,)."""
    qpos = pose.follow(bench.loops, bench.begun, [angle])
    rest = States(np.zeros(1), qpos, np.zeros((1, bench.model.nv)))
    inertia = bench.look(bench.looking(), rest, bench.nothing(1))["inertia"]
    return qpos[0], (tangent(bench, qpos, inertia) * speed)[0]


def _solved(bench: Bench, profile: Profile, samples: int | None) -> Driven:
    count = samples or max(1, int(np.ceil(SAMPLES * profile.turns - 1e-9)))
    time = np.linspace(0.0, profile.duration, count + 1)
    angle, speed, acceleration = profile.state(time)
    begin = clock.perf_counter()
    qpos = pose.follow(bench.loops, bench.begun, angle)
    parts = []
    for first in range(0, len(time), CHUNK):
        part = slice(first, first + CHUNK)
        rest = States(time[part], qpos[part], np.zeros((len(qpos[part]), bench.model.nv)))
        inertia = bench.look(bench.looking(), rest, bench.nothing(len(rest.time)))["inertia"]
        states = replace(rest, qvel=tangent(bench, rest.qpos, inertia) * speed[part, None])
        at = situation(bench, states)
        parts.append((states, efforts(bench, at, *needed(bench, at, acceleration[part]))))
    seconds = clock.perf_counter() - begin
    states = join([states for states, _ in parts])
    motion = evaluate(bench.loops, bench.track, states, "pose", crank_acceleration=acceleration)
    return Driven(
        motion=motion,
        efforts=join([found for _, found in parts]),
        outcome="done",
        method="pose",
        steps=len(time),
        seconds=seconds,
    )


def _stepped(bench: Bench, profile: Profile, samples: int | None, settings: Settings) -> Driven:
    angle = profile.state(np.linspace(0.0, profile.duration, PROBES))[0]
    pose.follow(bench.loops, bench.begun, angle)
    total = max(1, int(np.ceil(profile.turns * settings.steps_per_turn - 1e-9)))
    stride = max(1, int(total / (SAMPLES * profile.turns)))
    if samples is not None:
        stride = -(-total // samples)
        total = stride * samples
    first, speed, _ = (float(one[0]) for one in profile.state(np.zeros(1)))
    model = copy.copy(bench.model)
    stiffen_friction(model, profile.duration / total)
    time = profile.duration / total * np.arange(float(total))
    controls = bench.controls(profile.state(time)[0], time) if model.nu else None
    loops = Loops(model)
    steps = step(loops, settings, profile, started(bench, first, speed), total, stride, controls)
    states = steps.states
    found = efforts_of(bench, model, settings.hardness, states, steps.force)
    motion = evaluate(bench.loops, bench.track, states, "step", crank_acceleration=found.acceleration)
    if steps.diverged:
        motion = replace(motion, broken=f"MuJoCo's state went bad after {states.time[-1]:.6g} s")
    return Driven(
        motion=motion,
        efforts=found,
        outcome="diverged" if steps.diverged else "done",
        method="step",
        steps=steps.count,
        seconds=steps.seconds,
        settings=settings,
        timestep=steps.timestep,
    )


def efforts_of(
    bench: Bench, stepped: mujoco.MjModel, hardness: float, states: States, force: Array | None = None
) -> Efforts:
    """Return the efforts at recorded states of a stepped model, from its own constraint forces.

    Args:
        bench: the mechanism.
        stepped: the model as it was stepped, the drive's inertia in it.
        hardness: factor on its inverse weights.
        states: recorded.
        force: of the drive on the crank at each state besides what holds its speed, (n,) in [N m].
    """
    model = copy.copy(stepped)
    bench.prepare(model)
    # forces are the softness times a tiny gap: harder than this, rounding of the gap shows in them
    soften = max(1.0, HARDEST / hardness)
    model.body_invweight0[:] *= soften
    model.dof_invweight0[:] *= soften
    model.opt.iterations = ITERATIONS
    parts = []
    for first in range(0, len(states.time), CHUNK):
        part = states.at(first)
        at = situation(bench, part)
        acting = replace(at.outer, generalised=at.outer.generalised.copy())
        if force is not None:
            acting.generalised[:, bench.loops.crank] += force[first : first + CHUNK]
        fields = bench.look(model, part, acting)
        multipliers, torque = constrained(bench, at, fields)
        parts.append(efforts(bench, at, fields["qacc"], multipliers, torque))
    return join(parts)


def stiffen_friction(model: mujoco.MjModel, timestep: float) -> None:
    """Let dry friction hold within two steps: MuJoCo's default of 20 ms is long beside a turn."""
    for name in ("dof_solref", "tendon_solref_fri"):
        getattr(model, name)[:] = 2.0 * timestep, 1.0
    for name in ("dof_solimp", "tendon_solimp_fri"):
        getattr(model, name)[:] = 0.9999, 0.9999, 0.001, 0.5, 2.0
