"""Command `mechsim dynamics inverse`: drive torque, joint reactions, energy, speed fluctuation."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from mechsim import files
from mechsim.analytic.dynamics import DynamicModel, InverseDynamics, actuated, fluctuation, flywheel_for
from mechsim.analytic.dynamics.contact_forces import contact_forces
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.cli.command import Result, Stated, Without, command
from mechsim.cli.dynamics_report import (
    DynamicsJson,
    Verbose,
    driven_tolerance,
    passed,
    print_comparison,
    print_peaks,
    require_method,
    require_samples,
    require_turns,
    verdict_data,
    with_masses,
    without_solution,
)
from mechsim.cli.exit_codes import notes
from mechsim.cli.load_options import LoadOptions
from mechsim.cli.options import ModelOptions
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
from mechsim.cli.output_paths import plot_file, table_file
from mechsim.cli.progress import progress, sections
from mechsim.errors import FrictionError, InputError
from mechsim.model.force_record import Fluctuation
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import CrankProfile
from mechsim.model.progress import Progress
from mechsim.model.quantities import quantity
from mechsim.numerics.resources import require_memory
from mechsim.pictures import plots
from mechsim.report.facts import study_facts
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.result import Driven
from mechsim.studies.dynamics_check import crosscheck_driven
from mechsim.studies.motions import driven_as, profile_of
from mechsim.units import crank_speed, option, parse

# numbers stored for an instant in addition to those of its joints, and bytes of memory for each number
INSTANT_NUMBERS, NUMBER_BYTES = 40.0, 16.0
# default intervals in a turn
TURN_INTERVALS = 360
# columns of the table for the instant and the motion of the crank -> unit
INSTANT_UNITS = {"t": "s", "angle": "rad", "speed": "rad/s", "acceleration": "rad/s2"}
# options of the motion of a crank, which motion laws replace
CRANK_ONLY = ("speed", "turns", "coefficient")


@dataclass(frozen=True, slots=True, kw_only=True)
class InverseOptions:
    """Motion, method and output."""

    speed: float = option(
        20.0 * np.pi, "Crank speed; a bare number is rad/s.", read=crank_speed, text="600rpm"
    )
    coefficient: float | None = option(
        None, "Compute the flywheel that reaches this coefficient of speed fluctuation."
    )
    turns: float = option(1.0, "Turns of the crank.")
    samples: int | None = option(
        None, f"Rows, both ends included. Default: {TURN_INTERVALS} intervals in a turn."
    )
    tolerance: float | None = option(
        None,
        "Largest error of MuJoCo's torque and reactions relative to their root mean square. The steps are "
        "chosen to satisfy it.",
        metavar="NUMBER",
    )
    method: str | None = option(
        None,
        "How MuJoCo checks the result: pose solves each configuration, step integrates in time, none omits "
        "it. Default: pose; step with --tolerance.",
        metavar="pose|step|none",
    )
    actuators: str | None = option(
        None,
        "Actuated joints, more than degrees of freedom, with weights: computes the torques of least weighted "
        "norm.",
        metavar="J[=WEIGHT],...",
    )
    output: Annotated[str | None, table_file("Table of all quantities to write")] = None
    plot: Annotated[str | None, plot_file("Draw all quantities")] = None

    def check(self) -> None:
        """Raise InputError for invalid options, before any computation."""
        require_method(self.method, "pose", "step", "none", tolerance=self.tolerance)
        if self.samples is not None:
            require_samples(self.samples)
        require_turns(self.turns)

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
def inverse(
    source: ModelOptions,
    loads: Annotated[LoadOptions, Without("motor", "gear", "controller")],
    options: InverseOptions,
    stated: Stated,
    verbose: Verbose = False,
    units: Units = None,
) -> Result[DynamicsJson]:
    """Compute the drive torque and the joint reactions of a prescribed motion.

    Examples:
    mechsim dynamics inverse slider_crank --speed 600rpm --load press.csv
    mechsim dynamics inverse four_bar --plot sheet.svg
    """
    options.check()
    model = loads.dynamic_model(source.load_moving(by_motors=True))
    shown = output_units(units, model.solver) or SI_UNITS
    stated.exclude(CRANK_ONLY, "under motion laws", not model.solver.motion_laws.crank)
    if replaced := model.forces.replaced_by_motion:
        notes.append(
            f"{model.mechanism.name}: the prescribed motion replaces {', '.join(replaced)} of the file"
        )
        model = replace(model, forces=model.forces.without_motor())
    try:
        result = _prescribed(model, options, shown, units is not None, verbose)
    except FrictionError as error:
        result = without_solution(error)
    return with_masses(model, result, verbose)


def _prescribed(
    model: DynamicModel, options: InverseOptions, shown: OutputUnits, labelled: bool, verbose: bool
) -> Result[Any]:
    """Return the result of a prescribed motion."""
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
            run = _driven(model, options, profile, rows, next(steps))
            verdict = crosscheck_driven(run, model, progress=next(steps))
    contacts = contact_forces(model, profile.state, time)
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
        for name, contact in contacts.items():
            print_text(contact.sentence(name))
        print_comparison(verdict, tolerance, note, verbose=verbose)

    data = {
        "contacts": contacts,
        **study_facts(study),
        "fluctuation": steady,
        "with_flywheel": even,
    }
    data |= {"tolerance_report": tolerance, "note": note, **verdict_data(verdict, method)}
    return Result(data, text, passed(verdict, tolerance))


def _driven(
    model: DynamicModel, options: InverseOptions, profile: CrankProfile, rows: int, report: Progress
) -> Driven:
    """Return the same motion in MuJoCo."""
    return driven(
        model.mechanism,
        model.forces,
        **driven_as(model.solver, profile),
        method=options.mujoco_method,
        tolerance=options.tolerance,
        # with a tolerance, the smallest sufficient number of steps determines the instants
        samples=rows - 1 if options.tolerance is None else None,
        progress=report,
    )


def _noise_free(torque: float, study: InverseDynamics) -> float:
    """Return the mean torque; 0 if the mean is rounding noise of the torque."""
    return without_noise([torque, float(np.abs(study.forces.torque).max())])[0]


def _steady_turns(
    model: DynamicModel, options: InverseOptions
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


def _write(
    path: str | None, columns: InverseDynamics, mechanism: Mechanism, shown: OutputUnits | None
) -> None:
    if path is not None:
        names = [] if shown is None else [name for name, _ in columns.columns()]
        units = {name: INSTANT_UNITS.get(name) or _column_unit(name, mechanism) for name in names}
        files.write_table(path, in_units(columns.columns(), units, shown))


def _column_unit(name: str, mechanism: Mechanism) -> str:
    word, _, coordinate = name.partition(" ")
    return mechanism.effort_unit(coordinate) if word == "actuator" else quantity(name, mechanism).unit
