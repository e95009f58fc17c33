"""The search for the cheapest settings that keep a tolerance, by trial runs of the scene itself."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from mechsim.numerics.convergence import half_extent
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.scene import (
    By,
    SceneErrors,
    SceneLimit,
    SceneRun,
    UserScene,
    errors_of,
    limit_of,
    step_times,
    stepped,
)
from mechsim.studies.scene.settings import PlainSettings
from mechsim.studies.scene.step_sizes import (
    COSTS,
    cheap,
    dear,
    fourth,
    harder,
    hardest,
    probes,
    steps_of,
    variants,
)

# part of the tolerance aimed at: what is left is for another phase of the motion, another machine's rounding,
# and instants between records (measured in validation/choices/tuned_scenes.py)
AIM = 0.8
# so many steps of the ladder, each longer than the longest that keeps the tolerance with a few settings, are
# tried with all
LONGER = 3
# part of a step that makes a shorter one clearly dearer
CLEARLY = 0.85
# by closure or torque a scene's motion must stay the same: within this part of its extent of its limit
SAME = 0.05
# the search's time in [s], and what of it is for the limit of the scene, for trials and for timing
SECONDS, TRIALS = 50.0, 0.75
# settings refined, how often what is then best is refined again, and settings timed again
REFINED, AGAIN, TIMED = 3, 3, 12
# rounds of timing, and where there is no time left
ROUNDS, LATE = 5, 2
# times that differ by less are the same: then fewer changes are better
ALIKE = 0.05
Tell = Callable[[float, str], None]
Few = Callable[[UserScene, float], Iterable[PlainSettings]]


@dataclass(frozen=True, slots=True)
class SceneTrial:
    """Settings that were tried.

    Attributes:
        settings: tried.
        errors: of the run.
        seconds: processor time of a simulated second, in [s].
    """

    settings: PlainSettings
    errors: SceneErrors
    seconds: float


@dataclass(frozen=True)
class Tuned:
    """What a search found.

    Attributes:
        scene: that was tuned.
        by: the measure.
        tolerance: asked for.
        published: the file as it is, its errors measured at every step.
        satisfied: whether the file as it is satisfies the tolerance.
        chosen: the cheapest that satisfies the tolerance; the published settings where they do and nothing
            tried is cheaper; None where no file can.
        closest: that errs least of all that a file can say.
        beyond: the cheapest that keeps it by what no file can say; None where a file can, or nothing does.
        tried: all, in order.
        limit: of the scene.
        seconds: that the search took.
    """

    scene: UserScene
    by: By
    tolerance: float
    published: SceneTrial
    satisfied: bool
    chosen: SceneTrial | None
    closest: SceneTrial
    beyond: SceneTrial | None
    tried: Sequence[SceneTrial]
    limit: SceneLimit
    seconds: float

    @property
    def bar(self) -> float:
        """The error of the limit by which the measure judges, in its unit."""
        return bar_of(self.by, self.limit)


@dataclass
class _SettingSearch:
    scene: UserScene
    by: By
    tolerance: float
    limit: SceneLimit
    allowed: float
    tell: Tell
    seconds: float
    began: float = field(default_factory=perf_counter)
    tried: dict[PlainSettings, SceneTrial] = field(default_factory=dict[PlainSettings, SceneTrial])
    extra: bool = False

    @property
    def spent(self) -> float:
        return (perf_counter() - self.began) / self.seconds

    @property
    def part(self) -> float:
        return min(1.0, self.spent)

    @property
    def late(self) -> bool:
        return self.spent > (1.0 if self.extra else TRIALS)

    def trial(self, settings: PlainSettings) -> SceneTrial:
        """Return what settings give, run once."""
        settings = settings.without_idle(self.scene.model)
        if settings not in self.tried:
            run = stepped(self.scene, settings.applied(self.scene.model))
            errors = errors_at(run, self.limit, self.by)
            self.tried[settings] = SceneTrial(settings, errors, run.seconds_per_second)
            self.tell(self.part, f"{len(self.tried)} settings tried")
        return self.tried[settings]

    def error(self, trial: SceneTrial) -> float:
        """Return a trial's error, what is not known of the limit added."""
        return trial.errors.by(self.by) + bar_of(self.by, self.limit)

    def at_every_step(self, trial: SceneTrial) -> SceneTrial:
        """Return a trial with its errors at every step of the motion."""
        run = stepped(self.scene, trial.settings.applied(self.scene.model), records=None)
        return replace(trial, errors=errors_at(run, self.limit, self.by))

    def kept(self, trial: SceneTrial) -> bool:
        """Whether a trial keeps the tolerance, with what is left for what it did not see, and the motion."""
        same = self.by == "trajectory" or not trial.errors.trajectory > self.allowed
        return same and self.error(trial) <= AIM * self.tolerance

    def passing(self, settings: Iterable[PlainSettings]) -> list[SceneTrial]:
        """Return those that keep the tolerance, as long as there is time."""
        found: list[SceneTrial] = []
        for one in settings:
            if self.late:
                break
            trial = self.trial(one)
            found += [trial] if self.kept(trial) else []
        return found

    def cheapest(self, in_file: bool = True) -> list[SceneTrial]:
        """Return what keeps the tolerance, the cheapest first."""
        found = [one for one in self.tried.values() if self.kept(one) and one.settings.in_file == in_file]
        return sorted(found, key=lambda one: one.seconds)


