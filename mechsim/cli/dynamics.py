"""Command `mechsim dynamics`: drive torque, joint reactions, energy, speed fluctuation, free running."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import typer

from mechsim import files
from mechsim.analytic.dynamics import (
    InverseDynamics,
    Machine,
    fluctuation,
    flywheel_for,
    free_run,
)
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.cli.declared_options import spread
from mechsim.cli.dynamics_output import (
    driven_promise,
    free_promise,
    print_free,
    print_judged,
    print_promise,
    print_study,
    verdict_facts,
)
from mechsim.cli.forward_dynamics import ForwardOptions, forward_dynamics
from mechsim.cli.load_options import MachineOptions, Verbose, print_masses
from mechsim.cli.options import DriveOptions, Json, Model, Sets, form_of, moving, speed_of, writable
from mechsim.cli.output import print_json
from mechsim.cli.output_units import Labelled, OutputUnits, Units, output_units
from mechsim.cli.progress import Tick, progress
from mechsim.errors import InputError
from mechsim.model.force_record import Fluctuation, FreeRun
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import LEAST_TURNS, CrankProfile, MotionLaws
from mechsim.numerics.resources import require_memory
from mechsim.pictures import plots
from mechsim.report.facts import run_facts, study_facts, turn_facts
from mechsim.simulation.dynamics import free_motion
from mechsim.simulation.dynamics.free_motion import SteppedFreeRun
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.result import Driven
from mechsim.simulation.stepping import Progress
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_free
from mechsim.studies.motion_source import profile_of
from mechsim.studies.quantities import quantity
from mechsim.units import option
from mechsim.verdict.checks import Verdict

# numbers told of an instant besides those of its joints; bytes of each while parts are put together
EFFORTS, HELD = 40.0, 16.0

# columns of efforts that say when, and how the crank moves
INSTANTS = {"time": "s", "angle": "rad", "speed": "rad/s", "acceleration": "rad/s2"}
# of free runs
INSTANTS |= {"motor": "N m", "work": "J", "lost": "J"}


@dataclass(frozen=True, slots=True, kw_only=True)
class DynamicsOptions:
    """How a machine is run, and what is told of it."""

    speed: float = option(20.0 * np.pi, "Crank speed; a bare number is rad/s.", read=speed_of, text="600rpm")
    free: bool = option(False, "Let go of the crank at --speed.", name="--free")
    coefficient: float | None = option(None, "Speed fluctuation wanted; answers with the flywheel.")
    turns: float = option(1.0, "Turns of the crank.")
    samples: int = option(360, "Instants in a turn.")
    tolerance: float | None = option(
        None,
        "Largest error of torque and reactions at any instant, as a part of their root mean square; "
        "of a free crank in rad. MuJoCo's steps are chosen to keep it.",
    )
    method: str | None = option(
        None,
        "MuJoCo by pose or step; none leaves it out. If not given pose, with --tolerance step. "
        "A free run is stepped.",
    )
    csv: str | None = option(None, "Write all columns: .csv or .npz.", metavar="FILE")
    plot: str | None = option(None, "Draw everything on a sheet: .svg, .pdf, .png.", metavar="FILE")

    def check(self) -> None:
        """Refuse what cannot be, before any work is done."""
        if self.method not in (None, "pose", "step", "none"):
            raise InputError(f"there is no method {self.method!r}; known are pose, step, none")
        if self.tolerance is not None and self.method == "none":
            raise InputError(
                "--tolerance is kept by MuJoCo's runs, and --method none leaves them out; drop one"
            )
        if not (LEAST_TURNS <= abs(self.turns) < 1e4 and 1 <= self.samples <= 100_000):
            raise InputError(
                f"{self.turns:g} turns of {self.samples} instants; "
                f"give turns other than 0, {LEAST_TURNS:g} at least, and 1 to 100000 instants"
            )
        if self.csv is not None:
            writable(self.csv, ".csv", ".npz")
        if self.plot is not None:
            writable(self.plot, ".svg", ".pdf", ".png")

    @property
    def road(self) -> str:
        """How MuJoCo goes: "pose", "step" or "none"."""
        return self.method or ("pose" if self.tolerance is None else "step")

    @property
    def instants(self) -> int:
        """How many are recorded after the first."""
        return max(1, round(self.samples * abs(self.turns)))


@spread
def dynamics(
    model: Model,
    acting: MachineOptions,
    asked: DynamicsOptions,
    forward: ForwardOptions,
    driven: DriveOptions,
    sets: Sets = None,
    verbose: Verbose = False,
    units: Units = None,
    as_json: Json = False,
) -> None:
    """What drives and joints carry as prescribed, and the energies; free running under a motor."""
    asked.check()
    if forward.requested:
        passed = forward_dynamics(
            model, acting, forward, driven, sets, asked.samples, asked.method, asked.csv, as_json
        )
        raise typer.Exit(0 if passed else 1)
    machine = acting.machine(moving(form_of(model, sets, driven)))
    shown = output_units(units, machine.drive)
    if _programs(machine) is not None and asked.free:
        raise InputError("--free lets a crank run free, and programs move the drivers; drop one of them")
    if machine.forces.motor is not None or asked.free:
        passed = _free(machine, asked.speed if asked.free else 0.0, asked, as_json, shown)
    else:
        passed = _driven(machine, asked, as_json, shown)
    if not as_json:
        print_masses(machine.masses, verbose)
    raise typer.Exit(0 if passed else 1)


def _programs(machine: Machine) -> MotionLaws | None:
    """Return the programs of a machine's drivers; None where a crank turns."""
    return machine.drive.motion_laws


