"""Validation of a mechanism: its motions by all methods, compared."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, overload

import numpy as np

from mechsim.compare.checks import (
    Check,
    Verdict,
    check_of,
    combined,
    concluded,
    first_lines,
)
from mechsim.compare.crosscheck import crosscheck
from mechsim.compare.quantities import stroke_of
from mechsim.compare.tolerances import RecordInstants, Tolerance
from mechsim.errors import AssemblyError, BudgetError
from mechsim.files import plain
from mechsim.io.formula_file import with_formulas
from mechsim.io.readers import parametric_model as dimension_family
from mechsim.io.scene_findings import scene_findings
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import Finding, Outcome, by_severity, counted_findings, most_severe
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import CrankProfile, State, interval_around, swing
from mechsim.numerics.arrays import REVOLUTION
from mechsim.numerics.resources import ProcessorBudget, Progress, no_progress
from mechsim.simulation.run import Run
from mechsim.simulation.settings import Settings
from mechsim.simulation.stepping import NotSteppedError
from mechsim.studies.agreement.agreement import (
    SPEED,
    Against,
    Agreement,
    compare_model,
    comparison_inputs,
    parametric,
)
from mechsim.studies.motions import profile_of, simulated

if TYPE_CHECKING:
    from mechsim.studies.scene.published_run import PublishedRun

# Tolerance on positions of a stepped run, relative to the stroke: with 1,000 steps per revolution every
# catalogue mechanism satisfies it (largest error measured: 2.6e-9), and a link 0.1 % long exceeds it 1e5
# times. A run that diverges, or exceeds it by its own estimate near a dead centre, is repeated with as many
# steps as it needs.
RELATIVE_TOLERANCE = 1e-8
# Mechanisms larger than their stroke have a tolerance relative to their size, as loop-closure errors are:
# files give lengths to about 1e-7 of it, and the finest grade of ISO 286 (IT01) allows 1 um of 100 mm, 1e-5.
# It is at most 1e-4 of the stroke, a tenth of the effect of a link 0.1 % long on displacements.
MAX_SIZE_TO_STROKE = 1e4
STEPS = 1000
# Tolerance on a file's own settings, relative to the mechanism's size: the effect of a link 0.1 % long.
OWN_TOLERANCE = 1e-3
# processor time in [s] for the stepped runs of one mechanism
BUDGET = 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation:
    """The validation of one model by every method; print it to see the checks.

    Attributes:
        solver: the model.
        verdict: of all methods and variants.
        exact: motion by the loop equations at instants spread evenly over the range.
        poses: MuJoCo's configurations, solved one by one.
        run: MuJoCo's run in time; that of solved configurations if none was stepped.
        seconds: duration of the validation in [s].
        quick: True if no run was stepped.
        formula: comparison with the model's own formula; None without a formula.
        published: run of an MJCF file with its own settings; None for other models, or if none was stepped.
        file_findings: findings in an MJCF file, the most severe first; None for other models.
    """

    solver: KinematicSolver
    verdict: Verdict
    exact: Motion
    poses: Run
    run: Run
    seconds: float
    quick: bool = False
    formula: Agreement | None = None
    published: PublishedRun | None = None
    file_findings: tuple[Finding, ...] | None = None

    @property
    def passed(self) -> bool:
        """Whether every quantity of every method is within its tolerance."""
        return self.verdict.passed

    @property
    def outcome(self) -> Outcome:
        """The worst outcome of all methods."""
        return self.verdict.outcome

    @property
    def checks(self) -> tuple[Check, ...]:
        """Checks of all methods and variants."""
        return self.verdict.checks

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings in an MJCF file, then causes of a difference from its formula, most likely first."""
        causes = () if self.formula is None else self.formula.findings
        return (*(self.file_findings or ()), *causes)

    @property
    def warnings(self) -> int:
        """Number of findings in the file that are errors or warnings."""
        return sum(finding.severity != "note" for finding in self.file_findings or ())

    @property
    def why(self) -> str:
        """What was compared, or the largest error and its likely cause."""
        if self.passed:
            return f"{self.solver.name} passes {len(self.checks)} checks{counted_findings(self.warnings)}"
        causes = [] if self.formula is None else [finding.message for finding in self.formula.findings[:1]]
        return "; ".join([self.verdict.reason, *causes])

    def __str__(self) -> str:
        return "\n".join([f"{self.outcome}: {self.why}", *(f"  {check}" for check in self.checks)])

    __repr__ = first_lines

    @property
    def compliance(self) -> float | None:
        """Compliance scale of the constraints in the stepped run."""
        return None if self.run.settings is None else self.run.settings.compliance

    def as_dict(self) -> dict[str, Any]:
        """Return the case in the format of `mechsim validate --json`."""
        cost = {"steps": 0 if self.quick else self.run.steps, "seconds": self.seconds}
        compliance = {} if self.compliance is None else {"compliance": self.compliance}
        published = {} if self.published is None else {"published": self.published}
        explained = {} if self.formula is None else self.formula.explained
        findings = {"findings": self.findings}
        return plain(plain(self.verdict) | cost | compliance | explained | published | findings)


