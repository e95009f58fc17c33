"""Command `mechsim dynamics inverse`: drive torque, joint reactions, energy, speed fluctuation."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from mechsim.cli import dynamics_report
from mechsim.cli.command import Result, Stated, Without, command, table_or_plot_file
from mechsim.cli.load_options import LoadOptions, note_replaced
from mechsim.cli.options import ModelOptions
from mechsim.cli.output import DRAWN, number, print_text, without_noise
from mechsim.cli.progress import progress, sections
from mechsim.errors import FrictionError, InputError, require_once
from mechsim.kinetics import DynamicModel, actuated, fluctuation
from mechsim.kinetics.contact_forces import contact_forces
from mechsim.kinetics.prescribed_motion import prescribed_along
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.resources import require_memory
from mechsim.pictures import plots
from mechsim.report.facts import study_facts
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven
from mechsim.studies.motions import driven_as, profile_of
from mechsim.units import crank_speed, option, parse

# numbers stored for an instant in addition to those of its joints, and bytes of memory for each number
INSTANT_NUMBERS, NUMBER_BYTES = 40.0, 16.0
# default intervals in a turn
TURN_INTERVALS = 360
# options of the motion of a crank, which motion laws replace
CRANK_ONLY = ("speed", "turns")


@dataclass(frozen=True, slots=True, kw_only=True)
class InverseOptions:
    """Motion, method and output."""

    speed: float = option(
        20.0 * np.pi, "Crank speed; a bare number is rad/s.", read=crank_speed, text="600rpm"
    )
    turns: float = option(1.0, "Turns of the crank.")
    samples: int | None = option(
        None, f"Rows, both ends included. Default: {TURN_INTERVALS} intervals in a turn."
    )
    method: str = option(
        "pose",
        "How MuJoCo checks the result: pose solves each configuration, step integrates, none omits it.",
        metavar="pose|step|none",
    )
    actuators: str | None = option(
        None,
        "Actuated joints, more than degrees of freedom, with weights: computes the torques of least weighted "
        "norm.",
        metavar="J[=WEIGHT],...",
    )
    output: Annotated[list[str] | None, table_or_plot_file("Table of all quantities", "their plot")] = None

    def check(self) -> None:
        """Raise InputError for invalid options, before any computation."""
        dynamics_report.require_method(self.method, "pose", "step", "none")
        if self.samples is not None:
            dynamics_report.require_samples(self.samples)
        dynamics_report.require_turns(self.turns)

    @property
    def rows(self) -> int:
        """Number of recorded instants."""
        return self.samples or max(1, round(TURN_INTERVALS * abs(self.turns))) + 1


@command
def inverse(
    source: Annotated[ModelOptions, Without("track")],
    loads: Annotated[LoadOptions, Without("motor")],
    options: InverseOptions,
    stated: Stated,
    verbose: dynamics_report.Verbose = False,
) -> Result:
    """Compute the drive torque and the joint reactions of a prescribed motion.

    Examples:
    mechsim dynamics inverse slider_crank --speed 600rpm --load press.csv
    mechsim dynamics inverse four_bar -o sheet.svg
    """
    options.check()
    model = loads.dynamic_model(source.load_moving(by_motors=True))
    stated.exclude(CRANK_ONLY, "under motion laws", not model.solver.motion_laws.crank)
    note_replaced(model.solver)
    mechanism = model.mechanism
    model = replace(model, forces=model.forces.under_drivers({*mechanism.drivers, *mechanism.locked}))
    try:
        result = _prescribed(model, options, verbose)
    except FrictionError as error:
        result = dynamics_report.without_solution(error)
    return dynamics_report.with_masses(model, result, verbose)


def _prescribed(model: DynamicModel, options: InverseOptions, verbose: bool) -> Result:
    """Return the result of a prescribed motion."""
    method: Any = options.method
    named = [text.partition("=") for text in options.actuators.split(",")] if options.actuators else []
    require_once("--actuators", [name for name, _, _ in named])
    # actuators and the weights of their squared torques
    weights = {
        name: parse(weight, "1", f"the weight of {name}") if sign else 1.0 for name, sign, weight in named
    }
    profile = profile_of(model.solver, options.speed, options.turns)
    model, compared = model.starting_at(profile.angles), method != "none"
    if compared:
        _require_memory(model.mechanism, options.rows)
    time = np.linspace(0.0, profile.duration, options.rows)
    with progress("dynamics", None) as report:
        # parts of about the same length
        names = ("formulas", "MuJoCo", "check") if compared else ("formulas",)
        steps = iter(sections(report, dict.fromkeys(names, 1.0)))
        solved = prescribed_along(model, *profile.state(time), time=time, progress=next(steps))
        study = actuated(solved, weights) if weights else solved
        run, verdict, steady = None, None, None
        if model.solver.motion_laws.crank and model.solver.crank_range().full:
            # a crank too slow for its springs or weight has no steady turn under a constant torque
            with suppress(InputError):
                steady = fluctuation(model, options.speed)
        if compared:
            run = driven(
                model.mechanism,
                model.forces,
                **driven_as(model.solver, profile),
                method=method,
                samples=options.rows - 1,
                progress=next(steps),
            )
            verdict = crosscheck_driven(run, model, solved=solved, progress=next(steps))
    contacts = contact_forces(model, profile.state, time)
    dynamics_report.write_outputs(
        options.output,
        lambda: dict(study.columns()),
        lambda: plots.dynamics_sheet(
            study.forces, study.torque_parts, study.power_stored, steady, run and run.forces
        ),
    )
    alone = "MuJoCo is compared under the drivers alone, without actuators" if weights and run else ""
    note = "; ".join(filter(None, (alone, run and run.note)))

    def text() -> None:
        dynamics_report.print_peaks(model.mechanism.name, study)
        if steady is not None:
            # 0 if the mean torque is rounding noise
            mean = without_noise([steady.torque, float(np.abs(study.forces.torque).max())])[0]
            sentence = (
                f"speed fluctuation: coefficient {number(steady.coefficient)} under a constant torque of "
                f"{number(mean)} N m and a flywheel of {number(steady.flywheel)} kg m2"
            )
            print_text(sentence if mean or steady.flywheel else "")
        for name, contact in contacts.items():
            print_text(contact.sentence(name))
        dynamics_report.print_comparison(verdict, note, verbose=verbose)
        print_text("" if options.output else DRAWN)

    data = {
        "contacts": contacts,
        **study_facts(study),
        "fluctuation": steady,
        "note": note,
        **dynamics_report.verdict_data(verdict, method),
    }
    return Result(data, text, verdict is None or verdict.passed)


def _require_memory(mechanism: Mechanism, instants: int) -> None:
    """Raise InputError if memory is too small for the instants of both methods and the check."""
    links, joints, points = len(mechanism.links), len(mechanism.joints), len(mechanism.points)
    numbers = 2.0 * (INSTANT_NUMBERS + 9.0 * joints) + 24.0 * links + 9.0 * points + 20.0 * joints
    name = f"the dynamics of {instants:,} instants by both methods"
    require_memory(name, instants, NUMBER_BYTES * numbers, "take {most} at the most, or --method none")
