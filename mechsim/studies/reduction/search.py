"""Reduce a model to the smallest scene within a tolerance for its tracked points, written as MJCF.

Candidates are applied one by one; a second motion verifies the result.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal, cast, get_args

import mujoco
import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation.mjcf.compiling import quiet, to_xml
from mechsim.studies.reduction.candidates import CATEGORIES
from mechsim.studies.reduction.candidates.elements import NotApplicable, RemovalCandidate, with_candidate
from mechsim.studies.reduction.reduced_scene import (
    ReducedSceneEvaluator,
    observe,
    other_motion,
    time_ratio,
)
from mechsim.studies.scene.errors import DIVERGED, UNITS, SceneErrors, tolerance_in_si
from mechsim.studies.scene.scene import UserScene, open_scene, scene_file, spec_of
from mechsim.units import Unit

By = Literal["trajectory", "torque"]
# fraction of the tolerance available to the reduced scene on the user's motion
SEARCH_FRACTION = 0.9
# error relative to the tolerance below which a candidate costs no accuracy
NEGLIGIBLE = 1e-3
# largest ratio of times at which a candidate that costs accuracy is accepted
MAX_TIME_RATIO = 0.97
# range of the second motion, which only the final check uses, relative to that of the user's motion, and
# relative variation of its speed
RANGE_RATIO, SPEED_VARIATION = 0.9, 0.3


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
    second = replace(first, motion=other_motion(scene, RANGE_RATIO, SPEED_VARIATION))
    if not scene.tracked:
        raise InputError(f"{scene.path} has no tracked point; name a site or a body by --track")
    for evaluator, motion_name in ((first, "its motion"), (second, "a second motion")):
        if evaluator.run.broken:
            raise InputError(
                f"{scene.path} diverges over {motion_name}: {evaluator.run.broken}; repair the scene, or "
                f"shorten the motion"
            )
    moved = first.run.displacement_range
    if by == "trajectory" and moved <= tolerance:
        raise InputError(
            f"the tracked points of {scene.path} move by only {moved:.2g} m, less than the "
            f"tolerance {tolerance:.2g} m, so that any scene satisfies it; track a point that moves, "
            "as in --track P,BODY@X,Y,Z"
        )
    search = _Search(first, tolerance, by)
    kept = {name for name in keep if first.spec.body(name) is not None}
    search.run(frozenset(kept.union(body for body, _ in first.tracked.values())), progress)
    return search.verified(second)


class _Search:
    """The state of a search."""

    def __init__(self, evaluator: ReducedSceneEvaluator, tolerance: float, by: By):
        self.evaluator, self.tolerance = evaluator, tolerance
        self.by: By = by
        self.spec, self.error, self.tried = evaluator.spec, 0.0, 0
        self.left_out: list[RemovedElement] = []

    def run(self, tracked: frozenset[str], progress: Progress) -> None:
        """Try the candidates of all categories without loss of accuracy, then those that cost accuracy."""
        for half, costly in ((0.0, False), (0.5, True)):
            for number, propose in enumerate(CATEGORIES):
                progress(propose.__name__.replace("_", " "), half + 0.5 * number / len(CATEGORIES))
                scene = self.evaluator.scene(self.spec)
                for candidate in propose(observe(self.spec, scene, tracked, self.tolerance)):
                    self.attempt(candidate, costly)

    def attempt(self, candidate: RemovalCandidate, costly: bool) -> None:
        """Apply a candidate in addition to the others if the tolerance is satisfied and it saves time."""
        self.tried += 1
        try:
            spec = with_candidate(self.spec, candidate)
            scene = self.evaluator.scene(spec)
        except (NotApplicable, ValueError):
            return
        error = self.evaluator.errors(scene, compare_forces=self.by == "torque").by(self.by)
        if not error <= SEARCH_FRACTION * self.tolerance:
            return
        costs = error - self.error > NEGLIGIBLE * self.tolerance
        if costs and not costly:
            return
        must_save_time = candidate.only_if_faster or costs
        if must_save_time and time_ratio(self.evaluator.scene(self.spec), scene) > MAX_TIME_RATIO:
            return
        self.left_out.append(RemovedElement(candidate, error))
        self.spec, self.error = spec, error

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
            undone.append(self.left_out.pop(worst).candidate.what)
        ratio = time_ratio(self.evaluator.full, self.evaluator.scene(spec), rounds=7)
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


@dataclass(frozen=True)
class ReducedModel:
    """A reduced model.

    Attributes:
        reduction: removed elements, with errors and cost.
        tolerance: in SI.
        text: reduced MJCF file.
        notes: changes made to read the file.
    """

    reduction: Reduction
    tolerance: float
    text: str
    notes: tuple[str, ...]

    @property
    def unit(self) -> Unit:
        """Unit of the tolerance."""
        return UNITS[self.reduction.by]

    @property
    def reached(self) -> bool:
        """Whether the reduced model satisfies the tolerance over both motions."""
        return self.reduction.kept(self.tolerance)

    def __str__(self) -> str:
        worst = max(errors.by(self.reduction.by) for errors in self.reduction.errors)
        return f"{self.reduction.speedup:.3g} times as fast, error {worst:.2g} {self.unit}"

    __repr__ = __str__

    def as_dict(self) -> dict[str, Any]:
        """Return the output of `mechsim reduce --json` without the path of the file."""
        result = self.reduction
        first, second = result.errors
        return {
            **files.attributes(result, "speedup", "tried", "undone", "by"),
            "left_out": [
                files.attributes(item.candidate, "what", "category") | {"error": item.error}
                for item in result.left_out
            ],
            "error": max(first.by(result.by), second.by(result.by)),
            "motion": first,
            "second_motion": second,
            "ms_per_s": {"full": 1e3 * result.time, "reduced": 1e3 * result.time / result.speedup},
            **files.attributes(self, "tolerance", "unit"),
        }


def reduce(
    model: Any,
    tolerance: float | str,
    *,
    by: str = "trajectory",
    ctrl: Mapping[str, str | float] | None = None,
    track: Iterable[str] = (),
    output: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
    **options: Any,
) -> ReducedModel:
    """Return the smallest scene that satisfies a tolerance for the tracked points.

    Args:
        model: an MJCF file, or any input of `load`, which is then written as MJCF.
        tolerance: in [m] or text, such as "10um"; by torque in [N m].
        by: "trajectory" (of tracked points) or "torque".
        ctrl: actuator -> its control, as for `tune`.
        track: bodies, sites, "P,Q" for two of them, or "P,BODY@x,y,z" for a new point; by default all.
        output: path of the reduced MJCF file; None writes none.
        progress: callback with a description and the completed fraction.
        options: `drive`, `lock`, `lock_others`, `fix_base`, `key` and `duration`, as for `load`.

    Raises:
        InputError: for an invalid model, motion or tolerance.
        AssemblyError: for loops that do not close.

    Example:
        >>> small = ms.reduce("gripper.xml", "10um", track=["fingertip"], output="small.xml")
        >>> small.reduction.speedup, [element.candidate.what for element in small.reduction.left_out]
    """
    limit = tolerance_in_si(tolerance, by, get_args(By))
    # "P,Q" names two points, "P,BODY@x,y,z" one
    points = [name for text in track for name in ([text] if "@" in text else text.split(","))]
    with scene_file(model) as path:
        scene, notes = open_scene(path, ctrl=ctrl, track=points, **options)
        keep = {name for text in points for name in text.partition("@")[0].split(",")} | set(scene.tracked)
        result = reduce_scene(scene, spec_of(scene), limit, keep=keep, by=cast(By, by), progress=progress)
        text = with_comment(result, Path(path).name, limit, UNITS[by])
    if output is not None:
        files.write_content(Path(fspath(output)), text)
    return ReducedModel(result, limit, text, notes)
