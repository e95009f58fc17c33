"""Command `mechsim dynamics`: drive torque, joint reactions, energy, speed fluctuation, free running."""

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim.cli.force_options import Given, forces_of
from mechsim.cli.options import Json, Name, Sets, Speed, drive_of, speed_of, writable
from mechsim.cli.output import print_json, print_table

if TYPE_CHECKING:
    from mechsim.analytic.dynamics import InverseDynamics, Machine
    from mechsim.model.efforts import Fluctuation, FreeRun
    from mechsim.simulation import CrankProfile
    from mechsim.simulation.dynamics.free_running import SteppedFreeRun
    from mechsim.simulation.dynamics.prescribed_motion import Driven
    from mechsim.verdict.judge import Verdict


@dataclass(frozen=True, slots=True)
class DynamicsAsked:
    """What is wanted of a machine besides its description.

    Attributes:
        turns: of the crank, negative backwards.
        samples: instants recorded after the first.
        method: of MuJoCo: "pose", "step" or "none".
        tolerance: of torque and reactions, or of a free crank in [rad]; None is none.
        csv: file for all columns.
        plot: file for a sheet of plots.
        as_json: whether to print JSON alone.
    """

    turns: float
    samples: int
    method: str
    tolerance: float | None
    csv: str | None
    plot: str | None
    as_json: bool