@dataclass(frozen=True, slots=True)
class _Work:
    """Options of a validation, and its budget."""

    quick: bool
    tolerance: float | None
    budget: ProcessorBudget
    progress: Progress


def case_of(
    model: KinematicSolver | DesignFamily,
    *,
    speed: float = 20.0 * np.pi,
    quick: bool = False,
    tolerance: float | None = None,
    budget: float = BUDGET,
    progress: Progress = no_progress,
) -> Validation:
    """Validate one mechanism: formula, solved poses and a stepped run against the loop equations.

    The formula of a file is run. Without a formula, loop equations and MuJoCo are compared.

    Args:
        model: the mechanism; a parametric model allows the cause of a formula's error to be determined.
        speed: crank speed in [rad/s]; for a crank that cannot turn fully the largest speed of its swing.
        quick: leave out the stepped run.
        tolerance: on positions of stepped runs in [m]; an MJCF file's own settings must satisfy it too. None
            takes 1e-8 of the stroke or the size, rounding for the formula of the file, and 1e-3 of the size
            for the file's own settings.
        budget: processor time in [s] for stepped runs. If they do not converge within it, the verdict is
            "failed", and its reason states the budget and the error reached.
        progress: called with a text and the finished fraction, 0 until the end.

    Raises:
        AssemblyError: if the loops close nowhere.
        InputError: for a formula that cannot be used.
    """
    designs = model if isinstance(model, DesignFamily) else dimension_family(model)
    solver = designs.make({})
    solver.motion_laws.require_drivers(solver.mechanism)
    work = _Work(quick, tolerance, ProcessorBudget(budget), progress)
    case = _validated(solver, designs, speed, work)
    for name, variant in solver.variants().items():
        # a variant that cannot be assembled is skipped
        with suppress(AssemblyError):
            added = _validated(variant, dimension_family(variant), speed, work)
            own, other = case.verdict, added.verdict
            checks = own.checks + tuple(replace(check, variant=name) for check in other.checks)
            verdict = replace(own, checks=checks)
            if most_severe([own.outcome, other.outcome]) == 1:
                verdict = Verdict(other.outcome, checks, f"{name}, {other.reason}")
            case = replace(case, verdict=verdict, seconds=case.seconds + added.seconds)
    return case


def _validated(solver: KinematicSolver, designs: DesignFamily, speed: float, work: _Work) -> Validation:
    begin, quick, tolerance, progress = perf_counter(), work.quick, work.tolerance, work.progress
    profile = profile_of(solver, speed, solver.period / REVOLUTION)
    solver = solver.starting_at(profile.angles)
    speed = solver.motion_laws.path_speed(speed)
    angles = profile.state(np.linspace(0.0, profile.duration, 73))[0]
    loops = solver.by_loop_equations(angles)
    exact = loops.solve_along(angles, speed)
    verdicts: dict[str, Verdict] = {}
    formula = None
    if solver.has_formula:
        formula = compare_model(designs, speed=speed, tolerance=tolerance, stepped=not quick)
        verdicts["formula"] = Verdict(formula.outcome, formula.checks, formula.reason)
    # the drive error is meaningful only at constant crank speed
    crank_speed = speed if profile.steady and solver.motion_laws.crank else None
    published, findings = None, scene_findings(solver)
    progress("poses", 0.0)
    poses = run = simulated(solver, profile, method="pose", progress=lambda text, _: progress(text, 0.0))
    verdicts["pose"] = crosscheck(poses.motion, loops, speed=crank_speed, assemblies=solver)
    if not quick:
        position = position_tolerance(exact, solver.mechanism, tolerance)
        try:
            run, verdicts["step"] = _stepped(solver, profile, speed, position, work)
        except NotSteppedError as error:
            run = replace(run, note=f"not stepped: {error}")
        except BudgetError as error:
            verdicts["step"] = Verdict("failed", (), str(error))
        if solver.source is not None:
            from mechsim.studies.scene.own_settings import published_run

            published, length = published_run(solver, profile), solver.mechanism.characteristic_length
            reason = f"{OWN_TOLERANCE:.0e} of the mechanism's size of {length:.4g} m"
            own = Tolerance(OWN_TOLERANCE * length, "m", reason)
            own = own if tolerance is None else Tolerance(tolerance, "m", "requested")
            findings = by_severity(*(findings or ()), published.finding(own.value))
            if published.run or tolerance is not None:
                verdicts["as published"] = _of_published(published, own)
    return Validation(
        solver=solver,
        verdict=combined(verdicts),
        exact=exact,
        poses=poses,
        run=run,
        seconds=perf_counter() - begin,
        quick=quick,
        formula=formula,
        published=published,
        file_findings=findings,
    )


