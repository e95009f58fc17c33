"""One run at an extreme and its outcome; the border between two outcomes; all results of a stress test."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from mechsim.compare.crosscheck import crosscheck
from mechsim.errors import MechsimError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import Outcome
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One run at an extreme.

    Attributes:
        axis: the varied quantity.
        mechanism: name in the catalogue.
        value: value in the unit of the axis.
        outcome: outcome that the simulator reports without the closed form.
        right: outcome of the same run by the closed form.
        expected: outcome that the closed form predicts; None if it cannot.
        error: largest position error relative to the closed form, in characteristic lengths; None without a
            run.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        *("axis", "mechanism", "value", "outcome", "right", "error", "expected", "passed"),
    )

    axis: str
    mechanism: str
    value: float
    outcome: Outcome = "cannot assemble"
    right: Outcome = "cannot assemble"
    expected: Outcome | None = None
    error: float | None = None

    @property
    def passed(self) -> bool:
        """Whether the run has the outcome that the closed form requires, and reports it."""
        return self.outcome == self.right and self.expected in (None, self.outcome)


@dataclass(frozen=True, slots=True, kw_only=True)
class Border:
    """The border between two outcomes along an axis.

    Attributes:
        axis, mechanism: those of the trials.
        inside, outside: neighbouring values after bisection.
        before, after: outcomes at these values.
    """

    axis: str
    mechanism: str
    inside: float
    outside: float
    before: Outcome
    after: Outcome


@dataclass
class StabilityMap:
    """The result of a study.

    Attributes:
        trials: all runs.
        borders: borders between outcomes along an axis.
    """

    JSON: ClassVar[tuple[str, ...]] = ("passed", "borders", "trials")

    trials: list[Trial] = field(default_factory=list[Trial])
    borders: list[Border] = field(default_factory=list[Border])

    @property
    def passed(self) -> bool:
        """Whether every run ended as the closed form requires."""
        return not self.wrong

    @property
    def wrong(self) -> list[Trial]:
        """The runs with another outcome."""
        return [trial for trial in self.trials if not trial.passed]


# largest position error of a tracked point, in characteristic lengths
POSITION_TOLERANCE = 1e-6


def attempt(
    axis: str,
    solver: KinematicSolver,
    value: float,
    source: Any = None,
    *,
    expected: Outcome | None = None,
    **options: Any,
) -> Trial:
    """Run a source in MuJoCo and check the run by the analytic solution.

    Args:
        axis, value, expected: those of the trial.
        solver: the analytic solver.
        source: model for `simulate`; None for the mechanism of the solver.
        options: other arguments of `simulate`; the default method is "step".
    """
    # the help of the command does without MuJoCo
    from mechsim.simulation.run import simulate

    trial = Trial(axis=axis, mechanism=solver.name, value=value, expected=expected)
    try:
        arguments: dict[str, Any] = {"method": "step", **options}
        run = simulate(solver.mechanism if source is None else source, **arguments)
    except MechsimError:
        return replace(trial, right=expected or "cannot assemble")
    right, error = _true_outcome(solver, run.motion)
    precise = run.estimate <= POSITION_TOLERANCE * solver.mechanism.characteristic_length
    outcome = "failed" if run.outcome == "passed" and not precise else run.outcome
    return replace(trial, outcome=outcome, right=right, error=error)


def position_errors(solver: KinematicSolver, motion: Motion) -> Array:
    """Return the largest position error of the tracked points at each record, (n,) in characteristic lengths.

    Raises:
        MechsimError: if the analytic solution has no position at a recorded instant.
    """
    if solver.motion_laws.crank:
        exact = solver.positions(motion.angle)
    else:
        exact = {name: point.position for name, point in solver.solve_as(motion).points.items()}
    errors = [np.linalg.norm(motion.points[name].position - points, axis=1) for name, points in exact.items()]
    return np.max(errors, axis=0) / solver.mechanism.characteristic_length


def _true_outcome(solver: KinematicSolver, motion: Motion) -> tuple[Outcome, float | None]:
    """Return the outcome by the analytic solution, from positions only, and the largest relative error."""
    if motion.broken:
        return "diverged", None
    try:
        error = float(position_errors(solver, motion).max())
    except MechsimError:
        return "failed", None
    if not np.isfinite(error):
        return "diverged", None
    if error <= POSITION_TOLERANCE:
        return "passed", error
    tolerance = POSITION_TOLERANCE * solver.mechanism.characteristic_length
    outcome = crosscheck(motion, solver, tolerance=tolerance).outcome
    return ("changed assembly" if outcome == "changed assembly" else "failed"), error


def borders_along(
    attempted: Callable[[float], Trial], values: Sequence[float], halvings: int
) -> tuple[list[Trial], list[Border]]:
    """Try values along an axis, and locate changes of the outcome by bisection of logarithms."""
    trials = [attempted(value) for value in values]
    borders, refined = list[Border](), list(trials)
    for first, second in pairwise(trials):
        if first.outcome == second.outcome or first.mechanism != second.mechanism:
            continue
        inside, outside = first, second
        for _ in range(halvings if first.value > 0.0 and second.value > 0.0 else 0):
            middle = attempted(float(np.sqrt(inside.value * outside.value)))
            refined.append(middle)
            inside, outside = (middle, outside) if middle.outcome == first.outcome else (inside, middle)
        borders.append(
            Border(
                axis=first.axis,
                mechanism=first.mechanism,
                inside=inside.value,
                outside=outside.value,
                before=inside.outcome,
                after=outside.outcome,
            )
        )
    return sorted(refined, key=lambda trial: trial.value), borders
