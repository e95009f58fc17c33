"""A model with the crank motion it is put through, stepped once for each trial."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.simulation import CrankProfile, Settings, constant, mjcf
from mechsim.simulation.mjcf.alternatives import LENGTH, MOTOR, inertia_felt
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses import follow
from mechsim.simulation.recorded_motion import add_sensors, evaluate
from mechsim.simulation.run import Source
from mechsim.simulation.stepping import Steps, step
from mechsim.studies.tradeoff.model_builds import Build

Array = NDArray[np.float64]
SAMPLES = 72
# inertia left on a crank that no flywheel drives, in [kg m2]: nothing beside the links'
NO_FLYWHEEL = 1e-12
NO_VARIANTS: Mapping[str, Mechanism] = {}


@dataclass(frozen=True, slots=True)
class Servo:
    """A velocity servo on the crank: torque = inertia x gain / step x (speed wanted - speed)."""

    actuator: int
    inertia: float
    gain: float

    def torque(self, speed: Array, timestep: float) -> Array:
        """Return the torque in [N m] at a speed in [rad/s]."""
        return self.inertia * self.gain / timestep * speed


class Rig:
    """A model with the crank motion it is put through.

    Attributes:
        profile: of the crank.
        model: compiled; copied for each trial.
    """

    def __init__(
        self,
        source: Source,
        profile: CrankProfile | None,
        speed: float,
        build: Build | None = None,
        variants: Mapping[str, Mechanism] = NO_VARIANTS,
    ):
        """Generate or load the model and close its loops.

        Args:
            source: mechanism, or a model of one's own.
            profile: of the crank; None makes one turn at the speed.
            speed: in [rad/s].
            build: how the model is made.
            variants: of the mechanism, by name.
        """
        self.build = build or Build()
        spec = self.build.made(source, variants)
        points = (
            tuple(source.points)
            if isinstance(source, Mechanism)
            else tuple(site.name for site in spec.sites if site.name and "@" not in site.name)
        )
        if not points:
            raise InputError("the model has no point to track; put a named site at each point of interest")
        self.track = add_sensors(spec, points)
        self.model = mjcf.compiled(spec)
        loops = ModelLoops(self.model)
        self.profile = profile or constant(speed, 1.0, float(self.model.qpos0[loops.crank_place]))
        if self.build.rod is None:
            self.start = self._closed(loops)
        else:
            self.start = self._started_as(Rig(source, profile, speed))
        self.servo = self._servo(loops) if self.build.drive == "servo" else None

    def _closed(self, loops: ModelLoops) -> tuple[Array, Array]:
        """Return state and rates at time zero with the loops closed."""
        angles = self.profile.state(np.linspace(0.0, self.profile.duration, SAMPLES + 1))[0]
        qpos = follow.follow(loops, loops.close(self.model.qpos0[None])[0], angles)[:1]
        first = self.profile.state(np.zeros(1))[1]
        return qpos[0], loops.tangent(loops.linearise(qpos)[1])[0] * first[0]

    def _started_as(self, whole: "Rig") -> tuple[Array, Array]:
        """Return state and rates at time zero by those of the same joints of the model with every body."""
        qpos, qvel = self.model.qpos0.copy(), np.zeros(self.model.nv)
        for i in range(self.model.njnt):
            joint = self.model.joint(i)
            same = whole.model.joint(joint.name)
            for state, index, other in ((qpos, "qposadr", 0), (qvel, "dofadr", 1)):
                count = len(joint.qpos0) if other == 0 else len(joint.damping)
                here, there = int(getattr(joint, index)[0]), int(getattr(same, index)[0])
                state[here : here + count] = whole.start[other][there : there + count]
        return qpos, qvel

    def _servo(self, loops: ModelLoops) -> Servo:
        tangent = self.start[1] / self.start[1][loops.crank]
        inertia = inertia_felt(self.model, self.start[0], tangent)
        return Servo(self.model.actuator(MOTOR).id, inertia, self.build.gain)

    def stepped(self, settings: Settings) -> tuple[ModelLoops, Steps]:
        """Step through the crank motion once."""
        loops = ModelLoops(copy.copy(self.model))
        samples = min(SAMPLES, settings.steps_per_turn)
        stride = max(1, settings.steps_per_turn // samples)
        total = max(1, round(self.profile.turns * samples)) * stride
        controls = None
        if self.build.rod is not None:
            loops.model.eq_active0[:] = 1
            loops.model.tendon_invweight0[:] *= settings.hardness
        if self.build.drive != "flywheel":
            settings = replace(settings, flywheel=NO_FLYWHEEL)
        if self.servo is not None:
            timestep = self.profile.duration / total
            gain = float(self.servo.torque(np.ones(1), timestep)[0])
            loops.model.actuator_gainprm[self.servo.actuator, 0] = gain
            loops.model.actuator_biasprm[self.servo.actuator, 2] = -gain
            # held over a step: right in its middle
            controls = np.zeros((total, loops.model.nu))
            controls[:, self.servo.actuator] = self.profile.state(timestep * np.arange(0.5, total))[1]
        return loops, step(loops, settings, self.profile, self.start, total, stride, controls)

    def motion(self, settings: Settings) -> tuple[Motion | None, float]:
        """Return the motion, None if it diverged, and the processor time of stepping in [s]."""
        loops, steps = self.stepped(settings)
        if steps.diverged:
            return None, steps.processor
        states, force = steps.states, steps.force
        if self.servo is not None:
            # where the motion is evaluated no control is given
            force = self.servo.torque(self.profile.state(states.time)[1], steps.timestep)
        motion = evaluate(loops, self.track, states, "step", force=force)
        if self.build.rod is not None:
            motion = replace(motion, closure=self._stretched(loops, states.qpos))
        return motion, steps.processor

    def _stretched(self, loops: ModelLoops, qpos: Array) -> Array:
        """Return by how much a rod that is only a length is longer or shorter than it was, (n,) in [m]."""
        ends = [i for i in range(self.model.nsite) if self.model.site(i).name.endswith(LENGTH)]
        first, second = np.moveaxis(loops.sites(np.concatenate([self.start[0][None], qpos]))[:, ends], 1, 0)
        lengths = np.linalg.norm(second - first, axis=1)
        return np.abs(lengths[1:] - lengths[0])
