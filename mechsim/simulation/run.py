"""One call from a mechanism or a model to its motion in MuJoCo, with an outcome."""

import os
import time as clock
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim import mjcf
from mechsim.errors import AssemblyError, InputError
from mechsim.mechanism import Mechanism
from mechsim.mjcf import Loops, quiet
from mechsim.motion import Motion
from mechsim.scene import Scene
from mechsim.simulation import pose
from mechsim.simulation.profile import Profile, constant
from mechsim.simulation.record import States, Track, add_sensors, evaluate
from mechsim.simulation.settings import Settings
from mechsim.simulation.step import step

Array = NDArray[np.float64]
Method = Literal["step", "pose"]
Outcome = Literal["met", "missed", "diverged", "changed assembly", "cannot assemble"]
Source = Mechanism | mujoco.MjSpec | str | os.PathLike[str]

# instants recorded a turn where nothing else is asked
SAMPLES = 72
# steps a turn of the trial run that finds how many a tolerance needs, and the most that are spent
TRIAL_STEPS, MOST_STEPS = 100, 100_000
# crank angles at which a profile is probed beforehand
PROBES = 64
# a pose this much nearer than the right one, and in units of the stroke this far from it, is another
# assembly; it is looked for at so many pairs of records
NEARER, APART, MOST_PAIRS = 0.5, 0.02, 100
# the settings err as a power of the step (measured in validation/tradeoff/constraint_settings.py)
ORDER = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A run in MuJoCo and how it ended.

    Attributes:
        motion: at the recorded instants; its rates and accelerations belong to the same instants.
        outcome: "met", "missed", "diverged" or "changed assembly".
        tolerance: bound asked for on the place of any tracked point, in [m]; None if none was.
        estimate: the worst place error by the simulator's own account: distance from the pose solved
            at the same crank angle, in [m].
        steps: time steps taken, trials not counted; poses solved for method "pose".
        seconds: time spent stepping or solving, trials not counted.
        settings: how it was stepped; None for method "pose".
        timestep: in [s]; None for method "pose".
        method: "step" or "pose".
    """

    motion: Motion
    outcome: Outcome
    tolerance: float | None
    estimate: float
    steps: int
    seconds: float
    settings: Settings | None
    timestep: float | None = None
    method: Method

    def summary(self) -> dict[str, Any]:
        """Return what `mechsim simulate --json` prints."""
        return {
            "outcome": self.outcome,
            "tolerance": self.tolerance,
            "estimate": self.estimate if np.isfinite(self.estimate) else None,
            "steps": self.steps,
            "seconds": self.seconds,
            "method": self.method,
            "settings": self.settings.as_dict() | {"timestep": self.timestep} if self.settings else {},
        }

    def _repr_html_(self) -> str:
        from mechsim.notebook import run_html

        return run_html(self)


@quiet()
def simulate(
    source: Source,
    *,
    speed: float | None = None,
    turns: float = 1.0,
    profile: Profile | None = None,
    tolerance: float | None = None,
    settings: Settings | None = None,
    method: Method = "step",
    samples: int | None = None,
    scene: Scene | None = None,
) -> Run:
    """Run a mechanism, or a model of one's own, in MuJoCo under a driven crank.

    Args:
        source: a Mechanism; or a specification, an MJCF file or text whose driven hinge is called
            "crank" and whose sites are the tracked points.
        speed: constant crank speed in [rad/s], negative backwards; or give `profile`.
        turns: of the crank, at constant speed.
        profile: the crank's angle over time.
        tolerance: bound on the place of any tracked point, in [m]; the number of steps is then chosen
            by a trial and the result checked against it.
        settings: how to step; with a tolerance their number of steps is replaced.
        method: "step" integrates in time; "pose" solves each crank angle by itself, to rounding.
        samples: instants to record after the first, evenly spread; None takes about 72 a turn. With
            samples given, the number of steps is raised to a multiple of them.
        scene: what the model holds; None takes `Scene(level="motion")`.

    Raises:
        InputError: for values that cannot be used.
        AssemblyError: if the loops close nowhere or only over part of the way.
    """
    if tolerance is not None and not 0.0 < tolerance < np.inf:
        raise InputError(f"tolerance is {tolerance} m; give a finite length above 0")
    if method not in ("step", "pose"):
        raise InputError(f"there is no method {method!r}; known are step, pose")
    model, track, start = _prepared(source, scene)
    if profile is None:
        if speed is None:
            raise InputError("neither a crank speed nor a profile was given; give one of them")
        profile = constant(speed, turns, start)
    if samples is not None and not samples >= 1:
        raise InputError(f"{samples} samples asked for; take at least 1")
    stage = _Stage(model, track, profile, samples)
    if method == "pose":
        return stage.solved(tolerance)
    settings = settings or Settings()
    if tolerance is not None:
        settings = stage.chosen(settings, tolerance)
    run = stage.stepped(settings, tolerance)
    # the trial foretells the error by the order of the settings; where that was too hopeful, go on
    while tolerance is not None and run.outcome == "missed" and settings.steps_per_turn < MOST_STEPS:
        more = 1.3 * (run.estimate / tolerance) ** (1.0 / ORDER)
        fewer = min(MOST_STEPS, int(np.ceil(settings.steps_per_turn * max(more, 1.5))))
        if settings.steps_per_turn < TRIAL_STEPS:
            # too coarse to have begun to converge, it foretells nothing; the trial had this many
            fewer = min(fewer, TRIAL_STEPS)
        settings = replace(settings, steps_per_turn=fewer)
        better = stage.stepped(settings, tolerance)
        if better.outcome != "met" and better.estimate >= 0.5 * run.estimate:
            return min(run, better, key=lambda one: one.estimate)
        run = better
    return run


def load(source: Source, scene: Scene | None = None) -> mujoco.MjSpec:
    """Return the specification of a mechanism, an MJCF file or MJCF text."""
    if isinstance(source, Mechanism):
        return mjcf.assembled(source, scene or Scene())
    if isinstance(source, mujoco.MjSpec):
        return source.copy()
    text = str(source)
    if "<" not in text and not Path(text).is_file():
        raise InputError(f"there is no MJCF file {text!r}; give a file that can be read")
    try:
        return mujoco.MjSpec.from_string(text) if "<" in text else mujoco.MjSpec.from_file(text)
    except ValueError as error:
        raise InputError(f"MuJoCo cannot read the model: {' '.join(str(error).split())}") from error


def _prepared(source: Source, scene: Scene | None) -> tuple[mujoco.MjModel, Track, float]:
    spec = load(source, scene)
    sites = [site.name for site in spec.sites if site.name and "@" not in site.name]
    points = tuple(source.points) if isinstance(source, Mechanism) else tuple(sites)
    if not points:
        raise InputError("the model has no point to track; put a named site at each point of interest")
    track = add_sensors(spec, points)
    model = mjcf.compiled(spec)
    return model, track, float(model.qpos0[Loops(model).crank_place])


class _Stage:
    """A model, what to record of it, and the crank motion it is put through."""

    def __init__(self, model: mujoco.MjModel, track: Track, profile: Profile, samples: int | None):
        self.model, self.track, self.profile, self.samples = model, track, profile, samples
        loops = Loops(model)
        self.begun = loops.close(model.qpos0[None])[0]
        angle, speed, _ = profile.state(np.linspace(0.0, profile.duration, PROBES))
        # all the way, so that a crank that cannot go there is refused before anything is stepped
        self.qpos = pose.follow(loops, self.begun, angle)[:1]
        _, jacobian = loops.linearise(self.qpos)
        self.qvel = loops.tangent(jacobian) * speed[:1, None]

    def solved(self, tolerance: float | None) -> Run:
        """Return the motion with every pose solved by itself."""
        samples = self.samples or max(1, int(np.ceil(SAMPLES * self.profile.turns - 1e-9)))
        time = np.linspace(0.0, self.profile.duration, samples + 1)
        angle, speed, acceleration = self.profile.state(time)
        loops = Loops(self.model)
        begin = clock.perf_counter()
        qpos = pose.follow(loops, self.begun, angle)
        seconds = clock.perf_counter() - begin
        _, jacobian = loops.linearise(qpos)
        states = States(time, qpos, loops.tangent(jacobian) * speed[:, None])
        motion = evaluate(loops, self.track, states, "pose", crank_acceleration=acceleration)
        assert motion.closure is not None
        estimate = float(motion.closure.max(initial=0.0))
        return Run(
            motion=motion,
            outcome="met" if tolerance is None or estimate <= tolerance else "missed",
            tolerance=tolerance,
            estimate=estimate,
            steps=len(qpos),
            seconds=seconds,
            settings=None,
            method="pose",
        )

    def stepped(self, settings: Settings, tolerance: float | None) -> Run:
        """Return the motion stepped in time, and its outcome."""
        import copy

        loops = Loops(copy.copy(self.model))
        total, stride = self._paced(settings)
        steps = step(loops, settings, self.profile, (self.qpos[0], self.qvel[0]), total, stride)
        motion = evaluate(loops, self.track, steps.states, "step", force=steps.force)
        estimate, elsewhere = self._error(steps.states, motion)
        outcome: Outcome = "met"
        if steps.diverged:
            outcome, estimate = "diverged", np.inf
            motion = replace(motion, broken=f"MuJoCo's state went bad after {steps.states.time[-1]:.6g} s")
        elif elsewhere:
            outcome = "changed assembly"
        elif not estimate <= (np.inf if tolerance is None else tolerance):
            outcome = "missed"
        return Run(
            motion=motion,
            outcome=outcome,
            tolerance=tolerance,
            estimate=estimate,
            steps=steps.count,
            seconds=steps.seconds,
            settings=settings,
            timestep=steps.timestep,
            method="step",
        )

    def _paced(self, settings: Settings) -> tuple[int, int]:
        """Return how many steps the run takes and how many lie between two records."""
        total = max(1, int(np.ceil(self.profile.turns * settings.steps_per_turn - 1e-9)))
        if self.samples is None:
            return total, max(1, int(total / (SAMPLES * self.profile.turns)))
        stride = -(-total // self.samples)
        return stride * self.samples, stride

    def chosen(self, settings: Settings, tolerance: float) -> Settings:
        """Return settings with the steps a turn that a tolerance needs, by a coarse trial."""
        estimate = self._trial().stepped(replace(settings, steps_per_turn=TRIAL_STEPS), None).estimate
        if not np.isfinite(estimate):
            return settings
        # half the tolerance for what the trial does not see
        wanted = TRIAL_STEPS * (2.0 * estimate / tolerance) ** (1.0 / ORDER)
        return replace(settings, steps_per_turn=int(np.clip(np.ceil(wanted), 24, MOST_STEPS)))

    def _trial(self) -> "_Stage":
        """Return the stage of a trial: one turn is enough where the speed is steady."""
        if not self.profile.steady or self.profile.turns <= 1.0:
            return self
        (start,), (speed,), _ = self.profile.state(np.zeros(1))
        return _Stage(self.model, self.track, constant(float(speed), 1.0, float(start)), None)

    def _error(self, states: States, motion: Motion) -> tuple[float, bool]:
        """Return the points' worst distance from the solved poses; whether another assembly explains it."""
        loops = Loops(self.model)
        stepped = np.stack([point.position for point in motion.points.values()], 1)
        try:
            true = pose.follow(loops, self.begun, states.qpos[:, loops.crank_place])
        except AssemblyError:
            # the crank came to rest on a dead centre, or beyond: no pose is right there
            return float("inf"), False
        error = self._distances(loops, stepped, true)
        worst = int(np.argmax(error))
        stroke = 0.5 * float(np.ptp(loops.sites(true)[:, self._sites], axis=0).max())
        return float(error[worst]), self._elsewhere(loops, states.qpos, stepped, error, APART * stroke)

    def _elsewhere(self, loops: Loops, qpos: Array, stepped: Array, error: Array, apart: float) -> bool:
        """Say whether two records in a row, both far off, lie in another assembly, not in none."""
        far = error > apart
        pairs = np.flatnonzero(far[1:] & far[:-1])
        tried = pairs[np.unique(np.linspace(0, len(pairs) - 1, MOST_PAIRS).astype(int))] if len(pairs) else []
        for i in tried:
            both = slice(i, i + 2)
            try:
                nearest = loops.close(qpos[both])
            except AssemblyError:
                continue
            if (self._distances(loops, stepped[both], nearest) < NEARER * error[both]).all():
                return True
        return False

    def _distances(self, loops: Loops, stepped: Array, states: Array) -> Array:
        """Return the distance of the farthest of points (n, k, 3) from where states put them, (n,)."""
        gaps = np.sqrt(((stepped - loops.sites(states)[:, self._sites]) ** 2).sum(-1)).max(1)
        return np.where(np.isfinite(gaps), gaps, np.inf)

    @property
    def _sites(self) -> list[int]:
        return [self.model.site(name).id for name in self.track.points]
