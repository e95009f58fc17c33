"""Command `mechsim dynamics`: drive torque, joint reactions, energy, speed fluctuation, free motion."""

from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import typer

from mechsim import files
from mechsim.analytic.dynamics import (
    DynamicModel,
    FreeRun,
    InverseDynamics,
    actuated,
    fluctuation,
    flywheel_for,
    free_run,
)
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.cli.command import Result, Stated, command
from mechsim.cli.dynamics_report import (
    DynamicsJson,
    driven_tolerance,
    free_tolerance,
    print_comparison,
    print_peaks,
)
from mechsim.cli.forward_dynamics import (
    MODES,
    RESPONSE,
    RUN,
    STATICS,
    ForwardJson,
    ForwardOptions,
    Output,
    forward_dynamics,
)
from mechsim.cli.load_options import LoadOptions, print_masses, released_model, states_initial
from mechsim.cli.options import ModelOptions, output_file, writable
from mechsim.cli.output import (
    SI_UNITS,
    OutputUnits,
    Units,
    in_units,
    number,
    output_units,
    print_text,
    without_noise,
)
from mechsim.cli.progress import progress, sections
from mechsim.errors import InputError
from mechsim.model.force_record import Fluctuation
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import MIN_TURNS
from mechsim.model.quantities import quantity
from mechsim.numerics.resources import require_memory
from mechsim.pictures import plots
from mechsim.report.facts import run_facts, study_facts
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import compared_segments, crosscheck_driven, crosscheck_free
from mechsim.studies.motions import driven_as, profile_of
from mechsim.units import crank_speed, option, parse
from mechsim.verdict.checks import Verdict

# numbers stored for an instant in addition to those of its joints, and bytes of memory for each number
INSTANT_NUMBERS, NUMBER_BYTES = 40.0, 16.0
# default intervals in a turn or a run, and limits of rows and turns
TURN_INTERVALS, MAX_ROWS, MAX_TURNS = 360, 10_000_000, 1e4
# columns of the table for the instant and the motion of the crank -> unit
INSTANT_UNITS = {"t": "s", "angle": "rad", "speed": "rad/s", "acceleration": "rad/s2"} | {
    # columns of free runs
    "motor": "N m",
    "work": "J",
    "lost": "J",
}

