"""Search for a reduced scene: candidates are applied one by one; a second motion verifies the result."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.model.progress import Progress, no_progress
from mechsim.simulation.mjcf.compiling import quiet, to_xml
from mechsim.studies.reduction.candidates import CATEGORIES
from mechsim.studies.reduction.candidates.bodies import NotApplicable, RemovalCandidate, with_candidate
from mechsim.studies.reduction.candidates.stepping import LONGER_STEPS, longer_steps
from mechsim.studies.reduction.reduced_scene import (
    Evidence,
    ReducedSceneEvaluator,
    observe,
    second_motion,
    time_ratios,
)
from mechsim.studies.scene.errors import DIVERGED, SceneErrors
from mechsim.studies.scene.scene import UserScene

By = Literal["trajectory", "torque"]
# fraction of the tolerance available to the reduced scene on the user's motion
SEARCH_FRACTION = 0.9
# smallest such fraction in a search for longer steps after a failed verification
MIN_SEARCH_FRACTION = 0.2
# error relative to the tolerance below which a candidate costs no accuracy
NEGLIGIBLE = 1e-3
# largest ratio of times at which a candidate that costs accuracy is accepted
MAX_TIME_RATIO = 0.97
# number of longer steps within the tolerance that are timed, the least expensive by estimate first
MAX_TIMED = 5


@dataclass(frozen=True, slots=True)
class RemovedElement:
    """An applied candidate.

    Attributes:
        candidate: the change.
        error: error of the scene with this change and all before it, in the unit of the tolerance.
    """

    candidate: RemovalCandidate
    error: float


@dataclass(frozen=True)
class Reduction:
    """A reduced scene.

    Attributes:
        text: MJCF of the reduced scene.
        left_out: applied candidates, in order.
        errors: errors over the user's motion and over the second motion.
        speedup: time of the full scene relative to that of the reduced scene.
        time: processor time of a simulated second of the full scene, in [s].
        tried: number of candidates tried.
        undone: candidates reverted because the result exceeded the tolerance.
        by: the measure.
    """

    text: str
    left_out: Sequence[RemovedElement]
    errors: tuple[SceneErrors, SceneErrors]
    speedup: float
    time: float
    tried: int
    undone: Sequence[str]
    by: By

    def kept(self, tolerance: float) -> bool:
        """Return whether the reduced scene satisfies a tolerance over both motions."""
        return all(errors.by(self.by) <= tolerance for errors in self.errors)


@quiet()
def reduce_scene(
    scene: UserScene,
    spec: mujoco.MjSpec,
    tolerance: float,
    *,
    keep: Collection[str] = (),
    by: By = "trajectory",
    progress: Progress = no_progress,
) -> Reduction:
    """Return the smallest scene found that satisfies a tolerance.

    Args:
        scene: the full scene with the user's motion, on which candidates are selected.
        spec: specification of its file; not changed.
        tolerance: in [m]; by torque in [N m] or [N].
        keep: names of bodies that must remain.
        by: the measure.
        progress: callback with a description and the completed fraction.

    Raises:
        InputError: if the full scene diverges or has no tracked point.
    """
    first = ReducedSceneEvaluator.from_scene(scene, spec)
    second = replace(first, motion=second_motion(scene))
    if not scene.tracked:
        raise InputError(f"{scene.path} has no tracked point; name a site or a body by --track")
    for evaluator, motion_name in ((first, "its motion"), (second, "a second motion")):
        if evaluator.run.broken:
            raise InputError(
                f"{scene.path} diverges over {motion_name}: {evaluator.run.broken}; repair the scene, or "
                f"shorten the motion"
            )
    if by == "trajectory" and first.displacement_range <= tolerance:
        raise InputError(
            f"the tracked points of {scene.path} move by only {first.displacement_range:.2g} m, less than "
            f"the tolerance {tolerance:.2g} m, so that any scene satisfies it; track a point that moves, "
            "as in --track P,BODY@X,Y,Z"
        )
    search = _Search(first, tolerance, by, progress)
    search.bodies |= {name for name in keep if first.spec.body(name) is not None}
    search.run()
    return search.verified(second)


_Steps = tuple[float, RemovalCandidate, float]
_State = tuple[mujoco.MjSpec, float, tuple[RemovedElement, ...], tuple[_Steps, ...]]


class _Search:
    """The state of a search."""

    def __init__(self, evaluator: ReducedSceneEvaluator, tolerance: float, by: By, progress: Progress):
        self.evaluator, self.tolerance, self.progress = evaluator, tolerance, progress
        self.by: By = by
        self.spec, self.error, self.tried = evaluator.spec, 0.0, 0
        self.left_out: list[RemovedElement] = []
        # time ratio, candidate and error of other steps within the tolerance
        self.steps: list[_Steps] = []
        self.costly, self.fraction = False, SEARCH_FRACTION
        self.bodies = evaluator.tracked_bodies

    def observe(self, spec: mujoco.MjSpec) -> Evidence:
        return observe(spec, self.evaluator.scene(spec), self.bodies, self.tolerance)

    def run(self) -> None:
        """Try candidates without loss of accuracy; then others and longer steps, in the faster order."""
        self.categories(0.0, costly=False)
        before = self.state
        states: list[_State] = []
        for number, steps_first in enumerate((False, True)):
            self.state = before
            if steps_first:
                self.coarser(0.6)
            self.categories(0.2 + 0.4 * number, costly=True)
            if not steps_first:
                self.coarser(0.4)
            states.append(self.state)
        ratios = time_ratios(self.evaluator.full, [self.evaluator.scene(state[0]) for state in states])
        self.state = states[int(np.argmin(ratios))]

    @property
    def state(self) -> "_State":
        """Specification, error, applied candidates, and other steps within the tolerance."""
        return self.spec, self.error, tuple(self.left_out), tuple(self.steps)

    @state.setter
    def state(self, value: "_State") -> None:
        self.spec, self.error, left_out, steps = value
        self.left_out, self.steps = list(left_out), list(steps)

    def categories(self, start: float, *, costly: bool) -> None:
        """Try all categories; with `costly` also candidates that cost accuracy."""
        self.costly = costly
        for number, propose in enumerate(CATEGORIES):
            self.progress(
                propose.__module__.rpartition(".")[2].replace("_", " "),
                start + 0.2 * number / len(CATEGORIES),
            )
            for candidate in propose(self.observe(self.spec)):
                self.together(candidate)

    def together(self, candidate: RemovalCandidate) -> None:
        """Apply a candidate in addition to the others if the tolerance is satisfied and it saves time."""
        tried = self.trial(candidate)
        if tried is None:
            return
        spec, scene, error = tried
        costs = error - self.error > NEGLIGIBLE * self.tolerance
        if costs and not self.costly:
            return
        if candidate.only_if_faster or costs:
            ratio = float(time_ratios(self.evaluator.scene(self.spec), [scene])[0])
            if ratio > MAX_TIME_RATIO:
                return
        self.take(candidate, spec, error)

    def trial(self, candidate: RemovalCandidate) -> tuple[mujoco.MjSpec, UserScene, float] | None:
        """Return the scene with a candidate applied, and its error; None if the error is too large."""
        self.tried += 1
        try:
            spec = with_candidate(self.spec, candidate)
            scene = self.evaluator.scene(spec)
        except (NotApplicable, ValueError):
            return None
        error = self.error_of(scene)
        return (spec, scene, error) if error <= self.fraction * self.tolerance else None

    def take(self, candidate: RemovalCandidate, spec: mujoco.MjSpec, error: float) -> None:
        self.left_out.append(RemovedElement(candidate, error))
        self.spec, self.error = spec, error

    def coarser(self, start: float) -> None:
        """Apply the fastest longer steps within the tolerance; keep others for a failed verification."""
        kept: list[tuple[RemovalCandidate, UserScene, float]] = []
        options = longer_steps(self.observe(self.spec))
        for number, candidate in enumerate(options):
            self.progress(candidate.what, start + 0.2 * number / len(options))
            if (tried := self.trial(candidate)) is not None:
                kept.append((candidate, *tried[1:]))
            if len(kept) == MAX_TIMED:
                break
        ratios = time_ratios(self.evaluator.scene(self.spec), [scene for _, scene, _ in kept]) if kept else []
        steps = [
            (float(ratio), candidate, error)
            for ratio, (candidate, _, error) in zip(ratios, kept, strict=True)
            if ratio < MAX_TIME_RATIO
        ]
        self.steps = sorted(steps, key=lambda step: step[0])
        if self.steps:
            _, candidate, error = self.steps.pop(0)
            self.take(candidate, with_candidate(self.spec, candidate), error)

    def verified(self, second: ReducedSceneEvaluator) -> Reduction:
        """Return the reduced scene; revert candidates until both motions satisfy the tolerance."""
        undone: list[str] = []
        while True:
            text = self.rebuilt_text()
            spec = mujoco.MjSpec.from_string(text)
            errors = [self.errors(evaluator, spec) for evaluator in (self.evaluator, second)]
            if all(removed.by(self.by) <= self.tolerance for removed in errors) or not self.left_out:
                break
            worst = int(np.argmax(np.diff([0.0, *(removed.error for removed in self.left_out)])))
            removed = self.left_out.pop(worst)
            if removed.candidate.category == LONGER_STEPS and self.steps:
                _, candidate, error = self.steps.pop(0)
                self.left_out.insert(worst, RemovedElement(candidate, error))
            elif removed.candidate.category == LONGER_STEPS and self.fraction > MIN_SEARCH_FRACTION:
                # the second motion failed: search shorter steps with a larger reserve
                self.fraction *= 0.5
                self.spec = mujoco.MjSpec.from_string(self.rebuilt_text())
                self.error = self.error_of(self.evaluator.scene(self.spec))
                self.coarser(0.8)
            else:
                undone.append(removed.candidate.what)
        ratio = float(time_ratios(self.evaluator.full, [self.evaluator.scene(spec)], rounds=7)[0])
        full_time = self.evaluator.run.seconds_per_second
        return Reduction(
            text, self.left_out, (errors[0], errors[1]), 1.0 / ratio, full_time, self.tried, undone, self.by
        )

    def rebuilt_text(self) -> str:
        """Return the MJCF of the scene with all candidates applied; drop those that do not apply."""
        spec, kept = self.evaluator.spec, list[RemovedElement]()
        for item in self.left_out:
            try:
                spec = with_candidate(spec, item.candidate)
            except NotApplicable:
                continue
            kept.append(item)
        self.left_out = kept
        return to_xml(spec.copy())

    def error_of(self, scene: UserScene) -> float:
        return self.evaluator.errors(scene, compare_forces=self.by == "torque").by(self.by)

    def errors(self, evaluator: ReducedSceneEvaluator, spec: mujoco.MjSpec) -> SceneErrors:
        try:
            return evaluator.errors(evaluator.scene(spec))
        except ValueError:
            return DIVERGED


def with_comment(reduction: Reduction, name: str, tolerance: float, unit: str) -> str:
    """Return the MJCF of a reduced scene with a leading comment on the removed elements and their cost.

    Args:
        reduction: the reduced scene.
        name: name of the full scene's file.
        tolerance: satisfied tolerance.
        unit: unit of the tolerance.
    """
    first, second = (errors.by(reduction.by) for errors in reduction.errors)
    lines = [
        f"Reduced from {name}: {reduction.speedup:.3g} times as fast.",
        f"After each of its steps within {first:.2g} {unit} of the full scene over the given motion, "
        f"{second:.2g} {unit} over another; the tolerance is {tolerance:.3g} {unit}.",
        f"Over these motions forces differ by up to {max(errors.torque for errors in reduction.errors):.2g} "
        "(N m, N).",
        "Left out one after another, with the error after each:"
        if reduction.left_out
        else "Nothing was left out: no candidate satisfies the tolerance and saves time.",
    ]
    lines += [f"  {item.candidate.what}; {item.error:.2g} {unit}" for item in reduction.left_out]
    lines += [f"Taken back, since the result exceeded the tolerance: {what}" for what in reduction.undone]
    # an XML comment must not contain two consecutive hyphens
    text = "\n".join(f"  {item}" for item in lines).replace("--", "- -")
    return f"<!--\n{text}\n-->\n{reduction.text}"
