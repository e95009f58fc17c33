"""Search for the cheapest settings with which plain MuJoCo satisfies a tolerance on a scene."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mechsim.numerics.convergence import half_extent
from mechsim.numerics.resources import Budget, Progress, no_progress
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.plain_settings import UNCHANGED, PlainSettings
from mechsim.studies.scene import step_sizes
from mechsim.studies.scene.converged_reference import ConvergedReference, compute_reference
from mechsim.studies.scene.errors import UNITS, By, SceneErrors, SceneEvaluator, SceneTrial
from mechsim.studies.scene.run import step_times
from mechsim.studies.scene.scene import UserScene

# fraction of the tolerance at which the search aims; the rest is a reserve for another phase of the motion,
# rounding of other computers, and instants between records (validation/choices/tuned_scenes.py)
AIMED_FRACTION = 0.8
# number of steps longer than the longest sufficient one that are tried with all settings
LONGER_STEPS = 3
# factor on the duration over which a choice by closure is verified
LONGER_MOTION = 3
# ratio of two steps at which the shorter one is clearly more expensive
CLEARLY_SHORTER = 0.85
# largest trajectory error by closure or torque, relative to the extent of the motion
TRAJECTORY_TOLERANCE = 0.05
# time of a search in [s]; fraction of it for the reference motion; fraction of it at which the trials end
SECONDS, REFERENCE_FRACTION, TRIALS_FRACTION = 50.0, 0.2, 0.75
# number of best settings that are varied, of repetitions, and of settings that are timed again
VARIED, REPETITIONS, TIMED = 3, 3, 12
# number of timing rounds, and their number after the end of the budget
TIMING_ROUNDS, LATE_ROUNDS = 5, 2
# relative difference of times below which they count as equal; fewer changes are then preferred
TIME_TOLERANCE = 0.05
# ratio to the published trajectory error above which the report states it
WORSE_TRAJECTORY = 1.1


@dataclass(frozen=True)
class Tuned:
    """The result of a search.

    Attributes:
        scene: the scene.
        by: the measure.
        tolerance: requested tolerance, in SI.
        published: trial of the file's own settings, with errors measured at every step.
        satisfied: whether the file's own settings satisfy the tolerance.
        chosen: the cheapest settings that satisfy the tolerance; the published settings if none are cheaper;
            None if no settings satisfy it.
        closest: the settings with the smallest error.
        compared: the cheapest trials that satisfy the tolerance at every step, timed in the same rounds as
            the published settings.
        tried: all trials, in order.
        reference: converged motion of the scene.
        seconds: duration of the search.
        errors: errors of the written file, measured at every step; NaN before it is written.
    """

    scene: UserScene
    by: By
    tolerance: float
    published: SceneTrial
    satisfied: bool
    chosen: SceneTrial | None
    closest: SceneTrial
    compared: Sequence[SceneTrial]
    tried: Sequence[SceneTrial]
    reference: ConvergedReference
    seconds: float
    errors: SceneErrors = SceneErrors()

    @property
    def reference_error(self) -> float:
        """Error of the converged motion by the measure, in the unit of the measure."""
        return self.reference.error(self.by)

    @property
    def best(self) -> SceneTrial:
        """The settings that are written."""
        return self.chosen or self.closest

    @property
    def unit(self) -> str:
        """The unit of the tolerance."""
        return UNITS[self.by]

    @property
    def error(self) -> float:
        """The error of the written file plus that of the converged motion."""
        return self.errors.by(self.by) + self.reference_error

    @property
    def published_error(self) -> float:
        """The error of the file as published plus that of the converged motion."""
        return self.published.errors.by(self.by) + self.reference_error

    @property
    def reached(self) -> bool:
        """Whether the written file satisfies the tolerance."""
        return self.error <= self.tolerance

    @property
    def sentences(self) -> list[str]:
        """The result in sentences: first the file as published, then the written file."""
        published = self.published
        tolerance = f"{self.tolerance:g} {self.unit} by {self.by} over {self.scene.duration:g} s"
        if np.isfinite(self.published_error):
            satisfies = "satisfies" if self.satisfied else "does not satisfy"
            figures = _figures(self.published_error, published)
            first = f"as published the file {satisfies} {tolerance}: {figures}"
        else:
            first = f"as published the file does not satisfy {tolerance}: it diverges"
        if not self.best.settings.changes_to(self.scene.model).as_dict():
            cheaper = "; no cheaper settings satisfy it" if self.reached else ""
            return [first, f"the settings stay as published{cheaper}"]
        satisfies = "satisfies" if self.reached else "does not satisfy"
        figures = _figures(self.error, self.best)
        tuned = f"the tuned file {satisfies} it: {figures}{self._cost}"
        return [first, tuned, *self._trajectory, *self._still]

    @property
    def _still(self) -> list[str]:
        """The statement that the scene hardly moves; empty otherwise."""
        run = self.reference.converged_run
        if self.by == "torque" or run is None or run.displacement_range > self.tolerance:
            return []
        return [
            f"its points move by only {run.displacement_range:.2g} m: these settings are for a scene at "
            "rest; give it a motion by --ctrl or --drive"
        ]

    @property
    def _cost(self) -> str:
        ratio = self.best.seconds / self.published.seconds
        if not np.isfinite(ratio) or ratio <= 0.0:
            return ""
        return f", {ratio:.2g} times slower" if ratio > 1.0 else f", {1.0 / ratio:.2g} times faster"

    @property
    def _trajectory(self) -> list[str]:
        """The statement that the trajectory is worse than that of the published file; empty otherwise."""
        after, before = self.errors.trajectory, self.published.errors.trajectory
        worse = after > WORSE_TRAJECTORY * before and after > self.reference.errors[0]
        if self.by == "trajectory" or not worse:
            return []
        times = f", {after / before:.2g} times as far" if before > 0.0 else ""
        return [
            f"its trajectory is worse: up to {after:.2g} m from the scene's limit, as published "
            f"{before:.2g} m{times}; tuning by trajectory bounds it"
        ]


@dataclass
class _SettingSearch:
    scene: UserScene
    by: By
    tolerance: float
    reference: ConvergedReference
    progress: Progress
    budget: Budget
    # largest trajectory error of settings chosen by another measure, in [m]
    max_trajectory_error: float = np.inf
    tried: dict[PlainSettings, SceneTrial] = field(default_factory=dict[PlainSettings, SceneTrial])

    @property
    def evaluator(self) -> SceneEvaluator:
        return self.reference.evaluator(self.by)

    @property
    def ended(self) -> bool:
        return self.budget.spent > TRIALS_FRACTION * self.budget.seconds

    def trial(self, settings: PlainSettings) -> SceneTrial:
        """Return the trial of settings; each is run only once."""
        settings = settings.changes_to(self.scene.model)
        if settings not in self.tried:
            self.tried[settings] = self.evaluator.evaluate(self.scene, settings)
            self.progress(f"{len(self.tried)} settings tried", self.budget.fraction)
        return self.tried[settings]

    def error(self, trial: SceneTrial) -> float:
        """Return the error of a trial plus that of the converged motion."""
        return trial.errors.by(self.by) + self.reference.error(self.by)

    def satisfies(self, trial: SceneTrial) -> bool:
        """Return whether a trial satisfies the tolerance with a reserve and resembles the scene's motion."""
        similar = self.by == "trajectory" or not trial.errors.trajectory > self.max_trajectory_error
        return similar and self.error(trial) <= AIMED_FRACTION * self.tolerance

    def satisfying(self, proposals: Iterable[PlainSettings]) -> list[SceneTrial]:
        """Return the trials that satisfy the tolerance; the end of the budget stops them."""
        trials = [self.trial(settings) for settings in proposals if not self.ended]
        return [trial for trial in trials if self.satisfies(trial)]

    def cheapest(self) -> list[SceneTrial]:
        """Return the trials that satisfy the tolerance; the cheapest is first."""
        return sorted(filter(self.satisfies, self.tried.values()), key=lambda trial: trial.seconds)