def position_tolerance(exact: Motion, mechanism: Mechanism, tolerance: float | None = None) -> Tolerance:
    """Return the tolerance on positions of a stepped run: the requested one, or 1e-8 of stroke or size."""
    if tolerance is not None:
        return Tolerance(tolerance, "m", "requested")
    stroke, extent = stroke_of(exact), mechanism.characteristic_length
    relative, length, what = RELATIVE_TOLERANCE, stroke, "stroke"
    if extent > MAX_SIZE_TO_STROKE * stroke:
        relative *= MAX_SIZE_TO_STROKE
    elif extent > stroke:
        length, what = extent, "mechanism's size"
    return Tolerance(relative * length, "m", f"{relative:.0e} of the {what} of {length:.4g} m")


def _of_published(published: PublishedRun, allowed: Tolerance) -> Verdict:
    """Return the verdict on a file's own settings; the reason of a failure begins with the remedy."""
    finding = published.finding(allowed.value)
    remedied = ": ".join(filter(None, [finding.remedy, finding.message]))
    if not published.run:
        return Verdict("failed", (), f"not run: {published.note}")
    if published.note:
        return Verdict("diverged", (), remedied)
    allowed = replace(allowed, reason=f"{allowed.reason}; the file's own settings: {published.label}")
    compared = {("loop residual", ""): published.gaps, ("position", "all points"): published.errors}
    verdict = concluded(
        check_of(kind, subject, error, RecordInstants(published.instants, published.instants_unit), allowed)
        for (kind, subject), error in compared.items()
    )
    return verdict if verdict.passed else replace(verdict, reason=remedied)


def _stepped(
    solver: KinematicSolver, profile: CrankProfile, speed: float, allowed: Tolerance, work: _Work
) -> tuple[Run, Verdict]:
    """Return a run in time with mechsim's settings, and its verdict by the loop equations."""
    limit, loops = allowed.value, solver.by_loop_equations(profile.angles)
    follows_laws = not solver.motion_laws.crank
    stepped = profile if follows_laws else _between_change_points(solver, profile, speed)
    runs = 0

    def counted_progress(text: str, fraction: float) -> None:
        nonlocal runs
        runs += fraction == 1.0
        work.progress(f"stepped run {runs + (fraction < 1.0)}: {text}", 0.0)

    with_budget: dict[str, Any] = {"budget": work.budget, "progress": counted_progress}
    run = simulated(solver, stepped, settings=Settings(steps_per_turn=STEPS), **with_budget)
    # the error estimate of a diverged run is infinite
    if not run.estimate <= limit:
        run = simulated(solver, stepped, tolerance=limit, **with_budget)
    crank_speed, bounds = speed if stepped.steady and not follows_laws else None, {"position": allowed}
    verdict = crosscheck(
        run.motion, loops, tolerance=limit, speed=crank_speed, bounds=bounds, assemblies=solver
    )
    if run.outcome == "diverged":
        verdict = Verdict("diverged", (), "MuJoCo's state became invalid")
    elif not verdict.passed and run.shortfall:
        verdict = replace(verdict, reason=f"{verdict.reason}; {run.shortfall}")
    return run, verdict


def _between_change_points(solver: KinematicSolver, profile: CrankProfile, speed: float) -> CrankProfile:
    """Return a swing between change points, since a run through one may leave on either branch."""
    start, points = solver.mechanism.start, np.array(solver.change_points())
    if not len(points):
        return profile
    interval = interval_around(solver.crank_range(), start)
    low, high = start - REVOLUTION, start + REVOLUTION
    if interval is not None and not solver.crank_range().full:
        low, high = interval
    nearest = points + REVOLUTION * np.round((start - points) / REVOLUTION)
    around = nearest + REVOLUTION * np.array([[-1.0], [0.0], [1.0]])
    low = max([low, *(around[around < start] + CHANGE_POINT_DISTANCE)])
    high = min([high, *(around[around > start] - CHANGE_POINT_DISTANCE)])
    return swing(0.5 * (low + high), 0.49 * (high - low), speed)


