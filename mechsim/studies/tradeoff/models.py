"""Models that are compared, stepped once through the crank motion in each trial."""

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.simulation import CrankProfile, Settings, constant
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.driven_run import first_state
from mechsim.simulation.mjcf import compiled
from mechsim.simulation.mjcf.alternatives import LENGTH, MOTOR, inertia_at_crank
from mechsim.simulation.mjcf_reader.coordinates import driven
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recording import evaluate
from mechsim.simulation.source import CRANK, Model, from_spec, tracked_points
from mechsim.simulation.state import matching_state
from mechsim.simulation.stepping import Steps, step
from mechsim.studies.tradeoff.methods import Build

SAMPLES = 72
# inertia of a crank without virtual drive inertia in [kg m2], negligible next to the links
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
        build: of the model.
        closed: the model; stepped as a copy in each trial.
        profile: of the crank.
        start: state and rates at time zero, (nq,) and (nv,).
        servo: on the crank; None for virtual drive inertia.
        seconds: processor time of building it.
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
        samples = min(SAMPLES, settings.steps_per_turn)
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
        """Return the motion, None if it diverged, and the processor time of stepping in [s]."""
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
        """Return the change of length of a rod that is a distance constraint, (n,) in [m]."""
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
        source: mechanism, or a custom model.
        profile: of the crank; None makes one turn at the speed.
        speed: in [rad/s].
        build: of the model.
        variants: of the mechanism, by name.
        require_time: called between the steps of the work; raises once there is no time left.

    Raises:
        AssemblyError: if the crank cannot make all of its motion.
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
            f"{', '.join(names)} are driven by the file's actuators, and a trade-off is measured under one "
            "crank; leave it one actuator"
        )
    return next(iter(names))


def _servo(closed: ClosedModel, start: tuple[Array, Array], gain: float) -> Servo:
    tangent = start[1] / start[1][closed.loops.crank]
    inertia = inertia_at_crank(closed.model, start[0], tangent)
    return Servo(closed.model.actuator(MOTOR).id, inertia, gain)