@quiet()
def tuned(
    scene: UserScene,
    tolerance: float,
    by: By = "closure",
    *,
    budget: float | Budget = SECONDS,
    progress: Progress = no_progress,
) -> Tuned:
    """Return the cheapest settings with which plain MuJoCo satisfies a tolerance on a scene.

    Args:
        scene: the scene and its motion.
        tolerance: in [m]; by torque in [N m] or [N].
        by: the measure.
        budget: approximate duration of the search, in [s].
        progress: callback after each trial.
    """
    budget = budget if isinstance(budget, Budget) else Budget(budget)
    goal = 0.1 * tolerance if by != "closure" else tolerance
    reference = compute_reference(scene, goal, budget=budget.share(REFERENCE_FRACTION), progress=progress)
    search = _SettingSearch(scene, by, tolerance, reference, progress, budget)
    search.trial(UNCHANGED)
    published = search.evaluator.evaluate(scene, records=None)
    satisfied = search.error(published) <= tolerance
    # up to this error the motion counts as the scene's own
    extent = 0.0 if reference.broken else half_extent(np.moveaxis(reference.run.points, 1, 0))
    own = published.errors.trajectory if np.isfinite(published.errors.trajectory) else 0.0
    search.max_trajectory_error = max(TRAJECTORY_TOLERANCE * extent, tolerance, own)
    _climb(search)
    _vary_best(search)
    published, *compared = _timed(search, [published, *_verified(search)])
    # the fewest changes among those about as fast as the fastest
    least = min((trial.seconds for trial in compared), default=np.inf)
    equal = [trial for trial in compared if trial.seconds <= (1.0 + TIME_TOLERANCE) * least]
    chosen = min(equal, key=lambda trial: (len(trial.settings.as_dict()), search.error(trial)), default=None)
    closest = min(search.tried.values(), key=search.error)
    if chosen is None:
        published, closest = _timed(search, [published, closest])
    if satisfied and (chosen is None or chosen.seconds > (1.0 - TIME_TOLERANCE) * published.seconds):
        chosen = published
    return Tuned(
        scene,
        by,
        tolerance,
        published,
        satisfied,
        chosen,
        closest,
        compared,
        [*search.tried.values()],
        reference,
        budget.spent,
    )