# motions of a crank, as parts of messages
DRIVEN, UNDER_LAWS, FREE = "in a prescribed motion", "under motion laws", "in a free run"
# options of a run from an initial state, and of the motion of a crank
INITIAL_ONLY = ("controller", "restitution", "quantities")
CRANK_ONLY = ("speed", "free", "coefficient", "turns", "tolerance", "actuators", "units")
RUN_ONLY = ("samples", "duration", "drive", "until", "restitution", "quantities")
# motion or analysis -> the options that have no effect there
WITHOUT_EFFECT = {
    DRIVEN: INITIAL_ONLY,
    UNDER_LAWS: (*INITIAL_ONLY, "speed", "turns", "coefficient"),
    FREE: (*INITIAL_ONLY, "coefficient", "actuators"),
    RUN: (*CRANK_ONLY, "assemblies"),
    STATICS: (*CRANK_ONLY, *RUN_ONLY, "track", "output", "plot", "modes", "response"),
    MODES: (*CRANK_ONLY, *RUN_ONLY, "track", "output", "assemblies", "response"),
    RESPONSE: (*CRANK_ONLY, *RUN_ONLY, "assemblies"),
}

Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="List all checks and all masses.")]


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicsOptions:
    """Motion, method and output."""

    speed: float = option(
        20.0 * np.pi, "Crank speed; a bare number is rad/s.", read=crank_speed, text="600rpm"
    )
    free: bool = option(False, "Let the crank run freely, starting at --speed.", name="--free")
    coefficient: float | None = option(
        None, "Compute the flywheel that reaches this coefficient of speed fluctuation."
    )
    turns: float = option(1.0, "Turns of the crank.")
    samples: int | None = option(
        None, f"Rows, both ends included. Default: {TURN_INTERVALS} intervals in a turn or a run."
    )
    tolerance: float | None = option(
        None,
        "Largest error of MuJoCo's torque and reactions relative to their root mean square; in a free run "
        "the largest error of joint angles in rad. The steps are chosen to satisfy it.",
        metavar="NUMBER",
    )
    method: str | None = option(
        None,
        "How MuJoCo checks the result: pose solves each configuration, step integrates in time, none omits "
        "it. Default: pose; step with --tolerance and in free runs.",
        metavar="pose|step|none",
    )
    actuators: str | None = option(
        None,
        "Actuated joints, more than degrees of freedom, with weights: computes the torques of least weighted "
        "norm.",
        metavar="J[=WEIGHT],...",
    )
    output: Annotated[str | None, output_file("Table of all quantities to write: .csv or .npz.")] = None
    plot: str | None = option(None, "Draw all quantities: .svg, .pdf or .png.", metavar="FILE")

    def check(self) -> None:
        """Raise InputError for invalid options, before any computation."""
        if self.method not in (None, "pose", "step", "none"):
            raise InputError(f"there is no method {self.method!r}; choose from pose, step, none")
        if self.tolerance is not None and self.method == "none":
            raise InputError(
                "--tolerance applies to MuJoCo's runs, which --method none omits; drop one of them"
            )
        if self.samples is not None and not 2 <= self.samples <= MAX_ROWS:
            raise InputError(f"--samples is {self.samples}; give 2 to {MAX_ROWS}")
        if not MIN_TURNS <= abs(self.turns) < MAX_TURNS:
            raise InputError(f"--turns is {self.turns:g}; give {MIN_TURNS:g} to {MAX_TURNS:g} either way")
        if self.output is not None:
            writable(self.output, ".csv", ".npz")
        if self.plot is not None:
            writable(self.plot, ".svg", ".pdf", ".png")

    def actuator_weights(self) -> dict[str, float]:
        """Return the actuators and the weights of their squared torques."""
        named = [text.partition("=") for text in self.actuators.split(",")] if self.actuators else []
        return {
            name: parse(weight, "1", f"the weight of {name}") if sign else 1.0 for name, sign, weight in named
        }

    @property
    def mujoco_method(self) -> Any:
        """MuJoCo's method: "pose", "step" or "none"."""
        return self.method or ("pose" if self.tolerance is None else "step")

    def rows(self, turns: float) -> int:
        """Return the number of recorded instants."""
        return self.samples or max(1, round(TURN_INTERVALS * abs(turns))) + 1


@command
def dynamics(
    source: ModelOptions,
    loads: LoadOptions,
    options: DynamicsOptions,
    forward: ForwardOptions,
    stated: Stated,
    verbose: Verbose = False,
    units: Units = None,
) -> Result[DynamicsJson | ForwardJson]:
    """Compute torques and reactions of a motion, runs from an initial state, equilibria and modes.

    Examples:
    mechsim dynamics slider_crank --speed 600rpm --load press.csv --plot sheet.svg
    mechsim dynamics four_bar --motor line:1,600rpm --turns 3
    mechsim dynamics four_bar --initial crank.q=30deg --duration 1s
    """
    options.check()
    if forward.requested or states_initial(source):
        analysis = forward.analysis
        stated.exclude(WITHOUT_EFFECT[analysis], analysis)
        if options.method == "pose" or (options.method == "step" and analysis != RUN):
            raise InputError(f"--method {options.method} has no effect {analysis}; leave it out")
        model = released_model(source, loads)
        output = Output(options.rows(1.0), options.method, options.output, options.plot, verbose)
        result = forward_dynamics(model, forward, source, output)
        return _with_masses(model, result, verbose)
    model = loads.dynamic_model(source.load_moving(by_motors=True))
    shown = output_units(units, model.solver) or SI_UNITS
    if not model.solver.motion_laws.crank and options.free:
        raise InputError("--free releases a crank, and motion laws drive the joints; drop one of them")
    free = model.forces.motor is not None or options.free
    motion = FREE if free else DRIVEN if model.solver.motion_laws.crank else UNDER_LAWS
    stated.exclude(WITHOUT_EFFECT[motion], motion)
    if free and options.method == "pose":
        raise InputError("a free run is stepped; leave out --method pose")
    data, text, passed = (_free if free else _prescribed)(model, options, shown, units is not None, verbose)

    return _with_masses(model, Result(data, text, passed), verbose)