def bar_of(by: By, limit: SceneLimit) -> float:
    """Return the error of the limit by which a measure judges, in its unit."""
    return {"closure": 0.0, "trajectory": limit.bars[0], "torque": limit.bars[1]}[by]


def errors_at(run: SceneRun, limit: SceneLimit, by: By) -> SceneErrors:
    """Return the errors of a run as a measure needs them."""
    return errors_of(run, None if limit.broken else limit, torque=by == "torque")


@quiet()
def tuned(
    scene: UserScene,
    tolerance: float,
    by: By = "closure",
    *,
    seconds: float = SECONDS,
    tell: Tell = lambda _part, _done: None,
) -> Tuned:
    """Return the cheapest settings with which plain MuJoCo keeps a tolerance on a scene.

    Args:
        scene: the scene and its motion.
        tolerance: in [m], of torque in [N m] or [N].
        by: measure that counts.
        seconds: about which the search takes.
        tell: told what part is done, and what.
    """
    began = perf_counter()
    goal = 0.1 * tolerance if by != "closure" else tolerance
    limit = limit_of(scene, goal, seconds=0.2 * seconds, tell=lambda said: tell(0.0, said))
    search = _SettingSearch(scene, by, tolerance, limit, np.inf, tell, seconds, began)
    published = search.at_every_step(search.trial(PlainSettings()))
    satisfied = search.error(published) <= tolerance
    extent = 0.0 if limit.broken else half_extent([limit.run.points[:, k] for k in range(len(scene.places))])
    before = published.errors.trajectory
    search.allowed = max(SAME * extent, tolerance, before if np.isfinite(before) else 0.0)
    _climb(search)
    chosen = _refined(search)
    beyond = None if chosen is not None or satisfied else _beyond(search)
    in_file = [one for one in search.tried.values() if one.settings.in_file]
    closest = min(in_file, key=search.error)
    timed = [one for one in (chosen, beyond, None if chosen else closest) if one is not None]
    fair = _timed(search, [published, *timed])
    published = fair[0]
    again = dict(zip((id(one) for one in timed), fair[1:], strict=True))
    chosen = None if chosen is None else again[id(chosen)]
    if satisfied and (chosen is None or chosen.seconds > (1.0 - ALIKE) * published.seconds):
        chosen = published
    return Tuned(
        scene,
        by,
        tolerance,
        published,
        satisfied,
        chosen,
        again.get(id(closest), closest),
        None if beyond is None else again[id(beyond)],
        [*search.tried.values()],
        limit,
        perf_counter() - began,
    )


def _climb(search: _SettingSearch) -> None:
    """Try the settings of the longest steps that keep the tolerance, and of some that are longer still."""
    steps = steps_of(search.scene)
    best: float | None = None
    for step in _near(search, steps, probes):
        if search.passing(cheap(search.scene, step)) and best is None:
            best = step
        if best is not None and step < CLEARLY * best:
            break
    # a step of fourth order is worth it where it is so many times longer
    worth = [step for step in steps if best is None or step >= CLEARLY * COSTS["RK4"] * best]
    for step in _near(search, worth, fourth):
        if search.passing(dear(search.scene, step)):
            break


def _near(search: _SettingSearch, steps: Sequence[float], few: Few) -> list[float]:
    """Return steps, longest first, from some too long for a few settings to the longest that is not.

    That errors fall with the step is believed; where none is short enough, the last are returned.
    """
    low, high = 0, len(steps)
    while low < high and not search.late:
        middle = (low + high) // 2
        probed = few(search.scene, steps[middle])
        kept = any(not search.late and search.kept(search.trial(one)) for one in probed)
        low, high = (low, middle) if kept else (middle + 1, high)
    return [*steps[max(0, low - LONGER) : low + 2]]


def _refined(search: _SettingSearch) -> SceneTrial | None:
    """Return the cheapest that keeps the tolerance, after a look at what lies near the best."""
    around: set[PlainSettings] = set()
    for _ in range(AGAIN):
        near = [one.settings for one in search.cheapest()[:REFINED] if one.settings not in around]
        for settings in near:
            search.passing(variants(search.scene, settings))
        around |= {*near}
    best = _standing(search)
    if not best:
        return None
    fair = _timed(search, best)
    least = min(one.seconds for one in fair)
    near = [one for one in fair if one.seconds <= (1.0 + ALIKE) * least]
    return min(near, key=lambda one: (len(one.settings.as_dict()), search.error(one)))


def _standing(search: _SettingSearch) -> list[SceneTrial]:
    """Return the cheapest that satisfy the tolerance at every step, as many as are timed."""
    found: list[SceneTrial] = []
    for number, one in enumerate(search.cheapest()):
        enough = number >= 2 * TIMED and (found or search.part >= 1.0)
        if enough or len(found) == TIMED:
            break
        found += [one] if _stands(search, one) else []
    return found