def _climb(search: _SettingSearch) -> None:
    """Try the settings of the longest sufficient steps, and of some longer steps."""
    steps = step_sizes.steps_of(search.scene)
    best: float | None = None
    for step in _longest(search, steps, step_sizes.PROBES):
        if search.satisfying(step_sizes.single_stage(search.scene, step)) and best is None:
            best = step
        if best is not None and step < CLEARLY_SHORTER * best:
            break
    # a step of RK4 is worthwhile only if it is longer by the ratio of the costs
    shortest = 0.0 if best is None else CLEARLY_SHORTER * step_sizes.COSTS["RK4"] * best
    longer = [step for step in steps if step >= shortest]
    for step in _longest(search, longer, step_sizes.FOURTH_ORDER_PROBES):
        proposals = (step_sizes.loop_settings(search.scene, step, *pair) for pair in step_sizes.FOURTH_ORDER)
        if search.satisfying(proposals):
            break


def _longest(
    search: _SettingSearch, steps: Sequence[float], probes: Iterable[tuple[str, float]]
) -> list[float]:
    """Return steps around the longest one that satisfies the tolerance with a probe; the longest is first.

    The bisection assumes that errors decrease with the step. If no step is short enough, the last are
    returned.
    """
    low, high = 0, len(steps)
    while low < high and not search.ended:
        middle = (low + high) // 2
        proposals = (step_sizes.loop_settings(search.scene, steps[middle], *probe) for probe in probes)
        satisfied = any(not search.ended and search.satisfies(search.trial(trial)) for trial in proposals)
        low, high = (low, middle) if satisfied else (middle + 1, high)
    return [*steps[max(0, low - LONGER_STEPS) : low + 2]]


def _vary_best(search: _SettingSearch) -> None:
    """Try variations of the best trials."""
    varied: set[PlainSettings] = set()
    for _ in range(REPETITIONS):
        best = [trial.settings for trial in search.cheapest()[:VARIED] if trial.settings not in varied]
        for settings in best:
            search.satisfying(step_sizes.variants(search.scene, settings))
        varied |= {*best}


def _verified(search: _SettingSearch) -> list[SceneTrial]:
    """Return the cheapest trials that satisfy the tolerance at every step, as many as are timed."""
    trials: list[SceneTrial] = []
    for number, trial in enumerate(search.cheapest()):
        late = number >= 2 * TIMED and (trials or search.budget.fraction >= 1.0)
        if late or len(trials) == TIMED:
            break
        trials += [trial] if _holds_at_every_step(search, trial) else []
    return trials


def _holds_at_every_step(search: _SettingSearch, trial: SceneTrial) -> bool:
    """Return whether a trial satisfies the tolerance at every step; by closure also over a longer motion.

    The longer motion reveals errors that grow slowly, such as those of steps at the stability limit.
    """
    scene, evaluator, duration = search.scene, search.evaluator, search.scene.duration
    if search.by == "closure":
        evaluator = replace(evaluator, reference=None)
        laws = [*scene.joint_laws.values(), *scene.ctrl.values()]
        if not any(getattr(law, "end_time", 0.0) for law in laws):
            duration *= LONGER_MOTION
    again = evaluator.evaluate(scene, trial.settings, records=None, duration=duration)
    if search.by != "trajectory":
        again = replace(again, errors=replace(again.errors, trajectory=trial.errors.trajectory))
    return search.satisfies(again)


def _timed(search: _SettingSearch, trials: Sequence[SceneTrial]) -> list[SceneTrial]:
    """Return trials with times measured in the same rounds; fewer rounds after the end of the budget."""
    scene = search.scene
    rounds = TIMING_ROUNDS if search.budget.fraction < 1.0 else LATE_ROUNDS
    times = step_times([(scene, trial.settings.applied(scene.model)) for trial in trials], rounds)
    return [replace(trial, seconds=float(time)) for trial, time in zip(trials, times, strict=True)]


def _figures(error: float, trial: SceneTrial) -> str:
    return f"error {error:.2g}, {1e3 * trial.seconds:.3g} ms per simulated second"
