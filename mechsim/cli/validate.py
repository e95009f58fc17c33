"""Command `mechsim validate`: compares formulas, loop equations, MuJoCo and a user's own model."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim import units
from mechsim.cli.command import JSON_OPTION, Result, Stated, command, output_folder
from mechsim.cli.exit_codes import print_stderr
from mechsim.cli.finding_text import findings_in_json, print_finding_lines
from mechsim.cli.options import DriveOptions, Sets, Speed, Verbose
from mechsim.cli.output import print_json
from mechsim.cli.progress import progress, sections
from mechsim.cli.verdict_text import print_agreement, print_cases, print_verdicts
from mechsim.compare.checks import Verdict
from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.io import catalog, gallery
from mechsim.io.formula_file import with_formulas
from mechsim.io.readers import load
from mechsim.io.scene_findings import scene_findings
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics.arrays import REVOLUTION
from mechsim.studies.agreement.agreement import compare_model
from mechsim.studies.validate import BUDGET, Validation, validate_all
from mechsim.units import crank_speed, option


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidateOptions:
    """Methods, references and tolerance of a validation."""

    whole_gallery: bool = option(False, "Also step the mechanisms of the gallery in time.", name="--gallery")
    reference: bool = option(
        False, "Compare both methods with the 30-digit reference data.", name="--reference"
    )
    report: str | None = option(None, "Write a page with plots and pictures to this folder.", metavar="DIR")
    dossier: str | None = option(
        None, "Write what was verified, and what was not, of each model to this folder.", metavar="DIR"
    )
    speed: Speed = "600rpm"
    budget: str = option(f"{BUDGET:g}s", "Processor time for the stepped runs of each mechanism.")
    against: str | None = option(
        None,
        "Compare one model with your own function, which is run, or a table, of points (P), joints (J), "
        "columns (P.x, J.v, torque), distance:P,Q, angle:LINK,LINK or expr:EXPRESSION.",
        metavar="FILE.py:FUNC|FILE.csv",
    )
    tolerance: str | None = option(
        None,
        "Tolerance on positions. Default: with --against 1e-8 of the workspace, else rounding for the file's "
        "formula, 1e-8 of the stroke or the size for stepped runs, and 1e-3 of the size for an .xml with its "
        "own settings.",
    )
    formula: bool = option(True, "Whether to run the formulas that files name, which are Python code.")
    compare_to: str | None = option(
        None, "Also state what became better or worse since this output of --json.", metavar="EARLIER.json"
    )
    verbose: Verbose = False

    @property
    def tolerance_in_metres(self) -> float | None:
        """The tolerance in [m]; None if there is none."""
        if self.tolerance is None:
            return None
        tolerance = units.parse_tolerance(self.tolerance)
        if not 0.0 < tolerance < math.inf:
            raise InputError(f"--tolerance is {self.tolerance}; give a length above 0, as in 1um")
        return tolerance


@command
def validate(
    models: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MODEL]...",
            help="Names, FILE.toml, .xml, .urdf or FILE.py:OBJECT, which is code and is run. Default: the "
            "catalogue, and the gallery without stepping.",
        ),
    ] = None,
    *,
    chosen: ValidateOptions,
    driven: DriveOptions,
    stated: Stated,
    sets: Sets = None,
    as_json: JSON_OPTION = False,
) -> Result:
    """Check formulas, loop equations and MuJoCo against each other, and name the cause of a difference.

    A formula that the file or --against names is Python code, and is run.

    Examples:
    mechsim validate four_bar
    mechsim validate slider_crank --against my_kinematics.py:position
    """
    if chosen.against is not None:
        stated.exclude(("budget", "formula", "reference"), "with --against")
    if chosen.reference:
        used = {"reference", "models", "verbose", "as_json", "compare_to"}
        stated.exclude(stated.options.keys() - used, "with --reference")
    compared: Callable[[Result], Result] | None = None
    if chosen.compare_to is not None:
        from mechsim.cli.earlier import compared_with, earlier_checks

        compared = partial(compared_with, chosen.compare_to, earlier_checks(chosen.compare_to))
    if chosen.reference:
        result = _by_reference(models or (), chosen.verbose)
    else:
        with output_folder(chosen.report) as folder:
            result = _validate(models, chosen, driven, sets, stated, folder, as_json=as_json)
    return result if compared is None else compared(result)


def _validate(
    models: Sequence[str] | None,
    chosen: ValidateOptions,
    driven: DriveOptions,
    sets: list[str] | None,
    stated: Stated,
    folder: Path | None,
    *,
    as_json: bool,
) -> Result:
    """Validate models, and write a report into a folder if there is one."""
    if chosen.against is not None:
        if models is None or len(models) != 1 or chosen.whole_gallery:
            raise InputError("--against compares one model; name exactly one")
        design = driven.applied_to(models[0], sets).load_parametric(moving=False)
        _require_crank(stated, [design.make({})])
        return _against(models[0], design, chosen, folder)
    names = list(models or catalog.MECHANISMS)
    names += list(gallery.files()) if chosen.whole_gallery or not models else []
    names = list(dict.fromkeys(names))
    if (driven != DriveOptions() or sets) and len(names) != 1:
        options = "--set changes" if sets else "--drive, --lock, --key and --track change"
        raise InputError(f"{options} one mechanism; name it")
    solving = with_formulas if chosen.formula else str
    loaded = [driven.applied_to(solving(model), sets).load_parametric() for model in names]
    if not chosen.formula:
        loaded = [*map(_without_formula, loaded)]
    solvers = [design.make({}) for design in loaded]
    _require_crank(stated, solvers)
    # the user's own code that runs for the formulas in files
    code = dict.fromkeys(solver.formula.rpartition(":")[0] for solver in solvers)
    own = [file for file in code if file and Path(file).resolve().parent != gallery.folder()]
    if own:
        print_stderr(f"mechsim: runs {', '.join(own)} (a formula is Python code)")
    # a mechanism has the name of its argument if several have the same name
    count = Counter(solver.name for solver in solvers)
    designs = {
        solver.name if count[solver.name] == 1 else model: design
        for solver, model, design in zip(solvers, names, loaded, strict=True)
    }
    quick = () if models or chosen.whole_gallery else list(gallery.files())
    with output_folder(chosen.dossier) as dossiers:
        result, cases = _validated(designs, chosen, quick, folder, as_json=as_json)
        if dossiers is not None:
            from mechsim.report.dossier import write_dossier

            for (name, case), model in zip(cases.items(), names, strict=True):
                write_dossier(dossiers, str(chosen.dossier), name, model, designs[name], case)
    return result


def _require_crank(stated: Stated, solvers: Iterable[KinematicSolver]) -> None:
    """Raise InputError for a stated speed if no mechanism has a crank at constant speed."""
    if "speed" in stated.options and not any(
        # a formula has a crank
        solver.closed_form is not None or (solver.motion_laws.crank and solver.mechanism.has_crank)
        for solver in solvers
    ):
        stated.exclude(["speed"], "without a crank at constant speed")


def _without_formula(design: DesignFamily) -> DesignFamily:
    """Return a parametric model without the formula of its file."""

    def make(values: Mapping[str, float]) -> KinematicSolver:
        solver = design.make(values)
        return solver.with_mechanism(solver.mechanism, formula="") if solver.formula else solver

    return replace(design, make=make)


# processor time of drawing the default report, in times of its validation
DRAWING = 5.0


def _validated(
    designs: Mapping[str, DesignFamily],
    chosen: ValidateOptions,
    quick: Sequence[str],
    folder: Path | None,
    *,
    as_json: bool,
) -> tuple[Result, dict[str, Validation]]:
    """Validate mechanisms; if one cannot be assembled, JSON reports it before the error is raised.

    Args:
        designs: name -> mechanism.
        chosen: options.
        quick: names of the mechanisms that are not stepped in time.
        folder: folder of a report; None writes none.
        as_json: whether the result is printed as JSON.
    """
    speed, drawing = crank_speed(chosen.speed), 0.0
    if folder is not None:
        from mechsim.report.validation import drawing_processes

        drawing = DRAWING / drawing_processes(len(designs))
    report_notes: Sequence[str] = ()
    with progress("validate", None) as report:
        check, draw = sections(report, {"check": 1.0, "draw": drawing})
        try:
            cases = validate_all(
                designs,
                speed=speed,
                quick=quick,
                tolerance=chosen.tolerance_in_metres,
                budget=units.parse_time(chosen.budget, "the budget"),
                progress=check,
            )
        except (AssemblyError, MobilityError) as error:
            if as_json:
                outcome = error.outcome if isinstance(error, MobilityError) else "cannot assemble"
                failed = {"passed": False, "outcome": outcome, "checks": [], "steps": 0, "seconds": 0.0}
                entries = {
                    name: failed | findings_in_json(scene_findings(design.make({})))
                    for name, design in designs.items()
                }
                print_json({"passed": False, "mechanisms": entries})
            raise
        passed = all(case.passed for case in cases.values())
        entries = {name: case.as_dict() for name, case in cases.items()}
        data: dict[str, Any] = {"passed": passed, "mechanisms": entries}
        if folder is not None:
            from mechsim.report.validation import write_validation_report

            report_notes = write_validation_report(folder, cases, data, draw)
    for note in report_notes:
        print_stderr(note)

    def text() -> None:
        print_cases(cases, f"{speed * 60.0 / REVOLUTION:.4g} rpm", verbose=chosen.verbose)
        _print_folders(chosen)

    return Result(data, text, passed), cases


def _print_folders(chosen: ValidateOptions) -> None:
    if chosen.report is not None:
        typer.echo(f"report: {Path(chosen.report) / 'index.html'}")
    if chosen.dossier is not None:
        typer.echo(f"dossier: {chosen.dossier}")


def _against(model: str, design: DesignFamily, chosen: ValidateOptions, folder: Path | None) -> Result:
    """Compare a model with a function or a table, and explain the difference."""
    source, tolerance = chosen.against or "", chosen.tolerance_in_metres
    if not source.lower().endswith(".csv"):
        print_stderr(f"mechsim: runs {source.rpartition(':')[0] or source} (a formula is Python code)")
    with output_folder(chosen.dossier) as dossiers:
        agreement = compare_model(design, source, speed=crank_speed(chosen.speed), tolerance=tolerance)
        name, findings = agreement.solver.name, scene_findings(agreement.solver) or ()
        if dossiers is not None:
            from mechsim.report.dossier import write_dossier

            write_dossier(dossiers, str(chosen.dossier), name, model, design, agreement)
    entry = agreement.as_dict() | findings_in_json((*findings, *agreement.findings))
    data: dict[str, Any] = {"passed": agreement.passed, "mechanisms": {name: entry}}
    if folder is not None:
        from mechsim.report.validation import write_agreement_report

        for note in write_agreement_report(folder, agreement, design, data):
            print_stderr(note)

    def text() -> None:
        print_finding_lines(findings)
        warnings = sum(finding.severity != "note" for finding in findings)
        print_agreement(name, agreement, verbose=chosen.verbose, findings=warnings)
        _print_folders(chosen)

    return Result(data, text, agreement.passed)


def _by_reference(models: Sequence[str], verbose: bool) -> Result:
    """Compare mechanisms with the reference data; without names, all mechanisms with reference data.

    Raises:
        InputError: if a name has no data, or data differ from their checksum.
    """
    from mechsim.io import reference_data
    from mechsim.studies.reference import by_reference

    folder = reference_data.folder()
    tables = [reference_data.read(folder, name) for name in models or reference_data.names(folder)]
    verdicts: dict[str, Verdict] = {}
    with progress("validate", len(tables)) as report:
        for table in tables:
            closed_form = catalog.make(table.name) if table.name in catalog.MECHANISMS else None
            verdicts[table.name] = by_reference(load(str(table.mechanism)), table, closed_form)
            report(table.name)
    count = sum(verdict.passed for verdict in verdicts.values())

    def text() -> None:
        print_verdicts(verdicts, verbose=verbose)
        typer.echo(f"{count} of {len(verdicts)} mechanisms agree with the reference data in {folder}")

    passed = count == len(verdicts)
    return Result({"passed": passed, "mechanisms": verdicts}, text, passed)