def _stands(search: _SettingSearch, trial: SceneTrial) -> bool:
    """Whether a trial keeps the tolerance at every step, by closure also over a motion that goes on longer.

    What grows slowly, as steps at the edge of stability do, is seen in this way.
    """
    scene, model = search.scene, trial.settings.applied(search.scene.model)
    motion_laws = [*scene.drive.values(), *scene.ctrl.values()]
    longer = (
        LONGER
        if search.by == "closure" and not any(getattr(one, "end_time", 0.0) for one in motion_laws)
        else 1.0
    )
    run = stepped(scene, model, records=None, duration=longer * scene.duration)
    limit = None if search.by == "closure" or search.limit.broken else search.limit
    errors = errors_of(run, limit, torque=search.by == "torque")
    if search.by != "trajectory":
        errors = replace(errors, trajectory=trial.errors.trajectory)
    return search.kept(replace(trial, errors=errors))


def _timed(search: _SettingSearch, trials: Sequence[SceneTrial]) -> list[SceneTrial]:
    """Return trials with their times measured side by side; where the search is late, in fewer rounds."""
    model = search.scene.model
    rounds = ROUNDS if search.part < 1.0 else LATE
    times = step_times([(search.scene, one.settings.applied(model)) for one in trials], rounds)
    return [replace(one, seconds=float(each)) for one, each in zip(trials, times, strict=True)]


def _beyond(search: _SettingSearch) -> SceneTrial | None:
    """Return the cheapest that keeps the tolerance with loops harder than a file can say."""
    search.extra = True
    for step in _near(search, steps_of(search.scene), hardest):
        search.passing(harder(search.scene, step))
    found = search.cheapest(in_file=False)
    return found[0] if found else None


# a trajectory that is farther from the limit by less than this factor is as good as before
WORSE = 1.1
UNITS = {"closure": "m", "trajectory": "m", "torque": "N m"}


@dataclass(frozen=True)
class TuningReport:
    """What a search came to, measured at every step of the written file.

    Attributes:
        found: the search.
        errors: of the written file.
    """

    found: Tuned
    errors: SceneErrors

    @property
    def best(self) -> SceneTrial:
        """The settings that are written."""
        return self.found.chosen or self.found.closest

    @property
    def unit(self) -> str:
        """The unit of the tolerance."""
        return UNITS[self.found.by]

    @property
    def bar(self) -> float:
        """The error of the limit by which the measure judges."""
        return self.found.bar

    @property
    def error(self) -> float:
        """The error of the written file, that of the limit included."""
        return self.errors.by(self.found.by) + self.bar

    @property
    def published_error(self) -> float:
        """The error of the file as published, that of the limit included."""
        return self.found.published.errors.by(self.found.by) + self.bar

    @property
    def reached(self) -> bool:
        """Whether the written file satisfies the tolerance."""
        return self.error <= self.found.tolerance

    @property
    def unchanged(self) -> bool:
        """Whether the written file has the settings of the published one."""
        return not self.best.settings.without_idle(self.found.scene.model).as_dict()

    @property
    def sentences(self) -> list[str]:
        """The result in sentences: the file as published first, then what is written."""
        found, published = self.found, self.found.published
        tolerance = f"{found.tolerance:g} {self.unit} by {found.by} over {found.scene.duration:g} s"
        if np.isfinite(self.published_error):
            satisfies = "satisfies" if found.satisfied else "does not satisfy"
            figures = self._figures(self.published_error, published)
            first = f"as published the file {satisfies} {tolerance}: {figures}"
        else:
            first = f"as published the file does not satisfy {tolerance}: it diverges"
        satisfies = "satisfies" if self.reached else "does not satisfy"
        figures = self._figures(self.error, self.best)
        if self.unchanged:
            cheaper = "; no cheaper settings satisfy it" if self.reached else ""
            return [first, f"the settings stay as published{cheaper}"]
        return [first, f"the tuned file {satisfies} it: {figures}{self._cost}", *self._trajectory]

    @staticmethod
    def _figures(error: float, trial: SceneTrial) -> str:
        return f"error {error:.2g}, {1e3 * trial.seconds:.3g} ms a simulated second"

    @property
    def _cost(self) -> str:
        ratio = self.best.seconds / self.found.published.seconds
        if not np.isfinite(ratio) or ratio <= 0.0:
            return ""
        return f", {ratio:.2g} times slower" if ratio > 1.0 else f", {1.0 / ratio:.2g} times faster"

    @property
    def _trajectory(self) -> list[str]:
        """State a trajectory that is worse than that of the published file."""
        after, before = self.errors.trajectory, self.found.published.errors.trajectory
        if (
            self.found.by == "trajectory"
            or not after > WORSE * before
            or not after > self.found.limit.bars[0]
        ):
            return []
        times = f", {after / before:.2g} times as far" if before > 0.0 else ""
        return [
            f"its trajectory is worse: up to {after:.2g} m from the scene's limit, as published "
            f"{before:.2g} m{times}; tuning by trajectory bounds it"
        ]
