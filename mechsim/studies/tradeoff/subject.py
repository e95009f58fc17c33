"""Trial runs: one crank motion under many settings, each against a reference, its time measured apart."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from itertools import pairwise
from time import process_time
from typing import Any

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.maths.convergence import believed_order, half_extent, richardson
from mechsim.maths.norms import worst
from mechsim.model.crank_profile import within_range
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.simulation import Settings
from mechsim.simulation.closed_model import Model
from mechsim.studies.tradeoff.built_model import BuiltModel, build_model
from mechsim.studies.tradeoff.pace import BEYOND, Budget, Pace
from mechsim.verdict.quantities import QUANTITIES, motion_scales

# quantities of the table by which trials are measured; the drive beside its profile
COMPARED = ("position", "velocity", "acceleration", "angle", "loop", "drive")
# steps a turn of the runs that make the reference of a model without a closed form, and what they may be
# divided by where that would take more than this part of the budget that is left
FINE, COARSER, REFERENCE_PART = (3600, 7200, 14400), (1, 2, 5, 10, 25, 50), 0.4
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
    stroke = half_extent(drive.positions(angles).values())
    mechanism = drive.mechanism
    reference = Reference(
        "closed form" if isinstance(drive, ClosedForm) else "loop equations",
        lambda motion: drive.solve(motion.angle, motion.speed, motion.acceleration),
    )
    built = build_model(mechanism, profile, speed)
    if budget is not None:
        budget.require(drive.name)
    return Subject(drive.name, mechanism, built, reference, stroke, abs(speed), _variants(drive, angles))


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
    built = build_model(source, None, speed)
    steps = FINE if budget is None else _affordable(built, name, budget)
    runs = [
        motion for count in steps if (motion := built.motion(Settings(steps_per_turn=count))[0]) is not None
    ]
    if len(runs) < len(steps):
        longer = "" if steps == FINE else "; give a longer budget, for finer runs"
        raise InputError(f"{name} diverges at {steps[-1]} steps a turn: no reference run can be made{longer}")
    fine = runs[-1]
    stroke = half_extent(point.position for point in fine.points.values())
    if not stroke > 0.0:
        raise InputError(f"no tracked point of {name} moves; put a named site on a moving body")

    def at(motion: Motion) -> Motion:
        return _every(fine, (len(fine) - 1) // (len(motion) - 1))

    changes = [differences(a, b, stroke, abs(speed)) for a, b in pairwise(runs)]
    bar = {
        kind: _bar(*(change[kind] for change in changes)) for kind in ("position", "velocity", "acceleration")
    }
    # how far its loops stand open says what no halving of the step can
    bar["position"] = max(bar["position"], differences(fine, fine, stroke, abs(speed))["loop"])
    reference = Reference(f"a run of {steps[-1]} steps a turn", at, bar, steps[-1] / 2)
    return Subject(name, source, built, reference, stroke, abs(speed))


def _affordable(built: BuiltModel, name: str, budget: Budget) -> tuple[int, ...]:
    """Return the steps a turn of the finest reference runs that a part of the budget has time for."""
    budget.require(name)
    pace, coarse = Pace(), Settings(steps_per_turn=min(FINE) // max(COARSER))
    for _ in range(2):  # the first run of all pays for what is loaded then
        begun = process_time()
        seconds = built.motion(coarse)[1]
        pace.learn(built.build, coarse, built.profile.turns, seconds, process_time() - begun)
    tried = [tuple(count // part for count in FINE) for part in COARSER]
    needed = [
        sum(pace.trial(built.build, Settings(steps_per_turn=count), built.profile.turns) for count in steps)
        for steps in tried
    ]
    for steps, seconds in zip(tried, needed, strict=True):
        if seconds <= REFERENCE_PART * budget.left:
            return steps
    if needed[-1] <= budget.left + BEYOND * budget.seconds:
        return tried[-1]
    enough = np.ceil(budget.spent + budget.kept + needed[-1] / REFERENCE_PART)
    raise InputError(
        f"{name} took {budget.spent:.2g} s to load, build and try, and the coarsest reference takes "
        f"{needed[-1]:.2g} s more, but the budget is {budget.seconds:g} s; give --budget {enough:g}s or more"
    )


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
