"""Forward dynamics, statics and vibrations of `mechsim dynamics`: from any initial state, drivers free."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import typer

from mechsim import files
from mechsim.analytic.dynamics import (
    DynamicRun,
    Equilibrium,
    Machine,
    Mode,
    equilibria,
    holding,
    nearest_equilibrium,
    response,
    run,
)
from mechsim.analytic.dynamics.dynamic_run import initial_values
from mechsim.analytic.dynamics.statics import STARTS
from mechsim.cli.dynamics_output import print_judged
from mechsim.cli.load_options import MachineOptions
from mechsim.cli.options import DriveOptions, form_of, pair_of, writable
from mechsim.cli.output import print_json, print_table
from mechsim.errors import InputError
from mechsim.studies.dynamics_check import crosscheck_forward
from mechsim.units import option
from mechsim.verdict.checks import Verdict

# frequencies of a response, from a tenth of the lowest to ten times the highest natural frequency
FREQUENCIES = 200
# an imaginary part of a mode shape below this fraction of its largest amplitude is rounding
REAL = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class ForwardOptions:
    """A run from an initial state, equilibria, modes of vibration, or a frequency response."""

    initial: tuple[tuple[str, str], ...] = option(
        (),
        "Initial coordinate J.q or rate J.v of a joint; the drivers are free, and the run lasts --duration.",
        read=pair_of("--initial crank.q=10deg"),
        many=True,
        metavar="J.q=VALUE",
    )
    until: str | None = option(
        None, "Event that ends the run, as P.y=0 or J.q=90deg.", metavar="QUANTITY=VALUE"
    )
    restitution: float = option(0.0, "Coefficient of restitution at the limits of joints, 0 to 1.")
    statics: bool = option(False, "List the equilibria; with --initial also what holds that configuration.")
    modes: bool = option(False, "Natural frequencies, damping ratios and mode shapes about the equilibrium.")
    response: str | None = option(
        None,
        "Frequency response from a unit load in joint J or on a point's P.x to such a quantity.",
        metavar="LOAD:QUANTITY",
    )

    @property
    def requested(self) -> bool:
        """Whether any of them is asked for."""
        return bool(self.initial or self.until or self.statics or self.modes or self.response)


def forward_dynamics(
    model: str,
    loads: MachineOptions,
    forward: ForwardOptions,
    driven: DriveOptions,
    sets: list[str] | None,
    samples: int,
    method: str | None,
    csv: str | None,
    as_json: bool,
) -> bool:
    """Run, print and return whether all went well."""
    if csv is not None:
        writable(csv, ".csv", ".npz")
    form = form_of(model, sets, replace(driven, duration=None), still=True)
    machine = loads.machine(form)
    initial = dict(forward.initial)
    if forward.statics:
        return _statics(machine, initial, as_json)
    if forward.modes:
        return _modes(machine, initial, as_json)
    if forward.response is not None:
        return _response(machine, forward.response, initial, csv, as_json)
    duration = 1.0 if driven.duration is None else driven.duration
    result = run(
        machine,
        initial=initial,
        duration=duration,
        until=forward.until,
        samples=samples,
        restitution=forward.restitution,
    )
    verdict = _verdict(machine, result, initial, method)
    if csv is not None:
        files.write(csv, result.motion)
    _print_run(machine, result, verdict, as_json)
    return result.outcome in ("done", "stopped") and (verdict is None or verdict.passed)


def _verdict(
    machine: Machine, result: DynamicRun, initial: Mapping[str, str], method: str | None
) -> Verdict | None:
    """Return the comparison with MuJoCo; None where it is left out."""
    if method == "none" or result.events or result.outcome not in ("done", "stopped"):
        return None
    return crosscheck_forward(result, machine, initial_values(machine.mechanism, initial))


def _print_run(machine: Machine, result: DynamicRun, verdict: Verdict | None, as_json: bool) -> None:
    name = machine.mechanism.name
    if as_json:
        facts: dict[str, Any] = {
            "mechanism": name,
            "outcome": result.outcome,
            "reason": result.reason,
            "duration": float(result.time[-1]),
            "energy_error": result.energy_error,
            "work": float(result.work[-1]),
            "lost": float(result.lost[-1]),
            "events": list(result.events),
            "steps": result.steps,
            "final": _final(result),
        }
        if verdict is not None:
            facts |= {"passed": verdict.passed, "checks": [check.as_dict() for check in verdict.checks]}
        print_json(facts)
        return
    end = f": {result.reason}" if result.reason else ""
    typer.echo(f"{name}: {result.outcome} at {result.time[-1]:.6g} s{end}")
    typer.echo(
        f"energy balance to {result.energy_error:.1e}, work {result.work[-1]:.4g} J, "
        f"lost {result.lost[-1]:.4g} J, {result.steps} steps"
    )
    rows = []
    for joint, motion in result.motion.joints.items():
        unit = motion.unit
        rows.append(
            (joint, *(f"{value:.6g}" for value in _extent(motion.value)), unit, f"{motion.rate[-1]:.6g}")
        )
    print_table("coordinates", ("joint", "least", "largest", "at the end", "unit", "rate at the end"), rows)
    if verdict is not None:
        print_judged(verdict)
    elif result.events:
        typer.echo("not compared with MuJoCo: its contacts and dry friction are soft at impacts and sticking")


def _extent(values: Any) -> tuple[float, float, float]:
    return float(values.min()), float(values.max()), float(values[-1])


def _final(result: DynamicRun) -> dict[str, float]:
    """Return the coordinates and rates at the end."""
    final: dict[str, float] = {}
    for name, joint in result.motion.joints.items():
        final |= {f"{name}.q": float(joint.value[-1]), f"{name}.v": float(joint.rate[-1])}
    return final


def _statics(machine: Machine, initial: Mapping[str, str], as_json: bool) -> bool:
    solutions = equilibria(machine, initial=initial)
    efforts = holding(machine, initial=initial) if initial else {}
    if as_json:
        print_json(
            {
                "mechanism": machine.mechanism.name,
                "equilibria": [_equilibrium_facts(equilibrium) for equilibrium in solutions],
                "holding": efforts,
            }
        )
        return True
    name = machine.mechanism.name
    drivers = machine.mechanism.drivers or tuple(solutions[0].q)[:1] if solutions else ()
    rows = [
        (
            ", ".join(f"{driver} {equilibrium.q[driver]:.6g}" for driver in drivers),
            "yes" if equilibrium.stable else "no",
            f"{equilibrium.potential:.4g}",
            ", ".join(f"{mode.frequency:.4g}" for mode in equilibrium.modes) if equilibrium.stable else "",
        )
        for equilibrium in solutions
    ]
    title = f"{name}: {len(solutions)} equilibria found from {STARTS + 1} configurations of this assembly"
    print_table(title, ("at [rad, m]", "stable", "potential [J]", "frequencies [Hz]"), rows)
    for driver, effort in efforts.items():
        unit = "N" if machine.mechanism.unit(driver) == "m" else "N m"
        typer.echo(f"{effort:.6g} {unit} in {driver} hold the initial configuration")
    return True


def _equilibrium_facts(equilibrium: Equilibrium) -> dict[str, Any]:
    return {
        "q": dict(equilibrium.q),
        "stable": equilibrium.stable,
        "potential": equilibrium.potential,
        "modes": [_mode_facts(mode) for mode in equilibrium.modes],
    }


def _mode_facts(mode: Mode) -> dict[str, Any]:
    """Return a mode as plain data; amplitudes that are in phase or opposed are real numbers."""
    largest = max((abs(value) for value in mode.shape.values()), default=0.0)
    real = all(abs(value.imag) <= REAL * largest for value in mode.shape.values())
    shape = {name: value.real if real else [value.real, value.imag] for name, value in mode.shape.items()}
    return {"frequency": mode.frequency, "damping_ratio": mode.damping_ratio, "shape": shape}


def _modes(machine: Machine, initial: Mapping[str, str], as_json: bool) -> bool:
    equilibrium = nearest_equilibrium(machine, initial=initial)
    if as_json:
        print_json({"mechanism": machine.mechanism.name, **_equilibrium_facts(equilibrium)})
        return equilibrium.stable
    rows = []
    for mode in equilibrium.modes:
        shape = sorted(mode.shape.items(), key=lambda item: -abs(item[1]))[:4]
        amplitudes = ", ".join(f"{name} {value.real:+.3g}" for name, value in shape)
        rows.append((f"{mode.frequency:.6g}", f"{mode.damping_ratio + 0.0:.4g}", amplitudes))
    state = "stable" if equilibrium.stable else "unstable"
    title = f"{machine.mechanism.name}: modes about a {state} equilibrium"
    print_table(title, ("frequency [Hz]", "damping ratio", "shape"), rows)
    return equilibrium.stable


def _response(
    machine: Machine, text: str, initial: Mapping[str, str], csv: str | None, as_json: bool
) -> bool:
    load, colon, quantity = text.partition(":")
    if not colon:
        raise InputError(f"--response is {text!r}; give LOAD:QUANTITY, as in crank:P.x")
    modes = nearest_equilibrium(machine, initial=initial).modes
    natural = [mode.frequency for mode in modes if mode.frequency > 0.0] or [1.0]
    frequencies = np.geomspace(0.1 * min(natural), 10.0 * max(natural), FREQUENCIES)
    values = response(machine, load, quantity, frequencies, initial=initial)
    table = {"frequency": frequencies, "magnitude": np.abs(values), "phase": np.angle(values)}
    if csv is not None:
        files.write_table(csv, table)
    if as_json:
        print_json(
            {"mechanism": machine.mechanism.name, "response": {k: v.tolist() for k, v in table.items()}}
        )
        return True
    peak = int(np.argmax(np.abs(values)))
    typer.echo(
        f"{machine.mechanism.name}: from a unit load {load} to {quantity}: {abs(values[0]):.4g} at "
        f"{frequencies[0]:.4g} Hz, largest {abs(values[peak]):.4g} at {frequencies[peak]:.4g} Hz"
    )
    return True
