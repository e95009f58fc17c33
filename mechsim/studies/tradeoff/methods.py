"""Stepping methods of `mechsim tradeoff`, each a curve over the number of steps, and the compared mechanism.

A method determines everything except the step: integrator, time constant of the loops (in steps, or as a
fraction of a revolution), compliance, impedance, refsafe and diagexact.
"""

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mechsim.compare.quantities import QUANTITIES, motion_scales
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import CrankProfile
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import Array, worst
from mechsim.numerics.convergence import half_extent
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.custom_model import at_initial_state, from_spec, parameter_profile
from mechsim.simulation.driven_run import first_state
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.plain_settings import INTEGRATORS
from mechsim.simulation.recording import evaluate
from mechsim.simulation.settings import LEAST_CONSTANT, Settings
from mechsim.simulation.source import CRANK, assembled, require_points
from mechsim.simulation.stepping import Steps, step
from mechsim.studies.motions import profile_of

# numbers of steps per revolution; each divides 72 instants per revolution, or is a multiple of 72
STEPS = (24, 36, 72, 144, 288, 720, 1440, 2880, 7200)
MUJOCO_SOLREF, MUJOCO_SOLIMP = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
DEFAULTS = "MuJoCo's defaults"
LOW_COMPLIANCE = "RK4, turn/10, 1e-08"
# MuJoCo's own compliance scale
PLAIN = Settings(compliance=1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class SteppingMethod:
    """Settings that differ only in the number of steps.

    Attributes:
        name: name in tables and plots.
        base: settings without the number of steps.
        rank: priority; methods of low rank are tried first.
        turn_fraction: time constant of the loops as a fraction of a revolution; None selects that of `base`.
        direct: whether stiffness and damping are 1/step squared and 1/step.
    """

    name: str
    base: Settings
    rank: int
    turn_fraction: float | None = None
    direct: bool = False

    def settings(self, steps: int, speed: float) -> Settings:
        """Return the settings for a number of steps per revolution at a crank speed in [rad/s]."""
        settings = replace(self.base, steps_per_turn=steps)
        if self.turn_fraction is not None:
            return replace(settings, constant_steps=max(LEAST_CONSTANT, self.turn_fraction * steps))
        if self.direct:
            rate = 1.0 / settings.timestep(speed)
            return replace(settings, solref=(-(rate**2), -rate))
        return settings


def stepping_methods() -> list[SteppingMethod]:
    """Return all methods."""
    defaults = replace(PLAIN, integrator="Euler", solref=MUJOCO_SOLREF, solimp=MUJOCO_SOLIMP, refsafe=True)
    hard = SteppingMethod(name=LOW_COMPLIANCE, base=Settings(), rank=0, turn_fraction=0.1)
    methods = [SteppingMethod(name=DEFAULTS, base=defaults, rank=0), hard]
    for integrator in INTEGRATORS:
        methods += _of_integrator(integrator)
    return methods


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


# number of records of a compared run per revolution: every five degrees
MAX_SAMPLES_PER_TURN = 72


@dataclass(frozen=True, slots=True)
class BuiltModel:
    """A model and its crank motion.

    Attributes:
        closed: the model; each trial steps a copy.
        profile: motion of the crank.
        start: initial state and rates, (nq,) and (nv,).
    """

    closed: ClosedModel
    profile: CrankProfile
    start: tuple[Array, Array]

    def stepped(self, settings: Settings) -> tuple[ModelLoops, Steps]:
        """Step through the crank motion once."""
        loops = replace(self.closed.loops, model=copy.copy(self.closed.loops.model))
        samples = min(MAX_SAMPLES_PER_TURN, settings.steps_per_turn)
        interval = max(1, settings.steps_per_turn // samples)
        total = max(1, round(self.profile.turns * samples)) * interval
        return loops, step(loops, settings, self.profile, self.start, total, interval)

    def motion(self, settings: Settings) -> tuple[Motion | None, float]:
        """Return the motion (None if it diverged), and the processor time of stepping in [s]."""
        loops, steps = self.stepped(settings)
        if steps.diverged:
            return None, steps.processor
        states = replace(steps.states, force=steps.force)
        return evaluate(loops, self.closed.track, states, "step"), steps.processor


def build_model(solver: KinematicSolver, profile: CrankProfile) -> BuiltModel:
    """Generate the model of a mechanism and close its loops at the start of its motion.

    Raises:
        AssemblyError: if the drivers cannot make their whole motion.
    """
    spec, laws = assembled(solver.mechanism, Scene(level="motion")), solver.motion_laws
    drivers = CRANK if laws.crank else laws.drivers
    closed = at_initial_state(from_spec(spec, tuple(solver.mechanism.points), drivers), laws)
    return BuiltModel(closed, profile, first_state(closed, profile))


# compared quantities; the drive is compared with its profile
COMPARED = ("position", "velocity", "acceleration", "angle", "loop", "drive")
# ratio of the crank speed to its target above which a run counts as diverged
MAX_SPEED_RATIO = 1e6


@dataclass(frozen=True, slots=True)
class Subject:
    """The mechanism on which the trade-off is measured.

    Attributes:
        name: name of the mechanism.
        built: its model.
        solver: its exact motion, with which trials are compared.
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, or angular frequency of the fastest driver, in [rad/s].
    """

    name: str
    built: BuiltModel
    solver: KinematicSolver
    stroke: float
    speed: float

    def errors(self, motion: Motion | None) -> dict[str, float]:
        """Return the largest errors by quantity.

        Position and loop residual are in strokes, velocity and acceleration in strokes and crank speeds,
        angle and drive in [rad], of a sliding driver in strokes; all are infinite for a diverged motion. The
        drive error is the distance of the drivers from their motion. The other errors are measured at the
        actual driver positions.
        """
        if motion is None or not worst(motion.speed) <= MAX_SPEED_RATIO * self.speed:
            return dict.fromkeys(COMPARED, np.inf)
        exact = self.solver.whole_motion_as(motion)
        scales = motion_scales(self.stroke, self.speed)
        errors = {name: QUANTITIES[name].largest(motion, exact, scales) for name in COMPARED[:-1]}
        assert motion.time is not None
        laws = self.solver.motion_laws
        if laws.crank:
            return errors | {"drive": worst(motion.angle - self.built.profile.state(motion.time)[0])}
        straight = [self.solver.mechanism.unit(name) == "m" for name in laws.drivers]
        driven = np.array([motion.joints[name].value for name in laws.drivers])
        away = (driven - laws.state(motion.time)[0]) / np.where(straight, self.stroke, 1.0)[:, None]
        return errors | {"drive": worst(away)}


def subject_of(solver: KinematicSolver, speed: float) -> Subject:
    """Return a mechanism as a subject, with its formulas or the loop equations as the reference.

    Under motion laws a turn is a cycle of the fastest driver, or the whole motion if that is shorter.

    Args:
        solver: of the mechanism.
        speed: of the crank in [rad/s].

    Raises:
        InputError: for a mechanism without tracked points.
        AssemblyError: if the drivers cannot make their whole motion.
    """
    laws = solver.motion_laws
    profile = profile_of(solver, speed, 1.0) if laws.crank else parameter_profile(laws)
    angles = profile.state(np.linspace(0.0, profile.duration, 361))[0]
    solver = solver.starting_at(angles)
    require_points(solver.mechanism)
    stroke = half_extent(path.position for path in solver.whole_motion(angles).points.values())
    return Subject(solver.name, build_model(solver, profile), solver, stroke, profile.max_speed)
