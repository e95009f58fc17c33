"""Candidates tried alone and together: what is left out, judged as a whole over two motions."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.simulation.mjcf import to_xml
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.reduction import stepping, table
from mechsim.studies.reduction.bench import BROKEN, Bench, LeanErrors, time_ratios
from mechsim.studies.reduction.candidate import Candidate, NotThere, changed
from mechsim.studies.reduction.evidence import Evidence, evidence
from mechsim.studies.reduction.knobs import Knob
from mechsim.studies.reduction.lean_scene import LeanScene
from mechsim.studies.reduction.other_motions import motion_to_fit, second_motion
from mechsim.studies.reduction.refit import refit
from mechsim.studies.reduction.spelled_out import spelled_out
from mechsim.studies.reduction.stepping import LONGER_STEPS
from mechsim.studies.scenes import UserScene

By = Literal["trajectory", "torque"]
# part of the tolerance that what is left out may cost on the motion that chooses
PART = 0.9
# least part of it that longer steps are tried with where those before did not hold
LEAST_PART = 0.2
# part of it that numbers fitted to motions may cost on them: over others they cost up to half as much again
FITTED_PART = 0.5
# part of the tolerance that is no error
NOTHING = 1e-3
# part of the time that must be saved where leaving out costs accuracy
WORTH = 0.97
# longer steps that keep the tolerance and are timed, those that should be cheapest first
ENOUGH = 5

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
        text: of what is left, as MJCF.
        left_out: in order.
        errors: of the whole over the user's motion, and over the second.
        speedup: time of the full scene in parts of that of the whole.
        time: processor time of a simulated second of the full scene, in [s].
        tried: how many candidates.
        undone: things that were left out and came back, for the whole was beyond the tolerance.
        by: what counted.
    """

    text: str
    left_out: Sequence[LeftOut]
    errors: tuple[LeanErrors, LeanErrors]
    speedup: float
    time: float
    tried: int
    undone: Sequence[str]
    by: By

    def kept(self, tolerance: float) -> bool:
        """Say whether the whole keeps a tolerance over both motions."""
        return all(errors.by(self.by) <= tolerance for errors in self.errors)


@quiet()
def reduced(
    scene: UserScene,
    spec: mujoco.MjSpec,
    tolerance: float,
    *,
    keep: Collection[str] = (),
    by: By = "trajectory",
    tell: Tell = lambda _, __: None,
) -> Reduction:
    """Return the smallest scene found that keeps a tolerance.

    Args:
        scene: the full scene and the user's motion, by which is chosen.
        spec: of its file; not changed.
        tolerance: in [m], or in [N m] or [N] by torque.
        keep: names of bodies that stay bodies.
        by: what counts.
        tell: told what is tried and what part is done.

    Raises:
        InputError: for a full scene that diverges or of which nothing is tracked.
    """
    full = spelled_out(spec)
    named = plainly_compiled(full.copy())
    tracked = {name: (named.body(body).name, place) for name, (body, place) in scene.places.items()}
    first, second = (Bench(one, full, tracked) for one in (scene, second_motion(scene)))
    if not tracked:
        raise InputError(f"nothing of {scene.path} is tracked; name a site or a body by --track")
    for bench, which in ((first, "its motion"), (second, "a second motion")):
        if bench.run.broken:
            raise InputError(
                f"{scene.path} diverges over {which}: {bench.run.broken}; mend the scene, or ask for less"
            )
    if by == "trajectory" and first.moved <= tolerance:
        raise InputError(
            f"what is tracked of {scene.path} moves by {first.moved:.2g} m and the tolerance is "
            f"{tolerance:.2g} m: nothing at all would keep it; track a point that moves, as "
            "--track P,BODY@x,y,z does"
        )
    search = _Search(first, tolerance, by, tell)
    search.bodies |= {name for name in keep if full.body(name) is not None}
    search.go()
    return search.judged(second)


_Steps = tuple[float, Candidate, float]
_Kept = tuple[Candidate, LeanScene, float]
_State = tuple[mujoco.MjSpec, float, tuple[LeftOut, ...], tuple[_Steps, ...]]


