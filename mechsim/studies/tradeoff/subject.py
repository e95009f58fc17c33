"""Trial runs: one crank motion under many settings, each against a reference, its time measured apart."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.model.motion_laws import within_range
from mechsim.numerics.arrays import Array, worst
from mechsim.numerics.convergence import believed_order, half_extent, richardson
from mechsim.simulation import Settings
from mechsim.simulation.source import Model
from mechsim.studies.budget import BEYOND, Budget, TrialTimes
from mechsim.studies.tradeoff.models import BuiltModel, build_model
from mechsim.verdict.quantities import QUANTITIES, motion_scales

# steps a turn of the runs, and what they may be divided by where that would take more than this part of the
# budget that is left
FINE, COARSER, REFERENCE_PART = (3600, 7200, 14400), (1, 2, 5, 10, 25, 50), 0.4
# a first trial that takes less of the budget than this is made again, as it paid for what is loaded then
TRIAL_PART = 0.05


@dataclass(frozen=True, slots=True)
class Affordable:
    """What a budget has time for.

    Attributes:
        steps: a turn of the runs, rising; the finest are `FINE`.
        enough: a budget for the finest in [s]; None where these are they.
    """

    steps: Sequence[int] = FINE
    enough: float | None = None


def reference_runs(built: BuiltModel, name: str, budget: Budget | None) -> dict[int, Motion]:
    """Return steps a turn -> motion, rising; the finest is run first, as the others are nothing without it.

    Args:
        built: the model.
        name: what it is called.
        budget: what all may take; None for the finest runs.

    Raises:
        InputError: where a run diverges, or the budget has no time for the coarsest.
    """
    can = Affordable() if budget is None else affordable(built, name, budget)
    runs: dict[int, Motion] = {}
    for count in reversed(can.steps):
        motion, _ = built.motion(Settings(steps_per_turn=count))
        if motion is None:
            raise InputError(_diverging(name, count, tuple(runs), can.enough))
        runs[count] = motion
    return dict(reversed(runs.items()))


def affordable(built: BuiltModel, name: str, budget: Budget) -> Affordable:
    """Return the finest runs that a part of the budget has time for.

    Raises:
        InputError: where it has none for the coarsest.
    """
    budget.require(name)
    pace, coarse = TrialTimes(), Settings(steps_per_turn=min(FINE) // max(COARSER))
    for _ in range(2):
        begun, left = process_time(), budget.remaining
        seconds = built.motion(coarse)[1]
        pace.learn(built.build, coarse, built.profile.turns, seconds, process_time() - begun)
        budget.require(name)
        if left - budget.remaining > TRIAL_PART * budget.seconds:
            break
    tried = [tuple(count // part for count in FINE) for part in COARSER]
    needed = [
        sum(pace.trial(built.build, Settings(steps_per_turn=count), built.profile.turns) for count in steps)
        for steps in tried
    ]
    for steps, seconds in zip(tried, needed, strict=True):
        if seconds <= REFERENCE_PART * budget.remaining:
            return Affordable(steps, None if steps == FINE else _enough(budget, needed[0]))
    if needed[-1] <= budget.remaining + BEYOND * budget.seconds:
        return Affordable(tried[-1], _enough(budget, needed[0]))
    raise InputError(
        f"{name} took {budget.spent:.2g} s to load, build and try, and the coarsest reference takes "
        f"{needed[-1]:.2g} s more, but the budget is {budget.seconds:g} s; "
        f"give --budget {_enough(budget, needed[-1]):g}s or more"
    )


def _enough(budget: Budget, needed: float) -> float:
    """Return a budget in [s], of which runs that need so much time are the part they may be."""
    return float(np.ceil(budget.spent + budget.reserved + needed / REFERENCE_PART))


def _diverging(name: str, count: int, held: Sequence[int], enough: float | None) -> str:
    """Return that a run diverges, and what may help: finer runs, where there are any."""
    said = f"{name} diverges at {count:,} steps a turn with {Settings().integrator}"
    said += f", though not at {held[-1]:,}" if held else ""
    damp = "less stiffness, or more damping or mass, in what moves"
    told = damp if enough is None else f"--budget {enough:g}s has time for up to {max(FINE):,}"
    told += f"; else {damp}" if enough is not None and not held else ""
    return f"{said}, so that no reference run can be made; what may help: {told}"


# quantities of the table by which trials are measured; the drive beside its profile
COMPARED = ("position", "velocity", "acceleration", "angle", "loop", "drive")
# places of a point that differ by less than this part of the mechanism's size are the same
SAME = 1e-9
# a crank this many times faster than it should be has left all sense, though no number is infinite yet
LOST = 1e6


@dataclass(frozen=True, slots=True)
class Reference:
    """What a trial is compared with.

    Attributes:
        what: in words.
        at: simulated motion -> the true one at the same instants.
        bar: its own error by quantity, in the units of the errors; rounding for a closed form.
        most_steps: in a turn, of what it can judge.
    """

    what: str
    at: Callable[[Motion], Motion]
    bar: Mapping[str, float] = field(default_factory=dict)
    most_steps: float = np.inf


@dataclass(frozen=True, slots=True)
class Subject:
    """What the trade-off is measured on.

    Attributes:
        name: of the mechanism or file.
        source: the mechanism, or the model of one's own.
        built: its model, with the loops cut as the generator chooses.
        reference: what the trials are compared with.
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, in [rad/s].
        variants: of the mechanism whose tracked points move the same way, by name.
    """

    name: str
    source: Model
    built: BuiltModel
    reference: Reference
    stroke: float
    speed: float
    variants: Mapping[str, Mechanism] = field(default_factory=dict[str, Mechanism])

    @property
    def mechanism(self) -> Mechanism | None:
        """The mechanism, where its joints are known."""
        return self.source if isinstance(self.source, Mechanism) else None

    def errors(self, motion: Motion | None) -> dict[str, float]:
        """Return worst errors by quantity.

        Position and loop residual are in units of the stroke, velocity and acceleration of stroke and
        crank speed, angle and drive in [rad]; a motion that diverged has infinite ones. All but the
        drive's, which is how far the crank is from where it should be, are at the crank angle reached.
        """
        if motion is None or not worst(motion.speed) <= LOST * self.speed:
            return dict.fromkeys(COMPARED, np.inf)
        found = differences(motion, self.reference.at(motion), self.stroke, self.speed)
        assert motion.time is not None
        return found | {"drive": worst(motion.angle - self.built.profile.state(motion.time)[0])}


def differences(motion: Motion, exact: Motion, stroke: float, speed: float) -> dict[str, float]:
    """Return the worst differences of two motions at the same instants, as in `Subject.errors`."""
    scales = motion_scales(stroke, speed)
    return {name: QUANTITIES[name].largest(motion, exact, scales) for name in COMPARED[:-1]}


def subject_of(drive: Form, speed: float, budget: Budget | None = None) -> Subject:
    """Return a mechanism as a subject: its reference is the closed form, or else the loop equations.

    Raises:
        InputError: where the budget is spent before anything is tried.
    """
    profile = within_range(drive.mechanism, drive.crank_range(), speed)
    angles = profile.state(np.linspace(0.0, profile.duration, 361))[0]
    drive = drive.starting_at(angles)
    stroke = half_extent(drive.positions(angles).values())
    mechanism = drive.mechanism
    reference = Reference(
        "closed form" if isinstance(drive, ClosedForm) else "loop equations",
        lambda motion: drive.solve(motion.angle, motion.speed, motion.acceleration),
    )
    built = build_model(mechanism, profile, speed, going_on=_while_there_is_time(budget, drive.name))
    if budget is not None:
        budget.require(drive.name)
    return Subject(drive.name, mechanism, built, reference, stroke, abs(speed), _variants(drive, angles))


def _while_there_is_time(budget: Budget | None, name: str) -> Callable[[], None]:
    """Return what refuses to go on with a thing that is being built once the budget is spent."""
    return (lambda: None) if budget is None else lambda: budget.require(name)


def _variants(drive: Form, angles: Array) -> dict[str, Mechanism]:
    """Return the variants of a mechanism whose tracked points are at the same places at crank angles."""
    places = drive.positions(angles)
    found: dict[str, Mechanism] = {}
    for name, variant in drive.variants().items():
        others = variant.positions(angles)
        gap = max(worst(others[point] - place) for point, place in places.items())
        if gap <= SAME * drive.mechanism.size:
            found[name] = variant.mechanism
    return found


def subject_of_model(source: Model, name: str, speed: float, budget: Budget | None = None) -> Subject:
    """Return a model of one's own as a subject: its reference is a much finer run, with an error bar.

    Args:
        source: the model.
        name: what it is called.
        speed: of the crank, in [rad/s].
        budget: what all may take; the reference is then as fine as part of it allows.

    Raises:
        AssemblyError: if the crank cannot make a whole turn.
        InputError: where no reference can be made, or not within the budget.
    """
    built = build_model(source, None, speed, going_on=_while_there_is_time(budget, name))
    runs = reference_runs(built, name, budget)
    most, fine = list(runs.items())[-1]
    stroke = half_extent(point.position for point in fine.points.values())
    if not stroke > 0.0:
        raise InputError(f"no tracked point of {name} moves; put a named site on a moving body")

    def at(motion: Motion) -> Motion:
        return _every(fine, (len(fine) - 1) // (len(motion) - 1))

    changes = [differences(a, b, stroke, abs(speed)) for a, b in pairwise(runs.values())]
    bar = {
        kind: _bar(*(change[kind] for change in changes)) for kind in ("position", "velocity", "acceleration")
    }
    # how far its loops stand open says what no halving of the step can
    bar["position"] = max(bar["position"], differences(fine, fine, stroke, abs(speed))["loop"])
    reference = Reference(f"a run of {most} steps a turn", at, bar, most / 2)
    return Subject(name, source, built, reference, stroke, abs(speed))


def _bar(before: float, last: float) -> float:
    """Return the error left after the last halving of the step, from what the two halvings changed."""
    return richardson(np.zeros(1), np.array([last]), 2.0, believed_order(before, last, 2.0))[1]


def _every(motion: Motion, stride: int) -> Motion:
    """Return every so many instants of a motion's points and joints."""

    def part(of: Any) -> Any:
        values = (getattr(of, field.name) for field in fields(of))
        return type(of)(*(one[::stride] if isinstance(one, np.ndarray) else one for one in values))

    return Motion(
        motion.source,
        motion.angle[::stride],
        motion.speed[::stride],
        motion.acceleration[::stride],
        {name: part(point) for name, point in motion.points.items()},
        joints={name: part(joint) for name, joint in motion.joints.items()},
    )
