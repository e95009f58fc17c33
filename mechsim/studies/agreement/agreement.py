"""Compare a model with a formula or a table, and find the cause of a difference."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.compare.checks import Check, Verdict, concluded, first_lines
from mechsim.errors import InputError
from mechsim.files import plain
from mechsim.io.python_object import run_object
from mechsim.io.readers import parametric_model as dimension_family
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import Finding, Outcome
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.masses import LinkMass
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import State
from mechsim.mechanism.quantities import quantity
from mechsim.mechanism.quantity import record_columns
from mechsim.numerics.arrays import Array, number
from mechsim.studies.agreement.candidate import Candidate, QuantityReader, values_of_function
from mechsim.studies.agreement.comparison import candidate_check, formula_tolerance, scales_of
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, evaluation_points
from mechsim.units import si

if TYPE_CHECKING:
    from mechsim.studies.agreement.attribution import AskFunction

Against = str | Path | Callable[..., Any]
SPEED = 20.0 * np.pi


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Result of a comparison of a model with candidate data.

    Attributes:
        solver: the model.
        source: name of the function or file that gave the candidate data.
        outcome: passed or failed.
        checks: one for each quantity.
        findings: causes of the difference, most likely first; empty if every check passes.
        attribution: components of the difference between a stepped run and the candidate data; empty without
            a run.
        evaluation: the instants compared.
        candidates: the candidate values there.
        exact: the exact values there, in the order of the candidates.
    """

    solver: KinematicSolver
    source: str
    outcome: Outcome
    checks: tuple[Check, ...]
    findings: tuple[Finding, ...] = ()
    attribution: Mapping[str, Any] = field(default_factory=dict[str, Any])
    evaluation: EvaluationPoints
    candidates: tuple[Candidate, ...]
    exact: tuple[Array, ...]
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether every quantity is within its tolerance."""
        return self.outcome == "passed"

    @property
    def why(self) -> str:
        """One or two sentences: the largest difference and its cause."""
        if self.passed:
            return f"{self.source} agrees with {self.solver.name} in {len(self.checks)} quantities"
        named = [finding for finding in self.findings if finding.certain] or self.findings[:1]
        return "; ".join([self.reason, *(finding.message for finding in named)])

    @property
    def masses(self) -> tuple[LinkMass, ...]:
        """The masses of the links and their sources, if forces are compared; else empty."""
        loaded = any(candidate.quantity.loaded for candidate in self.candidates)
        return self.evaluation.loaded_model.masses if loaded else ()

    def as_dict(self) -> dict[str, Any]:
        """Return the result in the format of `mechsim validate --json`."""
        verdict = plain(Verdict(self.outcome, self.checks, self.reason))
        return verdict | {"why": self.why} | plain(self.explained)

    @property
    def explained(self) -> dict[str, Any]:
        """The comparison and its findings as plain data."""
        return {
            "against": self.source,
            "findings": self.findings,
            "attribution": dict(self.attribution),
            **({"masses": self.masses} if self.masses else {}),
        }

    def __str__(self) -> str:
        return "\n".join([f"{self.outcome}: {self.why}", *(f"  {check}" for check in self.checks)])

    __repr__ = first_lines


def comparison_inputs(speed: float | str, tolerance: float | str | None) -> tuple[float, float | None]:
    """Return a crank speed in [rad/s] and a tolerance in [m], from numbers or text."""
    crank_speed, limit = si(speed, "rad/s", "the speed"), si(tolerance, "m", "the tolerance")
    if not 0.0 < abs(number(crank_speed)) < np.inf:
        raise InputError(f"the speed is {speed}; give a finite one other than 0, as '600rpm'")
    if limit is not None and not 0.0 < number(limit) < np.inf:
        raise InputError(f"the tolerance is {tolerance}; give a finite length above 0, as '10um'")
    return crank_speed, limit


def compare_model(
    designs: DesignFamily,
    against: Against | None = None,
    *,
    speed: float,
    tolerance: float | None = None,
    stepped: bool = True,
) -> Agreement:
    """Compare a parametric model with a formula or a table, and find the cause of a difference.

    Args:
        designs: the model; its parameters are suspects of a difference.
        against: a function of the drivers' coordinates, FILE.py:FUNC, or FILE.csv; None compares the model's
            own formula with its loop equations. The function is run.
        speed: of a crank, in [rad/s].
        tolerance: on positions, in [m]; other quantities scale with it. None takes 1e-8 of the workspace, and
            rounding for the model's own formula.
        stepped: whether MuJoCo also steps the model, to attribute the error of a run to its sources; of the
            model's own formula, only if it fails.

    Raises:
        InputError: for a model, a function or a table that cannot be used.
        AssemblyError: if the loops do not close.
    """
    exact, model, with_formulas = against is None, designs.make({}), designs
    if against is None:
        against, angles = own_formula(model), evaluation_points(model, speed).angle
        designs = replace(designs, make=lambda values: with_formulas.make(values).by_loop_equations(angles))
    source, evaluation, candidates, ask = _candidates(designs.make({}), against, speed)
    result = agreement(
        evaluation, candidates, source, tolerance, designs, function=ask is not None, exact_formula=exact
    )
    if not stepped or (exact and result.passed):
        return result
    from mechsim.studies.agreement.attribution import attribution_data

    return replace(
        result, attribution=attribution_data(evaluation, candidates, scales_of(evaluation, candidates), ask)
    )


def agreement(
    evaluation: EvaluationPoints,
    candidates: Sequence[Candidate],
    source: str,
    tolerance: float | None = None,
    designs: DesignFamily | None = None,
    *,
    function: bool = True,
    exact_formula: bool = False,
    diagnose: bool = True,
) -> Agreement:
    """Compare candidate data with the exact motion, and find the cause of a difference.

    Args:
        evaluation: the mechanism and the instants.
        candidates: values to compare.
        source: name of the function or file, for messages.
        tolerance: as in `validate`.
        designs: the parametric model of the mechanism; None varies the joint positions instead.
        function: whether the candidates come from a function of the driver coordinates.
        exact_formula: whether the function is exact except for rounding, as the formula of a model's file.
        diagnose: whether to search for the cause of a difference.
    """
    exact = tuple(evaluation.all([candidate.quantity for candidate in candidates]))
    scales = scales_of(evaluation, candidates)
    allowed = tuple(
        formula_tolerance(candidate, scales, tolerance, exact=exact_formula) for candidate in candidates
    )
    checks = tuple(
        candidate_check(candidate, true, evaluation, limit)
        for candidate, true, limit in zip(candidates, exact, allowed, strict=True)
    )
    verdict = concluded(checks)
    findings: tuple[Finding, ...] = ()
    if diagnose and not verdict.passed:
        from mechsim.studies.agreement.diagnosis import diagnosis
        from mechsim.studies.agreement.misfit import Misfit

        among = dimension_family(evaluation.solver) if designs is None else designs
        resolution = tuple(formula_tolerance(candidate, scales, tolerance) for candidate in candidates)
        findings = diagnosis(Misfit(evaluation, tuple(candidates), exact, resolution, among, function))
    return Agreement(
        solver=evaluation.solver,
        source=source,
        outcome=verdict.outcome,
        checks=checks,
        findings=findings,
        evaluation=evaluation,
        candidates=tuple(candidates),
        exact=exact,
        reason=verdict.reason,
    )


def own_formula(solver: KinematicSolver) -> Against:
    """Return the formulas that solve a mechanism as a function of the crank's motion, or FILE.py:FUNC.

    Raises:
        InputError: for a model without a formula.
    """

    def formula(angle: Array, speed: Array, acceleration: Array) -> dict[str, Array]:
        motion = solver.whole_motion(angle, speed, acceleration)
        values = {name: joint.value for name, joint in motion.joints.items()}
        for name, point in motion.points.items():
            values |= {name: point.position, f"{name}.v": point.velocity, f"{name}.a": point.acceleration}
        names = [f"angle:{GROUND},{link}" for link in motion.links if link not in motion.spinning]
        for angle_of_link in (quantity(name, solver.described) for name in names):
            values[angle_of_link.name] = angle_of_link.number(record_columns(motion, [angle_of_link]))
        return values

    if solver.closed_form is None and not solver.formula:
        raise InputError(
            f"no formula to compare {solver.name} with; give a function, FILE.py:FUNC or FILE.csv"
        )
    return solver.formula or formula


def parametric(
    model: Any,
    set: Mapping[str, str | float] | None,
    drive: Mapping[str, str | State] | None,
    duration: str | float | None,
) -> DesignFamily:
    """Return a model with the dimensions that may change; arguments as for `validate`."""
    if not isinstance(model, DesignFamily | KinematicSolver | Mechanism):
        return dimension_family(model, set, drive=drive, duration=duration)
    if set or drive or duration is not None:
        raise InputError("set, drive and duration apply to a name or a file; give them to ms.load")
    return model if isinstance(model, DesignFamily) else dimension_family(model)


def _candidates(
    solver: KinematicSolver, against: Against, speed: float
) -> tuple[str, EvaluationPoints, list[Candidate], AskFunction | None]:
    """Return a formula or a table: its name, evaluation points, values there, and the function to call."""
    if isinstance(against, str | Path) and str(against).lower().endswith(".csv"):
        from mechsim.studies.agreement.candidate_table import points_of_table, read_table, values_of_table

        source, table = str(against), read_table(str(against))
        evaluation, used = points_of_table(solver, table, speed, source)
        values = values_of_table(table, used, QuantityReader(solver.mechanism, source))
        return source, evaluation, values, None
    if isinstance(against, str | Path):
        source, function = str(against), run_object(str(against))
    else:
        source, function = getattr(against, "__name__", "the function"), against
    if not callable(function):
        raise InputError(f"{source} is of type {type(function).__name__}; name a function")
    solver.motion_laws.require_drivers(solver.mechanism)
    evaluation = evaluation_points(solver, speed)
    parameters = {name: row[0] for name, row in solver.parameter_rows.items()}

    def ask(elsewhere: EvaluationPoints) -> list[Candidate]:
        return values_of_function(function, elsewhere, source, parameters)

    return source, evaluation, ask(evaluation), ask