class _Search:
    """The state of a search."""

    def __init__(self, bench: Bench, tolerance: float, by: By, tell: Tell):
        self.bench, self.tolerance, self.tell = bench, tolerance, tell
        self.by: By = by
        self.spec, self.error, self.tried = bench.spec, 0.0, 0
        self.left_out: list[LeftOut] = []
        # ratio of time, steps, error: of steps that keep the tolerance too
        self.steps: list[_Steps] = []
        self.costly, self.part = False, PART
        self.bodies = frozenset(body for body, _ in bench.tracked.values())

    def seen(self, spec: mujoco.MjSpec) -> Evidence:
        return evidence(spec, self.bench.lean(spec), self.bodies, self.tolerance)

    def go(self) -> None:
        """Try what costs nothing, then what costs accuracy and longer steps, in the better order."""
        self.families(0.0, costly=False)
        before = self.state
        found: list[_State] = []
        for number, steps_first in enumerate((False, True)):
            self.state = before
            if steps_first:
                self.coarser(0.6)
            self.families(0.2 + 0.4 * number, costly=True)
            if not steps_first:
                self.coarser(0.4)
            found.append(self.state)
        ratios = time_ratios(self.bench.full, [self.bench.lean(one[0]) for one in found])
        self.state = found[int(np.argmin(ratios))]
        if self.by == "trajectory":
            self.refitted(0.9)

    @property
    def state(self) -> "_State":
        """What is left, its error, what is left out, and steps that keep the tolerance too."""
        return self.spec, self.error, tuple(self.left_out), tuple(self.steps)

    @state.setter
    def state(self, value: "_State") -> None:
        self.spec, self.error, left_out, steps = value
        self.left_out, self.steps = list(left_out), list(steps)

    def families(self, begun: float, *, costly: bool) -> None:
        """Try all families, those that cost nothing alone or all."""
        self.costly = costly
        for number, propose in enumerate(table.FAMILIES):
            self.tell(
                propose.__module__.rpartition(".")[2].replace("_", " "),
                begun + 0.2 * number / len(table.FAMILIES),
            )
            for candidate in propose(self.seen(self.spec)):
                self.together(candidate)

    def together(self, candidate: Candidate) -> None:
        """Leave a candidate out beside all that is, if that keeps the tolerance and saves time."""
        tried = self.trial(candidate)
        if tried is None:
            return
        spec, scene, error = tried
        costs = error - self.error > NOTHING * self.tolerance
        if costs and not self.costly:
            return
        if candidate.pays or costs:
            ratio = float(time_ratios(self.bench.lean(self.spec), [scene])[0])
            if ratio > WORTH:
                return
        self.take(candidate, spec, error)

    def trial(self, candidate: Candidate) -> tuple[mujoco.MjSpec, LeanScene, float] | None:
        """Return what is left without a candidate too, and its error; None where that is too large."""
        self.tried += 1
        try:
            spec = changed(self.spec, candidate)
            scene = self.bench.lean(spec)
        except (NotThere, ValueError):
            return None
        error = self.error_of(scene)
        return (spec, scene, error) if error <= self.part * self.tolerance else None

    def take(self, candidate: Candidate, spec: mujoco.MjSpec, error: float) -> None:
        self.left_out.append(LeftOut(candidate, BROKEN, np.nan, error))
        self.spec, self.error = spec, error

    def coarser(self, begun: float) -> None:
        """Take the longest steps that keep the tolerance; know the next ones, should these not hold."""
        kept: list[_Kept] = []
        options = table.LAST(self.seen(self.spec))
        for number, candidate in enumerate(options):
            self.tell(candidate.what, begun + 0.2 * number / len(options))
            if (tried := self.trial(candidate)) is not None:
                kept.append((candidate, *tried[1:]))
            if len(kept) == ENOUGH:
                break
        self.steps = self.timed(kept)
        self.next_steps()

    def timed(self, kept: "Sequence[_Kept]") -> "list[_Steps]":
        """Return steps that keep the tolerance and save time, the cheapest first."""
        ratios = time_ratios(self.bench.lean(self.spec), [scene for _, scene, _ in kept]) if kept else []
        pairs = zip(ratios, kept, strict=True)
        found = [(float(ratio), candidate, error) for ratio, (candidate, _, error) in pairs if ratio < WORTH]
        return sorted(found, key=lambda one: one[0])

    def refitted(self, begun: float) -> None:
        """Fit what acts to steps longer than those taken, longer and longer while the tolerance is kept."""
        before, taken = self.state, [one for one in self.left_out if one.candidate.family == LONGER_STEPS]
        self.left_out = [one for one in self.left_out if one not in taken]
        longest = float(self.spec.option.timestep)
        self.rebuilt()
        kept = self.fitted_steps(longest, begun)
        if not kept:
            self.state = before
            return
        for one in taken:
            if (tried := self.trial(one.candidate)) is not None:
                kept.append((one.candidate, *tried[1:]))
        self.steps = self.timed(kept)
        self.next_steps()

    def fitted_steps(self, longest: float, begun: float) -> "list[_Kept]":
        """Return steps as long as some or longer that keep the tolerance with what acts fitted to them.

        Each begins where the last ended: from nothing few long ones are found.
        """
        bench, kept = self.bench, list[_Kept]()
        to_fit = Bench(motion_to_fit(bench.motion), bench.spec, bench.tracked)
        seen, stand = self.seen(self.spec), dict[Knob, float]()
        step = float(self.spec.option.timestep)
        for times in (times for times in stepping.LONGER if times > 1 and times * step >= longest):
            self.tell(f"{step * times:g} s, what acts fitted", begun)
            found = None if to_fit.run.broken else refit((bench, to_fit), seen, times, stand)
            tried = None if found is None else self.trial(found.candidate)
            held = found is not None and found.error <= FITTED_PART * self.tolerance
            if found is None or not (held or times * step <= longest):
                break
            if held and tried is not None:
                kept.append((found.candidate, *tried[1:]))
            stand = found.stand
        return kept

    def rebuilt(self) -> None:
        """Leave out again all that is left out, and see what it costs."""
        self.spec = mujoco.MjSpec.from_string(self.again())
        self.error = self.error_of(self.bench.lean(self.spec))

    def next_steps(self) -> None:
        """Take the best steps not taken yet, if there are any."""
        if self.steps:
            _, candidate, error = self.steps.pop(0)
            self.take(candidate, changed(self.spec, candidate), error)

    def judged(self, second: Bench) -> Reduction:
        """Return the whole, things undone until it keeps the tolerance over both motions."""
        undone: list[str] = []
        while True:
            text = self.again()
            spec = mujoco.MjSpec.from_string(text)
            errors = [self.errors(bench, spec) for bench in (self.bench, second)]
            if all(one.by(self.by) <= self.tolerance for one in errors) or not self.left_out:
                break
            gone = int(np.argmax(np.diff([0.0, *(one.error for one in self.left_out)])))
            one = self.left_out.pop(gone)
            if one.candidate.family == LONGER_STEPS and self.steps:
                _, candidate, error = self.steps.pop(0)
                self.left_out.insert(gone, LeftOut(candidate, BROKEN, np.nan, error))
            elif one.candidate.family == LONGER_STEPS and self.part > LEAST_PART:
                # what just held over one motion did not over the other: more room, and shorter steps
                self.part *= 0.5
                self.rebuilt()
                self.coarser(0.8)
            else:
                undone.append(one.candidate.what)
        ratio = float(time_ratios(self.bench.full, [self.bench.lean(spec)], rounds=7)[0])
        taken = self.bench.run.seconds_per_second
        told = self.alone()
        return Reduction(text, told, (errors[0], errors[1]), 1.0 / ratio, taken, self.tried, undone, self.by)

    def alone(self) -> list[LeftOut]:
        """Return what is left out, each thing judged and timed alone where it applies alone."""
        scenes: dict[int, LeanScene] = {}
        for number, one in enumerate(self.left_out):
            try:
                scenes[number] = self.bench.lean(changed(self.bench.spec, one.candidate))
            except (NotThere, ValueError):
                continue
        ratios = time_ratios(self.bench.full, [*scenes.values()]) if scenes else []
        found = list(self.left_out)
        for (number, scene), ratio in zip(scenes.items(), ratios, strict=True):
            errors = self.bench.errors(scene)
            found[number] = replace(found[number], alone=errors, time_ratio=float(ratio))
        return found

    def again(self) -> str:
        """Return the text of the scene without all that is left out; what does not apply comes back."""
        spec, kept = self.bench.spec, list[LeftOut]()
        for one in self.left_out:
            try:
                spec = changed(spec, one.candidate)
            except NotThere:
                continue
            kept.append(one)
        self.left_out = kept
        return to_xml(spec.copy())

    def error_of(self, scene: LeanScene) -> float:
        return self.bench.errors(scene, all_of_them=self.by == "torque").by(self.by)

    def errors(self, bench: Bench, spec: mujoco.MjSpec) -> LeanErrors:
        try:
            return bench.errors(bench.lean(spec))
        except ValueError:
            return BROKEN
