"""Candidates tried alone and together: what is left out, judged as a whole over two motions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import mujoco
import numpy as np

from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.reduction import table
from mechsim.studies.reduction.bench import BROKEN, Bench, LeanErrors, time_ratios
from mechsim.studies.reduction.candidate import Candidate, NotThere, changed
from mechsim.studies.reduction.evidence import Evidence, evidence

By = Literal["trajectory", "torque"]
# part of the tolerance that what is left out may cost on the motion that chooses
PART = 0.7
# part of the tolerance that is no error, and how much slower a scene may seem that lacks parts for it
NOTHING, NOISE = 1e-3, 1.05
# part of the time that must be saved where leaving out costs accuracy
WORTH = 0.97

Tell = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class LeftOut:
    """One thing left out.

    Attributes:
        candidate: what it is.
        alone: errors of the full scene without it alone.
        time_ratio: time of the full scene without it alone, in parts of that with it.
        error: of the scene without it and all before it, in the unit of the tolerance.
    """

    candidate: Candidate
    alone: LeanErrors
    time_ratio: float
    error: float


@dataclass(frozen=True)
class Reduction:
    """A scene that lacks what is not needed.

    Attributes:
        spec: of what is left.
        left_out: in order.
        errors: of the whole over the user's motion, and over the second.
        speedup: time of the full scene in parts of that of the whole.
        time: processor time of a simulated second of the full scene, in [s].
        tried: how many candidates.
        undone: things that were left out and came back, for the whole was beyond the tolerance.
    """

    spec: mujoco.MjSpec
    left_out: Sequence[LeftOut]
    errors: tuple[LeanErrors, LeanErrors]
    speedup: float
    time: float
    tried: int
    undone: Sequence[str] = field(default_factory=list[str])


@quiet()
def reduced(
    first: Bench, second: Bench, tolerance: float, by: By = "trajectory", tell: Tell = lambda _, __: None
) -> Reduction:
    """Return the smallest scene found that keeps a tolerance.

    Args:
        first: the full scene over the user's motion, by which is chosen.
        second: the same over another, by which the whole is judged.
        tolerance: in [m], or in [N m] or [N] by torque.
        by: what counts.
        tell: told what is tried and what part is done.
    """
    search = _Search(first, tolerance, by, tell)
    search.go()
    return search.judged(second)


class _Search:
    """The state of a search."""

    def __init__(self, bench: Bench, tolerance: float, by: By, tell: Tell):
        self.bench, self.tolerance, self.by, self.tell = bench, tolerance, by, tell
        self.spec, self.error, self.tried = bench.spec, 0.0, 0
        self.left_out: list[LeftOut] = []
        self.bodies = frozenset(body for body, _ in bench.tracked.values())

    def seen(self, spec: mujoco.MjSpec) -> Evidence:
        return evidence(spec, self.bench.lean(spec), self.bodies, self.tolerance)

    def go(self) -> None:
        """Try all families, then longer steps."""
        for number, propose in enumerate(table.FAMILIES):
            self.tell(propose.__module__.rpartition(".")[2], 0.5 * number / len(table.FAMILIES))
            for candidate in propose(self.seen(self.spec)):
                self.together(candidate)
        self.coarser()

    def together(self, candidate: Candidate) -> None:
        """Leave a candidate out beside what is left out already, if that keeps the tolerance and saves time."""
        self.tried += 1
        try:
            spec = changed(self.spec, candidate)
            scene = self.bench.lean(spec)
        except (NotThere, ValueError):
            return
        error = self.bench.errors(scene, all_of_them=self.by == "torque").by(self.by)
        if not error <= PART * self.tolerance:
            return
        ratio = float(time_ratios(self.bench.lean(self.spec), [scene])[0])
        if ratio > (NOISE if error - self.error <= NOTHING * self.tolerance else WORTH):
            return
        self.take(candidate, spec, error)

    def take(self, candidate: Candidate, spec: mujoco.MjSpec, error: float) -> None:
        alone, ratio = BROKEN, np.nan
        try:
            scene = self.bench.lean(changed(self.bench.spec, candidate))
            alone = self.bench.errors(scene)
            ratio = float(time_ratios(self.bench.full, [scene])[0])
        except (NotThere, ValueError):
            pass
        self.left_out.append(LeftOut(candidate, alone, ratio, error))
        self.spec, self.error = spec, error

    def coarser(self) -> None:
        """Take the longest steps that keep the tolerance."""
        failed, options = 0, table.LAST(self.seen(self.spec))
        best: tuple[float, Candidate, mujoco.MjSpec, float] | None = None
        for number, candidate in enumerate(options):
            self.tell(candidate.what, 0.5 + 0.4 * number / len(options))
            self.tried += 1
            try:
                spec = changed(self.spec, candidate)
                scene = self.bench.lean(spec)
            except (NotThere, ValueError):
                continue
            error = self.bench.errors(scene, all_of_them=self.by == "torque").by(self.by)
            if not error <= PART * self.tolerance:
                continue
            ratio = float(time_ratios(self.bench.lean(self.spec), [scene])[0])
            if best is None or ratio < best[0]:
                best, failed = (ratio, candidate, spec, error), 0
            else:
                failed += 1
            if failed >= 4:
                break
        if best is not None and best[0] < WORTH:
            self.take(*best[1:])

    def judged(self, second: Bench) -> Reduction:
        """Return the whole, things undone until it keeps the tolerance over both motions."""
        undone: list[str] = []
        while True:
            spec = self.again()
            errors = [self.errors(bench, spec) for bench in (self.bench, second)]
            if all(one.by(self.by) <= self.tolerance for one in errors) or not self.left_out:
                break
            steps = np.diff([0.0, *(one.error for one in self.left_out)])
            undone.append(self.left_out.pop(int(np.argmax(steps))).candidate.what)
        self.spec = spec
        ratio = float(time_ratios(self.bench.full, [self.bench.lean(spec)], rounds=7)[0])
        taken = self.bench.run.seconds_per_second
        return Reduction(spec, self.left_out, (errors[0], errors[1]), 1.0 / ratio, taken, self.tried, undone)

    def again(self) -> mujoco.MjSpec:
        """Return the full scene without all that is left out; what does not apply any more comes back."""
        spec, kept = self.bench.spec, list[LeftOut]()
        for one in self.left_out:
            try:
                spec = changed(spec, one.candidate)
            except NotThere:
                continue
            kept.append(one)
        self.left_out = kept
        return spec

    def errors(self, bench: Bench, spec: mujoco.MjSpec) -> LeanErrors:
        try:
            return bench.errors(bench.lean(spec))
        except ValueError:
            return BROKEN
