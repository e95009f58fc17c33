"""Command `mechsim dynamics`: drive torque, joint reactions, energy, speed fluctuation, free running."""

from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim.cli.forces import forces_of
from mechsim.cli.options import Json, Name, Sets, Speed, drive_of, speed_of, writable
from mechsim.cli.output import print_json, print_table

if TYPE_CHECKING:
    from mechsim.crosscheck import Verdict
    from mechsim.dynamics import Fluctuation, FreeRun, Machine, Study
    from mechsim.simulation import Profile
    from mechsim.simulation.dynamics import Driven

Row = tuple[str, str, str, str, str]


def dynamics(
    name: Name,
    speed: Speed = "600rpm",
    gravity: Annotated[str, typer.Option(help="Three numbers in m/s2, with commas.")] = "0,-9.81,0",
    load: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Loads: angle [rad] or time [s], POINT.fx.. [N], crank [N m]."),
    ] = None,
    motor: Annotated[
        str | None,
        typer.Option(help="constant:N m, line:N m,no-load speed or dc:V,ohm,N m/A; the machine runs free."),
    ] = None,
    friction: Annotated[
        list[str] | None, typer.Option(metavar="JOINT=VISCOUS,COULOMB", help="Friction in a joint, SI.")
    ] = None,
    flywheel: Annotated[float, typer.Option(help="Moment of inertia on the crank, kg m2.")] = 0.0,
    coefficient: Annotated[
        float | None, typer.Option(help="Speed fluctuation wanted; answers with the flywheel.")
    ] = None,
    density: Annotated[float, typer.Option(help="Of links, which are round rods, kg/m3.")] = 7850.0,
    diameter: Annotated[str | None, typer.Option(help="Of those rods; 0.05 of the size if left out.")] = None,
    turns: Annotated[float, typer.Option(help="Turns of the crank.")] = 1.0,
    samples: Annotated[int, typer.Option(help="Instants in a turn.")] = 360,
    method: Annotated[
        str, typer.Option(help="MuJoCo by pose or step; none leaves it out. A free run is stepped.")
    ] = "pose",
    csv: Annotated[str | None, typer.Option(metavar="FILE", help="Write all columns: .csv or .npz.")] = None,
    plot: Annotated[
        str | None, typer.Option(metavar="FILE", help="Draw everything on a sheet: .svg, .pdf, .png.")
    ] = None,
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Drive torque, joint reactions and energy of a prescribed crank; free running under a motor."""
    from mechsim import dynamics as road
    from mechsim import units
    from mechsim.errors import InputError

    if method not in ("pose", "step", "none"):
        raise InputError(f"there is no method {method!r}; known are pose, step, none")
    if not (0.0 < abs(turns) < 1e4 and 1 <= samples <= 100_000):
        raise InputError(
            f"{turns:g} turns of {samples} instants; give turns other than 0 and 1 to 100000 instants"
        )
    for path in (csv, plot):
        if path is not None:
            writable(path, *((".csv", ".npz") if path == csv else (".svg", ".pdf", ".png")))
    drive, asked = drive_of(name, sets), speed_of(speed)
    acting = forces_of(drive, gravity, load, motor, friction or (), flywheel)
    thick = None if diameter is None else units.parse_length(diameter, "the diameter of the rods")
    machine = road.machine(drive, acting, density=density, diameter=thick)
    if motor is not None:
        passed = _free(machine, turns, max(2, round(samples * abs(turns)) + 1), method, csv, plot, as_json)
    else:
        from mechsim.validate import crank_profile

        profile = crank_profile(drive, asked if turns > 0 else -asked, abs(turns))
        count = max(1, round(samples * abs(turns)))
        passed = _driven(machine, profile, asked, count, coefficient, method, csv, plot, as_json)
    raise typer.Exit(0 if passed else 1)


def _driven(
    machine: "Machine",
    profile: "Profile",
    speed: float,
    count: int,
    coefficient: float | None,
    method: str,
    csv: str | None,
    plot: str | None,
    as_json: bool,
) -> bool:
    import numpy as np

    from mechsim.dynamics import fluctuation, flywheel_for, prescribed
    from mechsim.dynamics.facts import study_facts, turn_facts

    time = np.linspace(0.0, profile.duration, count + 1)
    study = prescribed(machine, *profile.state(time), time=time)
    assert machine.drive is not None
    full = machine.drive.crank_range().full
    turn = fluctuation(machine, speed) if full else None
    even = flywheel_for(machine, speed, coefficient) if full and coefficient is not None else None
    found, verdict = _simulated(machine, profile, count, method)
    _write(csv, study)
    if plot is not None:
        from mechsim import plots
        from mechsim.plots import dynamics as drawn

        rings = None if found is None else (found.motion.angle, found.efforts.torque)
        form = plots.form_of(plot)
        plots.write(plot, drawn.dynamics_sheet(study, turn, even, rings, form=form))
    if as_json:
        told: dict[str, Any] = {"mechanism": machine.mechanism.name, **study_facts(study)}
        told |= {"fluctuation": turn_facts(turn), "with_flywheel": turn_facts(even)}
        print_json(told | _verdict_facts(verdict, method))
    else:
        head = ("quantity", "largest", "at [rad]", "unit", "")
        print_table(f"{machine.mechanism.name}: prescribed crank", head, _rows(study, turn, even))
        _print_verdict(verdict)
    return verdict is None or verdict.passed


def _free(
    machine: "Machine",
    turns: float,
    samples: int,
    method: str,
    csv: str | None,
    plot: str | None,
    as_json: bool,
) -> bool:
    from mechsim.dynamics import free_run
    from mechsim.dynamics.facts import run_facts

    run = free_run(machine, turns=turns, samples=samples)
    verdict = None
    if method != "none" and run.outcome == "done":
        from mechsim import simulation
        from mechsim.crosscheck_dynamics import crosscheck_free
        from mechsim.simulation.free import free_run as stepped

        found = stepped(
            machine.mechanism,
            machine.forces,
            turns=turns,
            samples=samples - 1,
            settings=simulation.Settings(),
        )
        verdict = crosscheck_free(found, machine)
    _write(csv, run)
    if plot is not None:
        from mechsim import plots
        from mechsim.plots import dynamics as drawn

        plots.write(plot, drawn.free_plot(run, form=plots.form_of(plot)))
    if as_json:
        told = {"mechanism": machine.mechanism.name, "free": run_facts(run)}
        print_json(told | _verdict_facts(verdict, "step"))
    else:
        typer.echo(f"{machine.mechanism.name}: {run.outcome}" + (f": {run.reason}" if run.reason else ""))
        told = run_facts(run)
        typer.echo(
            f"{told['turns']:.6g} turns in {told['seconds']:.6g} s, at {told['speed']:.6g} rad/s; work "
            f"{told['work']:.6g} J, lost {told['lost']:.6g} J, energy balance to {told['energy_error']:.1e}"
        )
        _print_verdict(verdict)
    return run.outcome == "done" and (verdict is None or verdict.passed)


def _simulated(
    machine: "Machine", profile: "Profile", count: int, method: str
) -> "tuple[Driven | None, Verdict | None]":
    if method == "none":
        return None, None
    from mechsim.crosscheck_dynamics import crosscheck_driven
    from mechsim.simulation.dynamics import driven

    found = driven(
        machine.mechanism,
        machine.forces,
        profile=profile,
        method=method,  # pyright: ignore[reportArgumentType]
        samples=count,
    )
    return found, crosscheck_driven(found, machine)


def _write(csv: str | None, columns: "Study | FreeRun") -> None:
    if csv is not None:
        from mechsim import tables

        tables.write(csv, columns)  # pyright: ignore[reportArgumentType]


def _verdict_facts(verdict: "Verdict | None", method: str) -> dict[str, Any]:
    if verdict is None:
        return {"passed": None, "outcome": None, "method": "none", "checks": []}
    checks = [check.as_dict() for check in verdict.checks]
    told: dict[str, Any] = {"passed": verdict.passed, "outcome": verdict.outcome}
    return told | {"method": method, "checks": checks}


def _rows(study: "Study", turn: "Fluctuation | None", even: "Fluctuation | None") -> list[Row]:
    from mechsim.dynamics.facts import study_facts

    facts = study_facts(study)

    def row(what: str, peak: dict[str, float], unit: str, note: str = "") -> Row:
        return what, f"{peak['largest']:.6g}", f"{peak['at_angle']:.4f}", unit, note

    torque = facts["torque"]
    rows = [row("drive torque", torque, "N m", f"mean {torque['mean']:.6g}, rms {torque['rms']:.6g}")]
    for name, one in facts["reactions"].items():
        left = ", ".join(one["not_determined"])
        rows.append(
            row(
                f"force in {name} on {one['on']}",
                one["force"],
                "N",
                f"not determined: {left}" if left else "",
            )
        )
        rows.append(row(f"moment in {name} on {one['on']}", one["moment"], "N m"))
    rows.append(row("shaking force on the frame", facts["shaking_force"], "N"))
    rows.append(row("shaking moment about the origin", facts["shaking_moment"], "N m"))
    for one in (turn, even):
        if one is not None:
            note = f"constant torque {one.torque:.6g} N m, flywheel {one.flywheel:.6g} kg m2"
            rows.append(("speed fluctuation", f"{one.coefficient:.6g}", "", "1", note))
    return rows


def _print_verdict(verdict: "Verdict | None") -> None:
    if verdict is None:
        typer.echo("MuJoCo was not asked")
        return
    rows = [
        (
            check.quantity,
            f"{check.worst:.2e}",
            f"{check.at_angle:.4f}",
            f"{check.bound:.1e}",
            check.unit,
            "met" if check.passed else "MISSED",
        )
        for check in verdict.checks
    ]
    title = f"against MuJoCo: {verdict.outcome}" + (f" - {verdict.reason}" if verdict.reason else "")
    print_table(title, ("quantity", "worst", "at [rad]", "bound", "unit", ""), rows)
