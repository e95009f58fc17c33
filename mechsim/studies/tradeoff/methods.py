"""Stepping methods that `mechsim tradeoff` compares, each a curve over the number of steps, and their models.

A method determines everything except the step: integrator, time constant of the loops (in steps, or as a
fraction of a revolution), compliance, impedance, refsafe, diagexact, and the model: its cuts, level, drive
and reductions.
"""

import copy
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.model.motion_laws import CrankProfile, constant
from mechsim.model.scene import LEVELS, Level, Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.driven_run import first_state
from mechsim.simulation.mjcf import compiled
from mechsim.simulation.mjcf.alternatives import (
    LENGTH,
    MOTOR,
    add_servo,
    gear_to_motor,
    inertia_at_crank,
    rod_as_length,
    rod_of,
)
from mechsim.simulation.mjcf.loop_cuts import cut_loops
from mechsim.simulation.mjcf_reader.coordinates import driven
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.plain_settings import INTEGRATORS
from mechsim.simulation.recording import evaluate
from mechsim.simulation.settings import LEAST_CONSTANT, Settings
from mechsim.simulation.source import CRANK, Model, from_spec, specification, tracked_points
from mechsim.simulation.state import matching_state
from mechsim.simulation.stepping import Steps, step

CrankDrive = Literal["drive_inertia", "geared", "servo"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """Options for building a model.

    Attributes:
        cut: joints at which the loops are cut; None selects the generator's cuts.
        level: level of the scene.
        crank_drive: virtual drive inertia on the crank; virtual drive inertia on a motor that an equality
            gears to the crank; or a velocity servo.
        gain: servo gain, in units of the inertia reflected to the crank over the time step.
        rod: link replaced by a constant length between two joints; None keeps all links as bodies.
        variant: variant of the mechanism with the same motion of its tracked points; None is the mechanism.
    """

    cut: tuple[str, ...] | None = None
    level: Level = "motion"
    crank_drive: CrankDrive = "drive_inertia"
    gain: float = 1.0
    rod: str | None = None
    variant: str | None = None

    def as_dict(self) -> dict[str, str]:
        """Return the columns of the CSV that describe the model."""
        reduction = f"{self.rod} as a length" if self.rod else self.variant or ""
        return {
            "cut": "+".join(self.cut or ()),
            "level": self.level,
            "drive": self.crank_drive,
            "reduction": reduction,
        }

    def made(self, source: Model, variants: Mapping[str, Mechanism]) -> Any:
        """Return MuJoCo's specification of a mechanism or of a custom model."""
        if self.variant is not None:
            source = variants[self.variant]
        spec = specification(source, Scene(level=self.level, cut=self.cut))
        if self.rod is not None:
            assert isinstance(source, Mechanism)
            rod_as_length(spec, source, self.rod)
        if self.crank_drive == "geared":
            gear_to_motor(spec)
        elif self.crank_drive == "servo":
            add_servo(spec)
        return spec


# numbers of steps per revolution; each divides 72 instants per revolution, or is a multiple of 72
STEPS = (24, 36, 72, 144, 288, 720, 1440, 2880, 7200)
MUJOCO_SOLREF, MUJOCO_SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
DEFAULTS = "MuJoCo's defaults"
LOW_COMPLIANCE = "RK4, turn/10, 1e-08"
# MuJoCo's own compliance scale
PLAIN = Settings(compliance=1.0)
BUILD = Build()


@dataclass(frozen=True, slots=True, kw_only=True)
class SteppingMethod:
    """Settings that differ only in the number of steps.

    Attributes:
        name: name in tables and plots.
        base: settings without the number of steps.
        rank: priority; methods of low rank are tried first.
        turn_fraction: time constant of the loops as a fraction of a revolution; None selects that of `base`.
        direct: whether stiffness and damping are 1/step squared and 1/step.
        build: options for building the model.
    """

    name: str
    base: Settings
    rank: int
    turn_fraction: float | None = None
    direct: bool = False
    build: Build = BUILD

    def settings(self, steps: int, speed: float) -> Settings:
        """Return the settings for a number of steps per revolution at a crank speed in [rad/s]."""
        settings = replace(self.base, steps_per_turn=steps)
        if self.turn_fraction is not None:
            return replace(settings, constant_steps=max(LEAST_CONSTANT, self.turn_fraction * steps))
        if self.direct:
            rate = 1.0 / settings.timestep(speed)
            return replace(settings, solref=(-(rate**2), -rate))
        return settings


def stepping_methods(
    mechanism: Mechanism | None = None, variants: Iterable[str] = ()
) -> list[SteppingMethod]:
    """Return all methods; methods with other models require a mechanism.

    Args:
        mechanism: the mechanism; None for a custom model.
        variants: names of its variants with the same motion.
    """
    defaults = replace(PLAIN, integrator="Euler", solref=MUJOCO_SOLREF, solimp=MUJOCO_SOLIMP, refsafe=True)
    hard = SteppingMethod(name=LOW_COMPLIANCE, base=Settings(), rank=0, turn_fraction=0.1)
    methods = [SteppingMethod(name=DEFAULTS, base=defaults, rank=0), hard]
    for integrator in INTEGRATORS:
        methods += _of_integrator(integrator)
    builds = {"geared crank": Build(crank_drive="geared"), "servo": Build(crank_drive="servo", gain=0.5)}
    if mechanism is not None:
        builds |= _other_builds(mechanism, variants)
    named = [
        replace(hard, name=f"{LOW_COMPLIANCE}, {name}", rank=3, build=build) for name, build in builds.items()
    ]
    methods += [*named[:2], *_implicit_servos(), *named[2:]]
    rod = None if mechanism is None else rod_of(mechanism)
    if rod is not None:
        # MuJoCo omits the second rate of a tendon; therefore only a stiff constraint keeps its length
        name = f"RK4, 2 steps, 1e-08, {rod} as a length"
        stiff = replace(Settings(), constant_steps=2.0)
        methods.append(SteppingMethod(name=name, base=stiff, rank=3, build=Build(rod=rod)))
    return methods


def _implicit_servos() -> Iterator[SteppingMethod]:
    """Yield methods with servo gains that need an implicit integrator; see choices/crank_actuation.py."""
    soft = replace(PLAIN, constant_steps=2.0)
    for integrator, gain in (("implicitfast", 1e4), ("discrete", 10.0)):
        base, build = replace(soft, integrator=integrator), Build(crank_drive="servo", gain=gain)
        yield SteppingMethod(name=f"{integrator}, 2 steps, servo", base=base, rank=3, build=build)


def _other_builds(mechanism: Mechanism, variants: Iterable[str]) -> dict[str, Build]:
    """Return models with other cuts, with more elements, or reduced, by name."""
    own = {joint.name for joint in cut_loops(mechanism).cuts}
    builds = {f"cut {'+'.join(cut)}": Build(cut=cut) for cut in possible_cuts(mechanism) if set(cut) != own}
    builds |= {f"level {level}": Build(level=level) for level in LEVELS if level != BUILD.level}
    builds |= {variant: Build(variant=variant) for variant in variants}
    rod = rod_of(mechanism)
    return builds if rod is None else builds | {f"{rod} as a length": Build(rod=rod)}


def _of_integrator(integrator: str) -> Iterator[SteppingMethod]:
    plain = replace(PLAIN, integrator=integrator)
    two, seven = replace(plain, constant_steps=2.0), replace(plain, constant_steps=7.0)

    def method(
        rank: int, suffix: str, base: Settings, turn_fraction: float | None = None, direct: bool = False
    ) -> SteppingMethod:
        name = f"{integrator}, {suffix}"
        return SteppingMethod(name=name, base=base, rank=rank, turn_fraction=turn_fraction, direct=direct)

    yield method(1, "2 steps", two)
    yield method(1, "7 steps", seven)
    yield method(1, "20 steps, 1e-04", replace(plain, constant_steps=20.0, compliance=1e-4))
    if integrator == "RK4":
        yield method(2, "turn/5, 1e-08", Settings(), 0.2)
        yield method(2, "turn/20, 1e-08", Settings(), 0.05)
    else:
        yield method(1, "direct", plain, direct=True)
        yield method(1, "turn/10, 1e-08", replace(plain, compliance=1e-8), 0.1)
    if integrator == "discrete":
        yield method(2, "1e-3 steps", replace(plain, constant_steps=1e-3))
    yield method(2, "turn/10, 1e-04", replace(plain, compliance=1e-4), 0.1)
    yield method(2, "2 steps, refsafe", replace(two, refsafe=True))
    yield method(2, "7 steps, diagexact", replace(seven, diagexact=True))
    yield method(2, "7 steps, impedance 0.95", replace(seven, solimp=MUJOCO_SOLIMP))
    yield method(2, "2 steps, 1e-08", replace(two, compliance=1e-8))


def possible_cuts(mechanism: Mechanism) -> list[tuple[str, ...]]:
    """Return every set of joints whose cutting leaves a tree that MuJoCo can close."""
    loops = len(mechanism.joints) - len(mechanism.links)
    cuts: list[tuple[str, ...]] = []
    for names in combinations([joint.name for joint in mechanism.joints], loops):
        with suppress(InputError):
            cut_loops(mechanism, names)
            cuts.append(names)
    return cuts


# number of records of a compared run per revolution: every five degrees
MAX_SAMPLES_PER_TURN = 72
# inertia of a crank without virtual drive inertia in [kg m2], negligible relative to the links
NO_DRIVE_INERTIA = 1e-12
NO_VARIANTS: Mapping[str, Mechanism] = {}


@dataclass(frozen=True, slots=True)
class Servo:
    """A velocity servo on the crank: torque = inertia x gain / step x (target speed - speed)."""

    actuator: int
    inertia: float
    gain: float

    def torque(self, speed: Array, timestep: float) -> Array:
        """Return the torque in [N m] at a speed in [rad/s]."""
        return self.inertia * self.gain / timestep * speed


@dataclass(frozen=True, slots=True)
class BuiltModel:
    """A model with one of the compared builds, and its crank motion.

    Attributes:
        build: options with which the model was built.
        closed: the model; each trial steps a copy.
        profile: motion of the crank.
        start: initial state and rates, (nq,) and (nv,).
        servo: servo on the crank; None for virtual drive inertia.
        seconds: processor time of building the model.
    """

    build: Build
    closed: ClosedModel
    profile: CrankProfile
    start: tuple[Array, Array]
    servo: Servo | None
    seconds: float

    def stepped(self, settings: Settings) -> tuple[ModelLoops, Steps]:
        """Step through the crank motion once."""
        loops = replace(self.closed.loops, model=copy.copy(self.closed.loops.model))
        samples = min(MAX_SAMPLES_PER_TURN, settings.steps_per_turn)
        interval = max(1, settings.steps_per_turn // samples)
        total = max(1, round(self.profile.turns * samples)) * interval
        controls = None
        if self.build.rod is not None:
            loops.model.eq_active0[:] = 1
            loops.model.tendon_invweight0[:] *= settings.compliance_used
        if self.build.crank_drive != "drive_inertia":
            settings = replace(settings, drive_inertia=NO_DRIVE_INERTIA)
        if self.servo is not None:
            timestep = self.profile.duration / total
            gain = float(self.servo.torque(np.ones(1), timestep)[0])
            loops.model.actuator_gainprm[self.servo.actuator, 0] = gain
            loops.model.actuator_biasprm[self.servo.actuator, 2] = -gain
            # constant over a step: exact in its middle
            controls = np.zeros((total, loops.model.nu))
            controls[:, self.servo.actuator] = self.profile.state(timestep * np.arange(0.5, total))[1]
        return loops, step(loops, settings, self.profile, self.start, total, interval, controls)

    def motion(self, settings: Settings) -> tuple[Motion | None, float]:
        """Return the motion (None if it diverged), and the processor time of stepping in [s]."""
        loops, steps = self.stepped(settings)
        if steps.diverged:
            return None, steps.processor
        states, force = steps.states, steps.force
        if self.servo is not None:
            # the evaluated motion has no control
            force = self.servo.torque(self.profile.state(states.time)[1], steps.timestep)
        motion = evaluate(loops, self.closed.track, states, "step", force=force)
        if self.build.rod is not None:
            motion = replace(motion, closure=self._length_errors(loops, states.qpos))
        return motion, steps.processor

    def _length_errors(self, loops: ModelLoops, qpos: Array) -> Array:
        """Return the length change of a rod replaced by a distance constraint, (n,) in [m]."""
        ends = [i for i in range(self.closed.model.nsite) if self.closed.model.site(i).name.endswith(LENGTH)]
        first, second = np.moveaxis(
            loops.posed.site_positions(np.concatenate([self.start[0][None], qpos]))[:, ends], 1, 0
        )
        lengths = np.linalg.norm(second - first, axis=1)
        return np.abs(lengths[1:] - lengths[0])


def build_model(
    source: Model,
    profile: CrankProfile | None,
    speed: float,
    build: Build | None = None,
    variants: Mapping[str, Mechanism] = NO_VARIANTS,
    require_time: Callable[[], None] = lambda: None,
) -> BuiltModel:
    """Generate or load a model and close its loops.

    Args:
        source: a mechanism, or a custom model.
        profile: motion of the crank; None makes one revolution at the speed.
        speed: crank speed, in [rad/s].
        build: options for building the model.
        variants: name -> variant of the mechanism.
        require_time: callback between the stages; raises InputError at the end of the budget.

    Raises:
        AssemblyError: if the crank cannot make its whole motion.
    """
    start_time = time.process_time()
    build = build or Build()
    spec = build.made(source, variants)
    require_time()
    points = tracked_points(source, spec)
    closed = from_spec(spec, points, _crank(source, spec))
    require_time()
    profile = profile or constant(speed, 1.0, closed.angle)
    if build.rod is None:
        start = first_state(closed, profile)
    else:
        whole = build_model(source, profile, speed)
        start = matching_state(closed.model, whole.closed.model, whole.start)
    servo = _servo(closed, start, build.gain) if build.crank_drive == "servo" else None
    return BuiltModel(build, closed, profile, start, servo, time.process_time() - start_time)


def _crank(source: Model, spec: mujoco.MjSpec) -> str:
    """Return the driven hinge of a model.

    Raises:
        InputError: for a custom model with several driven joints.
    """
    if isinstance(source, Mechanism):
        return CRANK
    if any(joint.name == CRANK for joint in spec.joints):
        return CRANK
    names = driven(compiled(spec.copy()), (), (), describe_only=False)
    if len(names) > 1:
        raise InputError(
            f"{', '.join(names)} are driven by the file's actuators, but a trade-off needs a single "
            "crank; remove the other actuators"
        )
    return next(iter(names))


def _servo(closed: ClosedModel, start: tuple[Array, Array], gain: float) -> Servo:
    tangent = start[1] / start[1][closed.loops.crank]
    inertia = inertia_at_crank(closed.model, start[0], tangent)
    return Servo(closed.model.actuator(MOTOR).id, inertia, gain)
