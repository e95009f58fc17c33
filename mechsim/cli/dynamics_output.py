"""What `mechsim dynamics` prints: peaks, how a free run ended, what came of a tolerance, the verdict."""

from collections.abc import Iterator
from typing import Any

import typer

from mechsim.analytic.dynamics import InverseDynamics
from mechsim.cli.output import print_table
from mechsim.cli.output_units import SI_UNITS, OutputUnits
from mechsim.cli.verdict_text import print_verdict
from mechsim.model.force_record import Fluctuation, FreeRun
from mechsim.report.facts import run_facts, study_facts
from mechsim.simulation.dynamics.free_motion import SteppedFreeRun
from mechsim.simulation.result import Driven
from mechsim.verdict.checks import Verdict

Row = tuple[str, str, str, str, str]


def print_study(
    name: str,
    study: InverseDynamics,
    turn: Fluctuation | None,
    even: Fluctuation | None,
    shown: OutputUnits | None = None,
) -> None:
    """Print peaks of torque, reactions and shaking forces, and the speed fluctuation where there is one."""
    timed = bool(study.efforts.drives)
    at = (shown or SI_UNITS).label("at", "s" if timed else "rad")
    head = ("quantity", "largest", at, "unit", "")
    what = "prescribed drivers" if timed else "prescribed crank"
    print_table(f"{name}: {what}", head, _rows(study, turn, even, shown or SI_UNITS))


def print_free(name: str, run: FreeRun) -> None:
    """Print how a free run ended."""
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
    result = "satisfied" if told["satisfied"] else "FAILED"
    typer.echo(
        f"tolerance {told['tolerance']:.3g} {told['of']} {result}: error {told['estimate']:.2g}, "
        f"a margin of {told['margin']:.3g}{reason}"
    )
    if told["settings"]:
        used = told["settings"]
        typer.echo(
            f"{used['integrator']}, {used['steps_per_turn']} steps a turn of {used['timestep']:.4g} s, "
            f"compliance {used['compliance']:.0e}: {told['steps']} steps, {told['trials']} more on trials; "
            f"{told['by']}"
        )


def driven_promise(run: Driven | None) -> dict[str, Any] | None:
    """Return what came of the tolerance of a prescribed run as plain data; None where none was given."""
    if run is None or run.tolerance_report is None:
        return None
    one = run.tolerance_report
    found = {name: one.estimates.get(name, 0.0) for name in ("torque", "reactions", "halving", "balance")}
    names = {"torque": "torque", "reactions": "reactions", "halving": "halved steps"}
    parts = ", ".join(f"{words} {found[name]:.1e}" for name, words in names.items())
    return _promise(run, one) | {
        "of": "of torque and reactions",
        "by": f"by solved poses {parts}" if run.method == "step" else f"balance {found['balance']:.1e}",
        **found,
    }


def free_promise(run: SteppedFreeRun | None) -> dict[str, Any] | None:
    """Return what came of the tolerance of a free run as plain data; None where none was given."""
    if run is None or run.tolerance_report is None:
        return None
    return _promise(run, run.tolerance_report) | {"of": "rad of the crank", "by": "by halved steps"}


def _promise(run: Any, one: Any) -> dict[str, Any]:
    used = None if run.settings is None else run.settings.as_dict() | {"timestep": run.timestep}
    return {
        "tolerance": one.tolerance,
        "satisfied": one.satisfied,
        "estimate": one.estimate,
        "margin": one.margin,
        "order": one.order,
        "trials": one.trials,
        "reason": one.reason,
        "steps": run.steps,
        "settings": used,
    }


def verdict_facts(verdict: Verdict | None, method: str) -> dict[str, Any]:
    """Return a verdict as plain data."""
    if verdict is None:
        return {"passed": None, "outcome": None, "method": "none", "checks": []}
    checks = [check.as_dict() for check in verdict.checks]
    told: dict[str, Any] = {"passed": verdict.passed, "outcome": verdict.outcome}
    return told | {"method": method, "checks": checks}


def print_judged(verdict: Verdict | None) -> None:
    """Print the verdict on formulas and MuJoCo, or that there is none."""
    if verdict is None:
        typer.echo("MuJoCo was not asked")
    else:
        print_verdict("against MuJoCo", verdict, reasons=False)


def _left_open(reaction: dict[str, Any]) -> str:
    """Say which components of a reaction rigid links leave open, and of which they tell a part."""
    partly = reaction["partly_determined"]
    wholly = [name for name in reaction["not_determined"] if name not in partly]
    notes = [f"not determined: {', '.join(wholly)}"] if wholly else []
    return "; ".join(notes + ([f"a part of {', '.join(partly)} is"] if partly else []))


def _driving(facts: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield what the crank's drive, or each driver's, comes to."""
    if not facts["drives"]:
        yield "drive torque", facts["torque"] | {"unit": "N m"}
    for name, one in facts["drives"].items():
        yield f"drive of {name}", one


def _rows(
    study: InverseDynamics, turn: Fluctuation | None, even: Fluctuation | None, shown: OutputUnits
) -> list[Row]:
    facts = study_facts(study)

    def row(what: str, peak: dict[str, float], unit: str, note: str = "") -> Row:
        at = peak["at_time"] if "at_time" in peak else peak["at_angle"] / shown.converted("rad")[0]
        return what, f"{peak['largest']:.6g}", f"{at:.4f}", unit, note

    rows = [
        row(what, one, one["unit"], f"mean {one['mean']:.6g}, rms {one['rms']:.6g}")
        for what, one in _driving(facts)
    ]
    for name, one in facts["reactions"].items():
        note = _left_open(one)
        rows.append(row(f"force in {name} on {one['on']}", one["force"], "N", note))
        rows.append(row(f"moment in {name} on {one['on']}", one["moment"], "N m"))
    for name, one in facts["couplings"].items():
        what = "torque" if one["unit"] == "N m" else "force"
        left = "" if one["determined"] else "not determined; "
        if one["by"] == "teeth":
            note = f"{left}{what} {one['effort']['largest']:.6g} {one['unit']}"
            rows.append(row(f"teeth of {name} on {one['links'][0]}", one["force"], "N", note))
        elif one["by"] == "ideal transmission":
            note = f"{left}ideal transmission: acts in reverse on {', '.join(one['links'])}"
            rows.append(row(f"{what} of coupling {name}", one["effort"], one["unit"], note))
    rows.append(row("shaking force on the frame", facts["shaking_force"], "N"))
    rows.append(row("shaking moment about the origin", facts["shaking_moment"], "N m"))
    for one in (turn, even):
        if one is not None:
            note = f"constant torque {one.torque:.6g} N m, flywheel {one.flywheel:.6g} kg m2"
            rows.append(("speed fluctuation", f"{one.coefficient:.6g}", "", "1", note))
    return rows