class _Options(TypedDict, total=False):
    """The options of `validate`, for its two types of result."""

    set: Mapping[str, str | float] | None
    drive: Mapping[str, str | State] | None
    duration: str | float | None
    speed: float | str
    tolerance: float | str | None
    stepped: bool


@overload
def validate(model: Any, against: None = None, **options: Unpack[_Options]) -> Validation: ...
@overload
def validate(model: Any, against: Against, **options: Unpack[_Options]) -> Agreement: ...
def validate(
    model: Any,
    against: Against | None = None,
    *,
    set: Mapping[str, str | float] | None = None,
    drive: Mapping[str, str | State] | None = None,
    duration: str | float | None = None,
    speed: float | str = SPEED,
    tolerance: float | str | None = None,
    stepped: bool = True,
) -> Agreement | Validation:
    """Validate a model by every method, or compare it with a formula or a table; as `mechsim validate`.

    Args:
        model: a name, a file, a MuJoCo object, a mechanism, what `load` returns, or a parametric model.
        against: a function of the drivers' coordinates, FILE.py:FUNC, or FILE.csv; it is run. None compares
            the model's own formula, the loop equations, and MuJoCo.
        set: parameter -> value, as for `load`.
        drive: coordinate -> motion law, as for `load`.
        duration: of the motion laws, as for `load`.
        speed: of a crank, in [rad/s], or text, as "600rpm".
        tolerance: on positions of stepped runs, with `against` on all positions, in [m] or text, as "10um".
            None takes 1e-8 of the stroke or of the workspace.
        stepped: whether MuJoCo also steps the model in time.

    Returns:
        `Validation` or, with `against`, `Agreement`; both have `passed`, `outcome`, `checks`, `why` and
        `findings`.

    Raises:
        InputError: for a model, a function or a table that cannot be used.
        AssemblyError: if the loops do not close.

    Example:
        >>> import mechsim as ms
        >>> ms.validate("four_bar", stepped=False).passed
        True
    """
    crank_speed, limit = comparison_inputs(speed, tolerance)
    designs = parametric(with_formulas(model) if against is None else model, set, drive, duration)
    if against is not None:
        return compare_model(designs, against, speed=crank_speed, tolerance=limit, stepped=stepped)
    return case_of(designs, speed=crank_speed, quick=not stepped, tolerance=limit)


def validate_all(
    models: Mapping[str, KinematicSolver | DesignFamily],
    *,
    speed: float = 20.0 * np.pi,
    quick: Container[str] = (),
    tolerance: float | None = None,
    budget: float = BUDGET,
    progress: Progress = no_progress,
) -> dict[str, Validation]:
    """Validate several mechanisms.

    Args:
        models: name -> mechanism, as in `case_of`.
        speed: as in `case_of`.
        quick: names of those whose runs are not stepped.
        tolerance: as in `case_of`.
        budget: as in `case_of`.
        progress: called with a text and the finished fraction of all mechanisms.
    """
    cases: dict[str, Validation] = {}
    finished = finished_fractions([name in quick for name in models])
    for i, (name, model) in enumerate(models.items()):

        def case_progress(what: str, _: float, i: int = i, name: str = name) -> None:
            progress(f"{i + 1} of {len(models)}, {name}: {what}", finished[i])

        cases[name] = case_of(
            model,
            speed=speed,
            quick=name in quick,
            tolerance=tolerance,
            budget=budget,
            progress=case_progress,
        )
        progress(f"{i + 1} of {len(models)}, {name}", finished[i + 1])
    return cases


# work on a mechanism whose run is stepped, also that of drawing it, in times of the work on others
STEPPED_WORK = 3.0


def finished_fractions(quick: Sequence[bool]) -> list[float]:
    """Return the finished fraction of the work before the first and after each of several mechanisms.

    Args:
        quick: whether the run of each is left out.

    Example:
        >>> finished_fractions([False, True])
        [0.0, 0.75, 1.0]
    """
    work = np.cumsum([0.0, *(1.0 if left_out else STEPPED_WORK for left_out in quick)])
    return (work / work[-1]).tolist()


# distance from a change point in [rad] within which steps are not compared
CHANGE_POINT_DISTANCE = 0.05