def _with_masses(model: DynamicModel, result: Result[Any], verbose: bool) -> Result[Any]:
    """Return a result with name, masses and gravity of its mechanism."""
    gravity = model.forces.gravity

    def text() -> None:
        result.text()
        print_masses(model.masses, verbose)
        print_text(f"gravity: {', '.join(map(number, gravity))} m/s2" if any(gravity) else "gravity: none")

    data = {"mechanism": model.mechanism.name, "masses": model.masses, "gravity": gravity, **result.data}
    return Result(data, text, result.passed)


def _prescribed(
    model: DynamicModel, options: DynamicsOptions, shown: OutputUnits, labelled: bool, verbose: bool
) -> Any:
    """Return data, text and success of a prescribed motion."""
    method = options.mujoco_method
    profile = profile_of(model.solver, options.speed, options.turns)
    model, rows = model.starting_at(profile.angles), options.rows(options.turns)
    if method != "none":
        _require_memory(model, rows)
    time = np.linspace(0.0, profile.duration, rows)
    with progress("dynamics", None) as report:
        # parts of about the same length
        names = ("formulas",) if method == "none" else ("formulas", "MuJoCo", "check")
        steps = iter(sections(report, dict.fromkeys(names, 1.0)))
        study = prescribed_along(model, *profile.state(time), time=time, progress=next(steps))
        study = actuated(study, weights) if (weights := options.actuator_weights()) else study
        steady, even = _steady_turns(model, options)
        run, verdict = None, None
        if method != "none":
            run = driven(
                model.mechanism,
                model.forces,
                **driven_as(model.solver, profile),
                method=method,
                tolerance=options.tolerance,
                # with a tolerance, the smallest sufficient number of steps determines the instants
                samples=rows - 1 if options.tolerance is None else None,
                progress=next(steps),
            )
            verdict = crosscheck_driven(run, model, progress=next(steps))
    _write(options.output, study, model.mechanism, shown if labelled else None)
    if options.plot is not None:
        plots.write(options.plot, plots.dynamics_sheet(study, steady, even, run and run.forces))
    alone = "MuJoCo is compared under the drivers alone, without actuators" if weights and run else ""
    note, tolerance = "; ".join(filter(None, (alone, run and run.note))), driven_tolerance(run)

    def text() -> None:
        print_peaks(model.mechanism.name, study, shown)
        for name, cycle in (("speed fluctuation", steady), ("with the flywheel", even)):
            if cycle is not None:
                print_text(
                    f"{name}: coefficient {number(cycle.coefficient)} under a constant torque of "
                    f"{number(_noise_free(cycle.torque, study))} N m and a flywheel of "
                    f"{number(cycle.flywheel)} kg m2"
                )
        print_comparison(verdict, tolerance, note, verbose=verbose)

    data = {
        **study_facts(study),
        "fluctuation": steady,
        "with_flywheel": even,
    }
    data |= {"tolerance_report": tolerance, "note": note, **_verdict_data(verdict, method)}
    return data, text, _passed(verdict, tolerance)


def _noise_free(torque: float, study: InverseDynamics) -> float:
    """Return the mean torque; 0 if the mean is rounding noise of the torque."""
    return without_noise([torque, float(np.abs(study.forces.torque).max())])[0]


