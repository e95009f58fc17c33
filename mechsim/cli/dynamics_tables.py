"""What `mechsim dynamics` prints: tables of a study and a verdict, lines of a promise, the same as JSON."""

from typing import TYPE_CHECKING, Any

import typer

from mechsim.cli.output import print_table

if TYPE_CHECKING:
    from mechsim.crosscheck import Verdict
    from mechsim.dynamics import Fluctuation, FreeRun, Study
    from mechsim.simulation import free
    from mechsim.simulation.dynamics import Driven

Row = tuple[str, str, str, str, str]


def print_study(name: str, study: "Study", turn: "Fluctuation | None", even: "Fluctuation | None") -> None:
    """Print peaks of torque, reactions and shaking forces, and the speed fluctuation where there is one."""
    head = ("quantity", "largest", "at [rad]", "unit", "")
    print_table(f"{name}: prescribed crank", head, _rows(study, turn, even))


def print_free(run: "FreeRun") -> None:
    """Print how a free run ended."""
    from mechsim.dynamics.facts import run_facts

    name, told = run.machine.mechanism.name, run_facts(run)
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
    parts = f"torque {one.torque:.1e}, reactions {one.reactions:.1e}, halved steps {one.halving:.1e}"
    return _promise(run, one) | {
        "of": "of torque and reactions",
        "by": f"by solved poses {parts}" if run.method == "step" else f"balance {one.balance:.1e}",
        "torque": one.torque,
        "reactions": one.reactions,
        "halving": one.halving,
        "balance": one.balance,
    }


def free_promise(run: "free.FreeRun | None") -> dict[str, Any] | None:
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
    from mechsim.crosscheck import HEAD

    if verdict is None:
        typer.echo("MuJoCo was not asked")
        return
    title = f"against MuJoCo: {verdict.outcome}" + (f" - {verdict.reason}" if verdict.reason else "")
    print_table(title, HEAD[:-1], [check.cells[:-1] for check in verdict.checks])


def _rows(study: "Study", turn: "Fluctuation | None", even: "Fluctuation | None") -> list[Row]:
    from mechsim.dynamics.facts import study_facts

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