def _driven(machine: Machine, asked: DynamicsOptions, as_json: bool, shown: OutputUnits | None) -> bool:
    profile = profile_of(machine.drive, asked.speed, asked.turns)
    machine = machine.starting_at(profile.angles)
    if asked.road != "none":
        _require_room(machine, asked.instants)
    time = np.linspace(0.0, profile.duration, asked.instants + 1)
    roads = ("formulas", "MuJoCo", "check") if asked.road != "none" else ("formulas",)
    with progress("dynamics", None) as tick:
        watches = iter(_sections(tick, roads))
        study = prescribed_along(machine, *profile.state(time), time=time, watch=next(watches))
        turn, even = _steady(machine, asked)
        found, verdict = _simulated(machine, profile, asked, *watches)
    _write(asked.csv, study, machine.mechanism, shown)
    if asked.plot is not None:
        plots.write(asked.plot, plots.dynamics_sheet(study, turn, even, found and found.efforts))
    promise = driven_promise(found)
    if as_json:
        told: dict[str, Any] = {"mechanism": machine.mechanism.name, **study_facts(study)}
        told["masses"] = [one.as_dict() for one in machine.masses]
        told |= {"fluctuation": turn_facts(turn), "with_flywheel": turn_facts(even), "promise": promise}
        told["note"] = "" if found is None else found.note
        print_json(told | verdict_facts(verdict, asked.road))
    else:
        print_study(machine.mechanism.name, study, turn, even, shown)
        print_judged(verdict)
        if found is not None and found.note:
            typer.echo(found.note)
        print_promise(promise)
    return (verdict is None or verdict.passed) and (promise is None or promise["satisfied"])


def _steady(machine: Machine, asked: DynamicsOptions) -> tuple[Fluctuation | None, Fluctuation | None]:
    """Return a turn under a constant torque, and one with the flywheel wanted; None where there is none."""
    if _programs(machine) is not None or not machine.drive.crank_range().full:
        return None, None
    turn = None
    # too slow for its springs or weight, the crank has no steady turn under a constant torque
    with suppress(InputError):
        turn = fluctuation(machine, asked.speed)
    wanted = asked.coefficient
    return turn, None if wanted is None else flywheel_for(machine, asked.speed, wanted)


def _require_room(machine: Machine, instants: int) -> None:
    """Refuse more instants than memory holds of both roads and of the check, before any work is done."""
    mechanism = machine.mechanism
    links, joints, points = len(mechanism.links), len(mechanism.joints), len(mechanism.points)
    numbers = 2.0 * (EFFORTS + 9.0 * joints) + 24.0 * links + 9.0 * points + 20.0 * joints
    what = f"the dynamics of {instants:,} instants on both roads"
    require_memory(what, instants, HELD * numbers, "take {most} at the most, or --method none")


def _sections(tick: Tick, names: Sequence[str]) -> list[Progress]:
    """Return what is told how far each of so many pieces of work has come, all of about one length."""

    def watch(i: int, name: str) -> Progress:
        return lambda done, part: tick(f"{name}, {done}", (i + part) / len(names))

    return [watch(i, name) for i, name in enumerate(names)]


def _simulated(
    machine: Machine, profile: CrankProfile, asked: DynamicsOptions, *watches: Progress
) -> tuple[Driven | None, Verdict | None]:
    if asked.road == "none":
        return None, None
    simulation, check = watches
    motion_laws = _programs(machine)
    found = driven(
        machine.mechanism,
        machine.forces,
        profile=None if motion_laws is not None else profile,
        motion_laws=motion_laws,
        method=asked.road,  # pyright: ignore[reportArgumentType]
        tolerance=asked.tolerance,
        # with a tolerance as many instants as go with the fewest steps that keep it
        samples=asked.instants if asked.tolerance is None else None,
        watch=simulation,
    )
    return found, crosscheck_driven(found, machine, progress=check)


def _free(
    machine: Machine, speed: float, asked: DynamicsOptions, as_json: bool, shown: OutputUnits | None
) -> bool:
    run = free_run(machine, speed=speed, turns=asked.turns, samples=asked.instants + 1)
    found, verdict = None, None
    if asked.road != "none" and run.outcome == "done":
        found, verdict = _stepped(machine, speed, asked)
    _write(asked.csv, run, machine.mechanism, shown)
    if asked.plot is not None:
        plots.write(asked.plot, plots.free_plot(run))
    promise = free_promise(found)
    if as_json:
        told: dict[str, Any] = {
            "mechanism": machine.mechanism.name,
            "free": run_facts(run),
            "promise": promise,
        }
        told["masses"] = [one.as_dict() for one in machine.masses]
        print_json(told | verdict_facts(verdict, "step"))
    else:
        print_free(machine.mechanism.name, run)
        print_judged(verdict)
        print_promise(promise)
    kept = promise is None or promise["satisfied"]
    return run.outcome == "done" and (verdict is None or verdict.passed) and kept


def _stepped(machine: Machine, speed: float, asked: DynamicsOptions) -> tuple[SteppedFreeRun, Verdict]:
    with progress("dynamics", None) as tick:
        found = free_motion.free_run(
            machine.mechanism,
            machine.forces,
            speed=speed,
            turns=asked.turns,
            tolerance=asked.tolerance,
            samples=asked.instants,
            watch=tick,
        )
    return found, crosscheck_free(found, machine)


def _write(
    csv: str | None, columns: InverseDynamics | FreeRun, mechanism: Mechanism, shown: OutputUnits | None
) -> None:
    if csv is None:
        return
    if shown is None:
        files.write(csv, columns)
        return
    units = {name: INSTANTS.get(name) or quantity(name, mechanism).unit for name, _ in columns.columns()}
    files.write(csv, Labelled(columns, units, shown))
