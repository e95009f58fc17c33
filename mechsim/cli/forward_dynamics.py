"""Command `mechsim dynamics forward`: a run from an initial state."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from mechsim import files
from mechsim.cli import dynamics_report
from mechsim.cli.command import Result, Stated, Without, command, table_or_plot_file
from mechsim.cli.exit_codes import notes, print_stderr
from mechsim.cli.load_options import InitialOptions, LoadOptions, released_model
from mechsim.cli.options import ModelOptions, pairs
from mechsim.cli.output import DEGREES, DRAWN, Value, number, print_table, print_text, without_noise
from mechsim.cli.progress import progress, sections
from mechsim.compare.checks import Verdict
from mechsim.errors import FrictionError, InputError
from mechsim.io.law_text import with_controls
from mechsim.kinetics import DynamicModel, DynamicRun
from mechsim.kinetics.crank_turns import TURNS_BUDGET
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.forward_dynamics import BUDGET
from mechsim.kinetics.gaps import released
from mechsim.mechanism.quantities import quantity_names
from mechsim.numerics.arrays import Array
from mechsim.pictures import plots
from mechsim.studies.dynamics_check import compared_segments, crosscheck_forward
from mechsim.studies.release import Release
from mechsim.units import option


@dataclass(frozen=True, slots=True, kw_only=True)
class ForwardOptions(InitialOptions):
    """The end of a run, its comparison, and its files."""

    turns: float | None = option(None, "End the run after turns of the crank; negative for backwards.")
    budget: int | None = option(
        None,
        f"Work budget: largest number of states that a run evaluates before it ends. Default: {BUDGET:,}; "
        f"with --turns {TURNS_BUDGET:,}.",
        metavar="N",
    )
    samples: int = option(361, "Rows, both ends included.", metavar="N")
    quantities: tuple[str, ...] = option(
        (),
        "Also list these quantities: distance:P,Q, angle:LINK,LINK or expr:EXPRESSION.",
        read=quantity_names,
        name="--of",
        metavar="Q,...",
    )
    ctrl: tuple[tuple[str, str], ...] = pairs(
        "--ctrl motor=0.3*sin(2*pi*t)",
        "Control or target of an actuator or motor: a number, an expression of t, or FILE.csv.",
        "ACTUATOR=LAW",
    )
    method: str = option(
        "step", "Whether MuJoCo checks the run: step integrates it too, none omits it.", metavar="step|none"
    )
    output: Annotated[
        list[str] | None, table_or_plot_file("Table of all quantities", "plot of coordinates and energies")
    ] = None

    def check(self) -> None:
        """Raise InputError for invalid options, before any computation."""
        dynamics_report.require_method(self.method, "step", "none")
        dynamics_report.require_samples(self.samples)
        if self.turns is not None:
            dynamics_report.require_turns(self.turns)
            if self.until is not None:
                raise InputError("--turns and --until both end the run; drop one of them")


# why MuJoCo is compared only between the events of a run
SOFT = "its impacts, contacts and changes of friction are soft"
# number of intervals in which an open contact is printed
SPANS = 4
# duration in [s] above which a run states its work budget at once
LONG = 100.0
# shares of the processor time, measured on runs of four_bar, rssr and klann from an initial state
SHARES = {"formulas": 1.0, "check in MuJoCo": 2.0}


@command
def forward(
    source: Annotated[ModelOptions, Without("track")],
    loads: LoadOptions,
    options: ForwardOptions,
    stated: Stated,
    verbose: dynamics_report.Verbose = False,
) -> Result:
    """Run a mechanism from an initial state under weight, loads and motors.

    Drivers move freely, except those that --drive prescribes. MuJoCo steps the same run as a check.

    Examples:
    mechsim dynamics forward four_bar --initial crank.q=30deg --duration 1s
    mechsim dynamics forward four_bar --motor line:1,600rpm --turns 3
    """
    options.check()
    model = released_model(source, loads)
    model = released(model.with_forces(with_controls(model.forces, dict(options.ctrl))))
    turning = options.turns is not None
    if kept := model.mechanism.one_sided_curves:
        notes.append(f"{', '.join(kept)}: kept in contact, even where the force changes its sign")
    stated.exclude(["drive"], "with --turns, which counts turns of a free crank", turning)
    ends: dict[str, Any] = {"turns": options.turns, "budget": options.budget}
    if turning and source.duration is None:
        ends["duration"] = np.inf
    release, laws = options.release(model, source, **ends), model.solver.motion_laws
    lawful = () if laws.crank else laws.drivers
    if idle := [name for name in lawful if name not in release.prescribed]:
        notes.append(
            f"{', '.join(idle)}: released, so that motion laws do not act; --drive {idle[0]}=LAW keeps one"
        )
    # rejects unknown names before the run
    release.quantities(options.quantities)
    if release.duration > LONG and options.turns is None:
        print_stderr(f"dynamics: ends after {release.budget or BUDGET:,} states at the latest (--budget)")
    # MuJoCo stops when its steps are short enough
    try:
        with progress("dynamics", None, at_least=True) as report:
            formulas, check = sections(report, SHARES)
            result = release.run(options.samples - 1, formulas)
            verdict = None
            if options.method == "step" and result.outcome in ("done", "stopped"):
                values = initial_values(model, release.initial)
                verdict = crosscheck_forward(result, model, values, progress=check)
    except FrictionError as error:
        return dynamics_report.with_masses(model, dynamics_report.without_solution(error), verbose)
    values = release.values(result, options.quantities)
    shown = {f"{quantity.name} [{quantity.unit}]": column for quantity, column in values.items()}
    energies = files.attributes(result, "kinetic", "potential", "work", "lost")
    dynamics_report.write_outputs(
        options.output,
        lambda: dict(result.columns()) | {quantity.name: column for quantity, column in values.items()},
        lambda: plots.history_plot(result.motion, energies, shown),
    )
    extents = {quantity.name: _extent(column, quantity.unit) for quantity, column in values.items()}
    reported = _result(release, result, extents, verdict, verbose, drawn=options.output is not None)
    return dynamics_report.with_masses(model, reported, verbose)


def _result(
    release: Release,
    result: DynamicRun,
    quantities: Mapping[str, dict[str, Any]],
    verdict: Verdict | None,
    verbose: bool,
    drawn: bool,
) -> Result:
    """Return data and text of a run from an initial state."""
    model = release.model
    if verdict is not None and not verdict.checks and verdict.outcome != "diverged":
        verdict = None
    data: dict[str, Any] = {
        **files.attributes(result, "outcome", "reason", "energy_error", "events", "openings", "singular"),
        **files.attributes(result, "steps", "executed", "note"),
        "duration": float(result.time[-1]),
        "work": float(result.work[-1]),
        "lost": float(result.lost[-1]),
        "final": {
            f"{name}.{key}": float(values[-1])
            for name, joint in result.motion.joints.items()
            for key, values in (("q", joint.value), ("v", joint.rate))
        },
        "quantities": dict(quantities),
        "passed": None if verdict is None else verdict.passed,
        "checks": () if verdict is None else verdict.checks,
    }
    turns = ""
    if release.turns is not None:
        crank = result.motion.joints[model.mechanism.crank.name]
        revolutions = float(crank.value[-1] - crank.value[0]) / (2.0 * np.pi)
        end = {"seconds": data["duration"], "turns": revolutions, "speed": float(crank.rate[-1])}
        data["free"] = end | {
            name: data[name] for name in ("outcome", "reason", "work", "lost", "energy_error")
        }
        turns = f" after {number(revolutions)} turns of the crank"

    def text() -> None:
        end = f": {result.reason}" if result.reason else ""
        print_text(f"{model.mechanism.name}: {result.outcome} at {number(result.time[-1])} s{turns}{end}")
        print_text(
            f"energy error {result.energy_error:.1e} (relative), work {number(result.work[-1])} J, lost "
            f"{number(result.lost[-1])} J, {result.steps} steps in {result.executed}"
        )
        print_text(result.note and f"not in C: {result.note}")
        print_text(_openings(result))
        if result.singular:
            print_text(
                f"passes singular configurations at {', '.join(map(number, result.singular))} s: there "
                "drivers do not determine the motion"
            )
        _print_extents(model, result, quantities)
        soft = result.events or result.segments[0].sticking
        if verdict or not soft:
            dynamics_report.print_comparison(verdict, verbose=verbose)
        if soft:
            times = [f"{number(s.first)} to {number(s.last)} s" for s in compared_segments(result)]
            compared = (
                f"compared with MuJoCo in {', '.join(times)}" if verdict else "not compared with MuJoCo"
            )
            print_text(f"{compared}: {SOFT}")
        print_text("" if drawn else DRAWN)

    # a run without a number of turns may come to rest
    expected = ("done",) if turns else ("done", "stopped")
    return Result(data, text, result.outcome in expected and (verdict is None or verdict.passed))


def _print_extents(model: DynamicModel, result: DynamicRun, quantities: Mapping[str, dict[str, Any]]) -> None:
    """Print the ranges of coordinates, quantities and drive forces."""
    joints = result.motion.written_joints
    extents = {name: _extent(joint.value, joint.unit) for name, joint in joints.items()}
    ends = {name: float(joint.rate[-1]) for name, joint in joints.items()}
    rows: list[tuple[Value, ...]] = []
    for quantity, extent in [*extents.items(), *quantities.items()]:
        by, unit = DEGREES.converted(extent["unit"])
        numbers = without_noise([extent["least"], extent["largest"], extent["final"]])
        end = ends.get(quantity)
        rows.append((quantity, *(x / by for x in numbers), unit, None if end is None else end / by))
    head = ("quantity", "min", "max", "final", "unit", "final rate [unit/s]")
    rows += [
        (f"drive {name}", float(effort.min()), float(effort.max()), float(effort[-1]), unit, None)
        for name, effort in result.driving.items()
        for unit in [model.mechanism.effort_unit(name)]
    ]
    print_table("", head, rows)


def _openings(result: DynamicRun) -> str:
    """Return when contacts are open and ropes slack, in words; empty for none."""
    texts: list[str] = []
    for name, spans in result.openings.items():
        shown = ", ".join(f"{number(first)} to {number(last)} s" for first, last in spans[:SPANS])
        more = f" and in {len(spans) - SPANS} more intervals" if len(spans) > SPANS else ""
        texts.append(f"{name} is open, or slack, from {shown}{more}" if spans else f"{name} stays closed")
    return "; ".join(texts)


def _extent(values: Array, unit: str) -> dict[str, Any]:
    """Return minimum, maximum and last value of a quantity over a run, and its unit."""
    numbers = {"least": values.min(), "largest": values.max(), "final": values[-1]}
    return {name: float(value) for name, value in numbers.items()} | {"unit": unit}