def dynamics(
    name: Name,
    speed: Speed = "600rpm",
    gravity: Annotated[str, typer.Option(help="Three numbers in m/s2, with commas.")] = "0,-9.81,0",
    load: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Loads: angle [rad] or time [s], POINT.fx.. [N], LINK.mx.., crank [N m]."
        ),
    ] = None,
    motor: Annotated[
        str | None,
        typer.Option(
            help="constant:N m, line:N m,no-load speed or dc:V,ohm,N m/A; the machine runs free from rest, "
            "with --free from --speed."
        ),
    ] = None,
    gear: Annotated[
        float | None, typer.Option(help="Turns of the motor per turn of the crank, by a gear between.")
    ] = None,
    free: Annotated[bool, typer.Option("--free", help="Let go of the crank at --speed.")] = False,
    friction: Annotated[
        list[str] | None, typer.Option(metavar="JOINT=VISCOUS,COULOMB", help="Friction in a joint, SI.")
    ] = None,
    spring: Annotated[
        list[str] | None,
        typer.Option(
            metavar="A:B=STIFFNESS,REST",
            help="A spring between points, or places LINK@X,Y,Z; JOINT=STIFFNESS,REST in a joint. SI.",
        ),
    ] = None,
    damper: Annotated[
        list[str] | None,
        typer.Option(metavar="A:B=DAMPING", help="A damper, likewise between points or in a joint. SI."),
    ] = None,
    flywheel: Annotated[float, typer.Option(help="Moment of inertia on the crank, kg m2.")] = 0.0,
    coefficient: Annotated[
        float | None, typer.Option(help="Speed fluctuation wanted; answers with the flywheel.")
    ] = None,
    density: Annotated[float, typer.Option(help="Of links, which are round rods, kg/m3.")] = 7850.0,
    diameter: Annotated[str | None, typer.Option(help="Of those rods; 0.05 of the size if left out.")] = None,
    turns: Annotated[float, typer.Option(help="Turns of the crank.")] = 1.0,
    samples: Annotated[int, typer.Option(help="Instants in a turn.")] = 360,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Largest error of torque and reactions at any instant, as a part of their root mean square; "
            "of a free crank in rad. MuJoCo's steps are chosen to keep it."
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            help="MuJoCo by pose or step; none leaves it out. If not given pose, with --tolerance step. "
            "A free run is stepped."
        ),
    ] = None,
    csv: Annotated[str | None, typer.Option(metavar="FILE", help="Write all columns: .csv or .npz.")] = None,
    plot: Annotated[
        str | None, typer.Option(metavar="FILE", help="Draw everything on a sheet: .svg, .pdf, .png.")
    ] = None,
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Drive torque, joint reactions and energy of a prescribed crank; free running under a motor."""
    from mechsim import units
    from mechsim.analytic import dynamics as road
    from mechsim.errors import InputError

    if method not in (None, "pose", "step", "none"):
        raise InputError(f"there is no method {method!r}; known are pose, step, none")
    if tolerance is not None and method == "none":
        raise InputError("--tolerance is kept by MuJoCo's runs, and --method none leaves them out; drop one")
    if not (0.0 < abs(turns) < 1e4 and 1 <= samples <= 100_000):
        raise InputError(
            f"{turns:g} turns of {samples} instants; give turns other than 0 and 1 to 100000 instants"
        )
    for path in (csv, plot):
        if path is not None:
            writable(path, *((".csv", ".npz") if path == csv else (".svg", ".pdf", ".png")))
    drive, fast = drive_of(name, sets), speed_of(speed)
    given = Given(
        gravity=gravity,
        load=load,
        motor=motor,
        gear=gear,
        friction=friction or (),
        spring=spring or (),
        damper=damper or (),
        flywheel=flywheel,
    )
    acting = forces_of(drive, given)
    thick = None if diameter is None else units.parse_length(diameter, "the diameter of the rods")
    machine = road.machine(drive, acting, density=density, diameter=thick)
    chosen = method or ("pose" if tolerance is None else "step")
    count = max(1, round(samples * abs(turns)))
    asked = DynamicsAsked(turns, count, chosen, tolerance, csv, plot, as_json)
    if motor is not None or free:
        passed = _free(machine, fast if free else 0.0, asked)
    else:
        passed = _driven(machine, fast, coefficient, asked)
    raise typer.Exit(0 if passed else 1)


def _driven(machine: "Machine", speed: float, coefficient: float | None, asked: DynamicsAsked) -> bool:
    import numpy as np

    from mechsim.analytic.dynamics import fluctuation, flywheel_for, prescribed
    from mechsim.errors import InputError
    from mechsim.model.crank_profile import within_range
    from mechsim.report.facts import study_facts, turn_facts

    drive = machine.drive
    assert drive is not None
    profile = within_range(drive, speed if asked.turns > 0 else -speed, abs(asked.turns))
    time = np.linspace(0.0, profile.duration, asked.samples + 1)
    study = prescribed(machine, *profile.state(time), time=time)
    full = drive.crank_range().full
    turn = None
    if full:
        # too slow for its springs or weight, the crank has no steady turn under a constant torque
        with suppress(InputError):
            turn = fluctuation(machine, speed)
    even = flywheel_for(machine, speed, coefficient) if full and coefficient is not None else None
    found, verdict = _simulated(machine, profile, asked)
    _write(asked.csv, study)
    if asked.plot is not None:
        from mechsim.pictures import plots
        from mechsim.pictures.plots import dynamics as drawn

        rings = None if found is None else (found.motion.angle, found.efforts.torque)
        plots.write(asked.plot, drawn.dynamics_sheet(study, turn, even, rings))
    promise = driven_promise(found)
    if asked.as_json:
        told: dict[str, Any] = {"mechanism": machine.mechanism.name, **study_facts(study)}
        told |= {"fluctuation": turn_facts(turn), "with_flywheel": turn_facts(even), "promise": promise}
        print_json(told | verdict_facts(verdict, asked.method))
    else:
        print_study(machine.mechanism.name, study, turn, even)
        print_verdict(verdict)
        print_promise(promise)
    return (verdict is None or verdict.passed) and (promise is None or promise["met"])


def _simulated(
    machine: "Machine", profile: "CrankProfile", asked: DynamicsAsked
) -> "tuple[Driven | None, Verdict | None]":
    if asked.method == "none":
        return None, None
    from mechsim.simulation.dynamics.prescribed_motion import driven
    from mechsim.verdict.dynamics import crosscheck_driven

    found = driven(
        machine.mechanism,
        machine.forces,
        profile=profile,
        method=asked.method,  # pyright: ignore[reportArgumentType]
        tolerance=asked.tolerance,
        # with a tolerance as many instants as go with the fewest steps that keep it
        samples=asked.samples if asked.tolerance is None else None,
    )
    return found, crosscheck_driven(found, machine)


def _free(machine: "Machine", speed: float, asked: DynamicsAsked) -> bool:
    from mechsim.analytic.dynamics import free_run
    from mechsim.report.facts import run_facts

    run = free_run(machine, speed=speed, turns=asked.turns, samples=asked.samples + 1)
    found, verdict = None, None
    if asked.method != "none" and run.outcome == "done":
        found, verdict = _stepped(machine, speed, asked)
    _write(asked.csv, run)
    if asked.plot is not None:
        from mechsim.pictures import plots
        from mechsim.pictures.plots import dynamics as drawn

        plots.write(asked.plot, drawn.free_plot(run))
    promise = free_promise(found)
    if asked.as_json:
        told = {"mechanism": machine.mechanism.name, "free": run_facts(run), "promise": promise}
        print_json(told | verdict_facts(verdict, "step"))
    else:
        print_free(machine.mechanism.name, run)
        print_verdict(verdict)
        print_promise(promise)
    kept = promise is None or promise["met"]
    return run.outcome == "done" and (verdict is None or verdict.passed) and kept


def _stepped(machine: "Machine", speed: float, asked: DynamicsAsked) -> "tuple[SteppedFreeRun, Verdict]":
    from mechsim.simulation.dynamics.free_running import free_run
    from mechsim.verdict.dynamics import crosscheck_free

    found = free_run(
        machine.mechanism,
        machine.forces,
        speed=speed,
        turns=asked.turns,
        tolerance=asked.tolerance,
        samples=asked.samples,
    )
    return found, crosscheck_free(found, machine)


def _write(csv: str | None, columns: "InverseDynamics | FreeRun") -> None:
    if csv is not None:
        from mechsim import files

        files.write(csv, columns)  # pyright: ignore[reportArgumentType]


Row = tuple[str, str, str, str, str]


def print_study(
    name: str, study: "InverseDynamics", turn: "Fluctuation | None", even: "Fluctuation | None"
) -> None:
    """Print peaks of torque, reactions and shaking forces, and the speed fluctuation where there is one."""
    head = ("quantity", "largest", "at [rad]", "unit", "")
    print_table(f"{name}: prescribed crank", head, _rows(study, turn, even))


def print_free(name: str, run: "FreeRun") -> None:
    """Print how a free run ended."""
    from mechsim.report.facts import run_facts

    told = run_facts(run)
    begun = f"{run.speed[0]:.6g}" if run.speed[0] else "rest"
    typer.echo(f"{name}: {run.outcome}" + (f": {run.reason}" if run.reason else ""))
    typer.echo(
        f"{told['turns']:.6g} turns in {told['seconds']:.6g} s, from {begun} to {told['speed']:.6g} rad/s; "
        f"work {told['work']:.6g} J, lost {told['lost']:.6g} J, energy balance to {told['energy_error']:.1e}"
    )


def print_promise(told: dict[str, Any] | None) -> None:
    """Print what came of a tolerance, if one was given."""
    if told is None:
        return
    reason = f": {told['reason']}" if told["reason"] else ""
    kept = "kept" if told["met"] else "MISSED"
    typer.echo(
        f"tolerance {told['tolerance']:.3g} {told['of']} {kept} by {told['estimate']:.2g}, "
        f"a margin of {told['margin']:.3g}{reason}"
    )
    if told["settings"]:
        used = told["settings"]
        typer.echo(
            f"{used['integrator']}, {used['steps_per_turn']} steps a turn of {used['timestep']:.4g} s, "
            f"hardness {used['hardness']:.0e}: {told['steps']} steps, {told['trials']} more on trials; "
            f"{told['by']}"
        )


def driven_promise(run: "Driven | None") -> dict[str, Any] | None:
    """Return what came of the tolerance of a prescribed run as plain data; None where none was given."""
    if run is None or run.promise is None:
        return None
    one = run.promise
    found = {name: one.estimates.get(name, 0.0) for name in ("torque", "reactions", "halving", "balance")}
    names = {"torque": "torque", "reactions": "reactions", "halving": "halved steps"}
    parts = ", ".join(f"{words} {found[name]:.1e}" for name, words in names.items())
    return _promise(run, one) | {
        "of": "of torque and reactions",
        "by": f"by solved poses {parts}" if run.method == "step" else f"balance {found['balance']:.1e}",
        **found,
    }


def free_promise(run: "SteppedFreeRun | None") -> dict[str, Any] | None:
    """Return what came of the tolerance of a free run as plain data; None where none was given."""
    if run is None or run.promise is None:
        return None
    return _promise(run, run.promise) | {"of": "rad of the crank", "by": "by halved steps"}


def _promise(run: Any, one: Any) -> dict[str, Any]:
    used = None if run.settings is None else run.settings.as_dict() | {"timestep": run.timestep}
    return {
        "tolerance": one.tolerance,
        "met": one.met,
        "estimate": one.estimate,
        "margin": one.margin,
        "order": one.order,
        "trials": one.trials,
        "reason": one.reason,
        "steps": run.steps,
        "settings": used,
    }


def verdict_facts(verdict: "Verdict | None", method: str) -> dict[str, Any]:
    """Return a verdict as plain data."""
    if verdict is None:
        return {"passed": None, "outcome": None, "method": "none", "checks": []}
    checks = [check.as_dict() for check in verdict.checks]
    told: dict[str, Any] = {"passed": verdict.passed, "outcome": verdict.outcome}
    return told | {"method": method, "checks": checks}


def print_verdict(verdict: "Verdict | None") -> None:
    """Print a verdict check by check."""
    from mechsim.verdict.judge import HEAD

    if verdict is None:
        typer.echo("MuJoCo was not asked")
        return
    title = f"against MuJoCo: {verdict.outcome}" + (f" - {verdict.reason}" if verdict.reason else "")
    print_table(title, HEAD[:-1], [check.cells[:-1] for check in verdict.checks])


def _rows(study: "InverseDynamics", turn: "Fluctuation | None", even: "Fluctuation | None") -> list[Row]:
    from mechsim.report.facts import study_facts

    facts = study_facts(study)

    def row(what: str, peak: dict[str, float], unit: str, note: str = "") -> Row:
        return what, f"{peak['largest']:.6g}", f"{peak['at_angle']:.4f}", unit, note

    torque = facts["torque"]
    rows = [row("drive torque", torque, "N m", f"mean {torque['mean']:.6g}, rms {torque['rms']:.6g}")]
    for name, one in facts["reactions"].items():
        left = ", ".join(one["not_determined"])
        note = f"not determined: {left}" if left else ""
        rows.append(row(f"force in {name} on {one['on']}", one["force"], "N", note))
        rows.append(row(f"moment in {name} on {one['on']}", one["moment"], "N m"))
    rows.append(row("shaking force on the frame", facts["shaking_force"], "N"))
    rows.append(row("shaking moment about the origin", facts["shaking_moment"], "N m"))
    for one in (turn, even):
        if one is not None:
            note = f"constant torque {one.torque:.6g} N m, flywheel {one.flywheel:.6g} kg m2"
            rows.append(("speed fluctuation", f"{one.coefficient:.6g}", "", "1", note))
    return rows
