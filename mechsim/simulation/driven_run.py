"""A model put through one crank motion, stepped or solved, and judged by its solved poses."""

import copy
import time as clock
from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError, InputError
from mechsim.model.crank_profile import CrankProfile, constant
from mechsim.model.motion import Motion
from mechsim.simulation.model_loops import RANK_TOLERANCE, ModelLoops
from mechsim.simulation.poses import follow
from mechsim.simulation.recorded_motion import States, Track, evaluate
from mechsim.simulation.run_result import Outcome, Run
from mechsim.simulation.settings import Settings
from mechsim.simulation.stepping import MOST_STEPS, Steps, Watch, step, unwatched

Array = NDArray[np.float64]

# instants recorded a turn where nothing else is asked
SAMPLES = 72
MOST_RECORDS = 10_000_000
# crank angles at which a profile is probed beforehand
PROBES = 64
# a pose this much nearer than the right one, and in units of the stroke this far from it, is another
# assembly; it is looked for at so many pairs of records
NEARER, APART, MOST_PAIRS = 0.5, 0.02, 100
# a crank this far from where it is driven, in [rad], is driven no more
LOST = np.pi
# turn, in [rad], by which a freedom that the crank leaves is tried
NUDGE = 1e-4


class DrivenRun:
    """A model, what to record of it, and the crank motion it is put through."""

    def __init__(
        self,
        model: mujoco.MjModel,
        track: Track,
        profile: CrankProfile,
        samples: int | None,
        watch: Watch = unwatched,
    ):
        self.model, self.track, self.profile, self.samples = model, track, profile, samples
        self.watch = watch
        records = samples or SAMPLES * profile.turns
        if records > MOST_RECORDS:
            raise InputError(
                f"{records:.3g} instants of {profile.turns:g} turns would be recorded; take {MOST_RECORDS:,} "
                "at the most: fewer turns, or records farther apart"
            )
        loops = ModelLoops(model)
        self.begun = loops.close(model.qpos0[None])[0]
        angle, speed, _ = profile.state(np.linspace(0.0, profile.duration, PROBES))
        # all the way, so that a crank that cannot go there is refused before anything is stepped
        self.qpos = follow.follow(loops, self.begun, angle)[:1]
        _, jacobian = loops.linearise(self.qpos)
        self.qvel = loops.tangent(jacobian) * speed[:1, None]

    @property
    def free(self) -> bool:
        """Whether the tracked points can move with the crank held: then poses alone do not settle them."""
        loops = ModelLoops(self.model)
        held = loops.linearise(self.qpos)[1][0][:, loops.free]
        _, values, freedoms = np.linalg.svd(held)
        rank = int((values > RANK_TOLERANCE * values.max(initial=0.0)).sum())
        moves = np.zeros((len(freedoms) - rank, self.model.nv))
        moves[:, loops.free] = NUDGE * freedoms[rank:]
        nudged = loops.moved(np.repeat(self.qpos, len(moves), 0), moves)
        places = loops.sites(np.concatenate([self.qpos, nudged]))[:, self._sites]
        # the second order, a nudge's square, is what a closed loop lets a point move
        return bool(np.abs(places[1:] - places[0]).max(initial=0.0) > NUDGE**1.5 * loops.size)

    def solved(self, tolerance: float) -> Run:
        """Return the motion with every pose solved by itself."""
        samples = self.samples or max(1, int(np.ceil(SAMPLES * self.profile.turns - 1e-9)))
        time = np.linspace(0.0, self.profile.duration, samples + 1)
        angle, speed, acceleration = self.profile.state(time)
        loops = ModelLoops(self.model)
        begin = clock.perf_counter()
        qpos = follow.follow(loops, self.begun, angle)
        seconds = clock.perf_counter() - begin
        _, jacobian = loops.linearise(qpos)
        states = States(time, qpos, loops.tangent(jacobian) * speed[:, None])
        motion = evaluate(loops, self.track, states, "pose", crank_acceleration=acceleration)
        assert motion.closure is not None
        estimate = float(motion.closure.max(initial=0.0))
        return Run(
            motion=motion,
            outcome="met" if estimate <= tolerance else "missed",
            tolerance=tolerance,
            estimate=estimate,
            steps=len(qpos),
            seconds=seconds,
            settings=None,
            method="pose",
        )

    def stepped(self, settings: Settings, tolerance: float) -> Run:
        """Return the motion stepped in time, and its outcome."""
        steps, motion = self._stepped(settings)
        outcome: Outcome = "met"
        broken = self._broken(steps, motion)
        estimate, elsewhere = (np.inf, False) if broken else self._error(steps.states, motion)
        if broken:
            outcome, motion = "diverged", replace(motion, broken=broken)
        elif elsewhere:
            outcome = "changed assembly"
        elif not estimate <= tolerance:
            outcome = "missed"
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
        )

    def _broken(self, steps: Steps, motion: Motion) -> str:
        """Return in one sentence why a run is none; nothing where it is one."""
        if steps.diverged:
            return f"MuJoCo's state went bad after {steps.states.time[-1]:.6g} s"
        meant = self.profile.state(steps.states.time)[0]
        lost = np.abs(motion.angle - meant) > LOST
        if lost.any():
            at = int(np.argmax(lost))
            return (
                f"after {steps.states.time[at]:.6g} s the crank stands at {motion.angle[at]:.6g} rad "
                f"instead of {meant[at]:.6g}: the linkage turns its flywheel"
            )
        return ""

    def tried(self, settings: Settings) -> Array:
        """Return the worst distance from the solved poses in each turn, (turns,) in [m]; inf if it broke."""
        steps, motion = self._stepped(settings)
        turns = max(1, round(self.profile.turns))
        worst = np.full(turns, np.inf)
        if self._broken(steps, motion):
            return worst
        true = self._true(steps.states)
        if len(true) < len(steps.states.qpos):
            return worst
        error = self._distances(ModelLoops(self.model), _places(motion), true)
        of = np.minimum(turns * steps.states.time // (self.profile.duration * (1.0 + 1e-9)), turns - 1)
        return np.array([error[of == turn].max() for turn in range(turns)])

    def _stepped(self, settings: Settings) -> tuple[Steps, Motion]:
        loops = ModelLoops(copy.copy(self.model))
        total, stride = self._paced(settings)
        start = self.qpos[0], self.qvel[0]
        steps = step(loops, settings, self.profile, start, total, stride, watch=self.watch)
        return steps, evaluate(loops, self.track, steps.states, "step", force=steps.force)

    def _paced(self, settings: Settings) -> tuple[int, int]:
        """Return how many steps the run takes and how many lie between two records."""
        wanted = self.profile.turns * settings.steps_per_turn
        if wanted > MOST_STEPS:
            raise InputError(
                f"{self.profile.turns:g} turns of {settings.steps_per_turn:,} steps are {wanted:.3g} steps, "
                f"hours of work; take {MOST_STEPS:,} at the most"
            )
        total = max(1, int(np.ceil(self.profile.turns * settings.steps_per_turn - 1e-9)))
        if self.samples is None:
            return total, max(1, int(total / (SAMPLES * self.profile.turns)))
        stride = -(-total // self.samples)
        return stride * self.samples, stride

    def first(self, turns: float) -> "DrivenRun":
        """Return the stage of the first turns; of the whole way where that is shorter, or not steady."""
        if not self.profile.steady or self.profile.turns <= turns:
            return self
        (start,), (speed,), _ = self.profile.state(np.zeros(1))
        profile = constant(float(speed), turns, float(start))
        return DrivenRun(self.model, self.track, profile, None, self.watch)

    def _error(self, states: States, motion: Motion) -> tuple[float, bool]:
        """Return the points' worst distance from the solved poses; whether another assembly explains it."""
        true = self._true(states)
        known = len(true)
        loops, stepped, qpos = ModelLoops(self.model), _places(motion)[:known], states.qpos[:known]
        error = self._distances(loops, stepped, true)
        stroke = 0.5 * float(np.ptp(loops.sites(true)[:, self._sites], axis=0).max())
        elsewhere = self._elsewhere(loops, qpos, stepped, error, APART * stroke)
        return float(error.max()) if known == len(states.qpos) else np.inf, elsewhere

    def _true(self, states: States) -> Array:
        """Return the poses solved at the crank angles of states, from the first to the last that has one.

        A crank that the linkage drove beyond a dead centre has none there.
        """
        loops = ModelLoops(self.model)
        angles = states.qpos[:, loops.crank_place]
        count, known, beyond = len(angles), 1, len(angles) + 1
        true = states.qpos[:1]
        while beyond - known > 1:
            try:
                true = follow.follow(loops, self.begun, angles[:count])
                known = count
            except AssemblyError:
                beyond = count
            count = (known + beyond) // 2
        return true

    def _elsewhere(self, loops: ModelLoops, qpos: Array, stepped: Array, error: Array, apart: float) -> bool:
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

    def _distances(self, loops: ModelLoops, stepped: Array, states: Array) -> Array:
        """Return the distance of the farthest of points (n, k, 3) from where states put them, (n,)."""
        gaps = np.sqrt(((stepped - loops.sites(states)[:, self._sites]) ** 2).sum(-1)).max(1)
        return np.where(np.isfinite(gaps), gaps, np.inf)

    @property
    def _sites(self) -> list[int]:
        return [self.model.site(name).id for name in self.track.points]


def _places(motion: Motion) -> Array:
    """Return the places of all points of a motion, (n, k, 3)."""
    return np.stack([point.position for point in motion.points.values()], 1)