def _passed(verdict: Verdict | None, tolerance: dict[str, Any] | None) -> bool:
    return (verdict is None or verdict.passed) and (tolerance is None or tolerance["satisfied"])


def _steady_turns(
    model: DynamicModel, options: DynamicsOptions
) -> tuple[Fluctuation | None, Fluctuation | None]:
    """Return a revolution under a constant torque, and one with the flywheel; None for a missing one."""
    if not model.solver.motion_laws.crank or not model.solver.crank_range().full:
        return None, None
    steady = None
    # a crank too slow for its springs or weight has no steady revolution under a constant torque
    with suppress(InputError):
        steady = fluctuation(model, options.speed)
    target = options.coefficient
    return steady, None if target is None else flywheel_for(model, options.speed, target)


def _require_memory(model: DynamicModel, instants: int) -> None:
    """Raise InputError if memory is too small for the instants of both methods and the check."""
    mechanism = model.mechanism
    links, joints, points = len(mechanism.links), len(mechanism.joints), len(mechanism.points)
    numbers = 2.0 * (INSTANT_NUMBERS + 9.0 * joints) + 24.0 * links + 9.0 * points + 20.0 * joints
    name = f"the dynamics of {instants:,} instants by both methods"
    require_memory(name, instants, NUMBER_BYTES * numbers, "take {most} at the most, or --method none")


def _free(
    model: DynamicModel, options: DynamicsOptions, shown: OutputUnits, labelled: bool, verbose: bool
) -> Any:
    """Return data, text and success of a free motion."""
    speed = options.speed if options.free else 0.0
    run = free_run(model, speed=speed, turns=options.turns, samples=options.rows(options.turns))
    verdict = None
    if options.mujoco_method != "none" and run.outcome == "done" and compared_segments(run):
        with progress("check in MuJoCo", None) as report:
            verdict = crosscheck_free(run, model, tolerance=options.tolerance, progress=report)
    _write(options.output, run, model.mechanism, shown if labelled else None)
    if options.plot is not None:
        plots.write(options.plot, plots.free_plot(run))
    facts, tolerance = run_facts(run), free_tolerance(verdict, options.tolerance)

    def text() -> None:
        print_text(
            f"{model.mechanism.name}: free run {run.outcome}" + (f": {run.reason}" if run.reason else "")
        )
        first = without_noise(run.speed.tolist())[0]
        start = number(first) if first else "rest"
        print_text(
            f"{number(facts['turns'])} turns of the crank in {number(facts['seconds'])} s, from {start} to "
            f"{number(facts['speed'])} rad/s; work {number(facts['work'])} J, lost {number(facts['lost'])} "
            f"J, energy error {facts['energy_error']:.1e} (relative)"
        )
        print_comparison(verdict, tolerance, verbose=verbose)

    data = {"free": facts, "tolerance_report": tolerance, **_verdict_data(verdict, "step")}
    return data, text, run.outcome == "done" and _passed(verdict, tolerance)


def _write(
    path: str | None, columns: InverseDynamics | FreeRun, mechanism: Mechanism, shown: OutputUnits | None
) -> None:
    if path is not None:
        names = [] if shown is None else [name for name, _ in columns.columns()]
        units = {name: INSTANT_UNITS.get(name) or _column_unit(name, mechanism) for name in names}
        files.write_table(path, in_units(columns.columns(), units, shown))


def _column_unit(name: str, mechanism: Mechanism) -> str:
    word, _, coordinate = name.partition(" ")
    return mechanism.effort_unit(coordinate) if word == "actuator" else quantity(name, mechanism).unit


def _verdict_data(verdict: Verdict | None, method: str) -> dict[str, Any]:
    if verdict is None:
        return {"passed": None, "outcome": None, "method": "none", "checks": []}
    result = {"passed": verdict.passed, "outcome": verdict.outcome, "method": method}
    return result | {"checks": verdict.checks}
