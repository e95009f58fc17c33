"""Subjects of a trade-off: a mechanism with its exact motion, or a custom model with a much finer run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import InputError
from mechsim.model.motion import Motion, select_instants
from mechsim.model.motion_laws import within_range
from mechsim.numerics.arrays import worst
from mechsim.numerics.convergence import half_extent, plausible_order
from mechsim.simulation.settings import Settings
from mechsim.simulation.source import Model
from mechsim.studies.budget import MAX_EXCESS, Budget, TrialTimes
from mechsim.studies.tradeoff.methods import BuiltModel, build_model
from mechsim.verdict.quantities import QUANTITIES, motion_scales

# steps per revolution of the reference runs; divisors of these numbers, used if the runs exceed a fraction of
# the budget; and that fraction
FINE_STEPS, DIVISORS, REFERENCE_FRACTION = (3600, 7200, 14400), (1, 2, 5, 10, 25, 50), 0.4
# fraction of the budget above which the first trial is not repeated; it includes the time of imports
TRIAL_FRACTION = 0.05


def reference_runs(built: BuiltModel, name: str, budget: Budget | None) -> dict[int, Motion]:
    """Return steps per revolution -> motion of the reference runs, in ascending order.

    Args:
        built: the model.
        name: name of the model.
        budget: time of all runs; None for the finest runs.

    Raises:
        InputError: if a run diverges, or the budget is too short for the coarsest runs.
    """
    steps, sufficient = (FINE_STEPS, None) if budget is None else affordable_steps(built, name, budget)
    runs: dict[int, Motion] = {}
    for count in reversed(steps):
        motion, _ = built.motion(Settings(steps_per_turn=count))
        if motion is None:
            raise InputError(_divergence_message(name, count, tuple(runs), sufficient))
        runs[count] = motion
    return dict(reversed(runs.items()))


def affordable_steps(built: BuiltModel, name: str, budget: Budget) -> tuple[tuple[int, ...], float | None]:
    """Return steps per revolution of the finest runs within a fraction of the budget.

    Returns:
        The steps, ascending, and a budget in [s] sufficient for `FINE_STEPS`; None if the steps are those.

    Raises:
        InputError: if the budget is too short for the coarsest runs.
    """
    budget.require(name)
    times, coarse = TrialTimes(budget), Settings(steps_per_turn=min(FINE_STEPS) // max(DIVISORS))
    turns, integrator = built.profile.turns, Settings().integrator
    for _ in range(2):
        processor, remaining = budget.processor(), budget.remaining
        seconds = built.motion(coarse)[1]
        count = turns * coarse.steps_per_turn
        times.add_trial(integrator, count, seconds, budget.processor() - processor)
        budget.require(name)
        if remaining - budget.remaining > TRIAL_FRACTION * budget.seconds:
            break
    options = [tuple(count // divisor for count in FINE_STEPS) for divisor in DIVISORS]
    expected = [sum(times.expected(integrator, turns * count) for count in steps) for steps in options]
    sufficient = float(np.ceil(budget.spent + budget.reserved + expected[0] / REFERENCE_FRACTION))
    for steps, seconds in zip(options, expected, strict=True):
        if seconds <= REFERENCE_FRACTION * budget.remaining:
            return steps, None if steps == FINE_STEPS else sufficient
    if expected[-1] <= budget.remaining + MAX_EXCESS * budget.seconds:
        return options[-1], sufficient
    least = np.ceil(budget.spent + budget.reserved + expected[-1] / REFERENCE_FRACTION)
    raise InputError(
        f"{name} took {budget.spent:.2g} s to load, build and try, and the coarsest reference takes "
        f"{expected[-1]:.2g} s more, but the budget is {budget.seconds:g} s; give --budget {least:g}s or more"
    )


def _divergence_message(name: str, count: int, stable: Sequence[int], sufficient: float | None) -> str:
    """Return a message on a diverged run with remedies: finer runs, if any, or a softer model."""
    message = f"{name} diverges at {count:,} steps a turn with {Settings().integrator}"
    message += f", though not at {stable[-1]:,}" if stable else ""
    remedies = (
        [] if sufficient is None else [f"--budget {sufficient:g}s has time for up to {max(FINE_STEPS):,}"]
    )
    if sufficient is None or not stable:
        remedies.append("less stiffness, or more damping or mass, in the moving bodies")
    return f"{message}, so no reference run is possible; possible remedies: {'; else '.join(remedies)}"


# compared quantities; the drive is compared with its profile
COMPARED = ("position", "velocity", "acceleration", "angle", "loop", "drive")
# ratio of the crank speed to its target above which a run counts as diverged
MAX_SPEED_RATIO = 1e6


@dataclass(frozen=True, slots=True)
class Reference:
    """The exact motion, or a much finer run, with which trials are compared.

    Attributes:
        what: description.
        exact: simulated motion -> true motion at the same instants.
        own_error: error of the reference by quantity, in the units of the errors; empty for a closed form.
        max_steps: largest number of steps per revolution of runs that can be compared with it.
    """

    what: str
    exact: Callable[[Motion], Motion]
    own_error: Mapping[str, float] = field(default_factory=dict)
    max_steps: float = np.inf


@dataclass(frozen=True, slots=True)
class Subject:
    """The mechanism or model on which the trade-off is measured.

    Attributes:
        name: name of the mechanism or file.
        built: its model.
        reference: reference of the trials.
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, in [rad/s].
    """

    name: str
    built: BuiltModel
    reference: Reference
    stroke: float
    speed: float

    def errors(self, motion: Motion | None) -> dict[str, float]:
        """Return the largest errors by quantity.

        Position and loop residual are in strokes, velocity and acceleration in strokes and crank speeds,
        angle and drive in [rad]; all are infinite for a diverged motion. The drive error is the distance of
        the crank from its profile. The other errors are measured at the actual crank angle.
        """
        if motion is None or not worst(motion.speed) <= MAX_SPEED_RATIO * self.speed:
            return dict.fromkeys(COMPARED, np.inf)
        errors = differences(motion, self.reference.exact(motion), self.stroke, self.speed)
        assert motion.time is not None
        return errors | {"drive": worst(motion.angle - self.built.profile.state(motion.time)[0])}


def differences(motion: Motion, exact: Motion, stroke: float, speed: float) -> dict[str, float]:
    """Return the largest differences of two motions at the same instants, as in `Subject.errors`."""
    scales = motion_scales(stroke, speed)
    return {name: QUANTITIES[name].largest(motion, exact, scales) for name in COMPARED[:-1]}


def subject_of(solver: KinematicSolver, speed: float, budget: Budget | None = None) -> Subject:
    """Return a mechanism as a subject, with the closed form or the loop equations as its reference.

    Raises:
        InputError: if the budget ends before the first trial.
    """
    name = solver.name
    profile = within_range(solver.mechanism, solver.crank_range(), speed)
    angles = profile.state(np.linspace(0.0, profile.duration, 361))[0]
    solver = solver.starting_at(angles)
    stroke = half_extent(solver.positions(angles).values())
    reference = Reference(
        solver.method,
        lambda motion: solver.solve(motion.angle, motion.speed, motion.acceleration),
    )
    built = build_model(solver.mechanism, profile, speed, _time_check(budget, name))
    if budget is not None:
        budget.require(name)
    return Subject(name, built, reference, stroke, abs(speed))


def _time_check(budget: Budget | None, name: str) -> Callable[[], None]:
    """Return a function that raises InputError at the end of the budget."""
    return (lambda: None) if budget is None else lambda: budget.require(name)


def subject_of_model(source: Model, name: str, speed: float, budget: Budget | None = None) -> Subject:
    """Return a custom model as a subject; its reference is a much finer run with an estimated error.

    Args:
        source: the model.
        name: name of the model.
        speed: crank speed, in [rad/s].
        budget: time of all runs; a fraction of it limits the reference runs.

    Raises:
        AssemblyError: if the crank cannot make a full revolution.
        InputError: if no reference is possible within the budget.
    """
    built = build_model(source, None, speed, _time_check(budget, name))
    runs = reference_runs(built, name, budget)
    max_steps, fine = list(runs.items())[-1]
    stroke = half_extent(point.position for point in fine.points.values())
    if not stroke > 0.0:
        raise InputError(f"no tracked point of {name} moves; put a named site on a moving body")

    def exact(motion: Motion) -> Motion:
        return select_instants(fine, slice(None, None, (len(fine) - 1) // (len(motion) - 1)))

    before, last = (differences(a, b, stroke, abs(speed)) for a, b in pairwise(runs.values()))
    bar = {
        quantity: last[quantity] / (2.0 ** plausible_order(before[quantity], last[quantity], 2.0) - 1.0)
        for quantity in ("position", "velocity", "acceleration")
    }
    # differences between runs do not contain the loop-closure error
    bar["position"] = max(bar["position"], differences(fine, fine, stroke, abs(speed))["loop"])
    reference = Reference(f"a run of {max_steps} steps a turn", exact, bar, max_steps / 2)
    return Subject(name, built, reference, stroke, abs(speed))
