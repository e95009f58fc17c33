"""Forward dynamics, statics and vibrations of `mechsim dynamics`: from any initial state, drivers free."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim import files
from mechsim.analytic.dynamics import (
    DynamicModel,
    DynamicRun,
    Equilibrium,
    Mode,
    equilibria,
    holding,
    nearest_equilibrium,
    response,
    run,
)
from mechsim.analytic.dynamics.dynamic_run import initial_values
from mechsim.analytic.dynamics.statics import STARTS
from mechsim.cli.command import Result
from mechsim.cli.load_options import LoadOptions
from mechsim.cli.options import ModelOptions, pair_of
from mechsim.cli.output import number, print_table, print_text
from mechsim.cli.verdict_text import print_verdicts
from mechsim.errors import InputError
from mechsim.pictures import plots
from mechsim.studies.dynamics_check import crosscheck_forward
from mechsim.units import option
from mechsim.verdict.checks import Verdict

# frequencies of a response, from a tenth of the lowest to ten times the highest natural frequency
FREQUENCIES = 200
# an imaginary part of a mode shape below this fraction of its largest amplitude is rounding
REAL = 1e-6
# printed amplitudes of a mode shape, the largest first
MOST_AMPLITUDES = 4


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
    statics: bool = option(
        False, "List the equilibria; with --initial also what holds that configuration.", name="--statics"
    )
    modes: bool = option(
        False, "Natural frequencies, damping ratios and mode shapes about the equilibrium.", name="--modes"
    )
    response: str | None = option(
        None,
        "Frequency response from a unit load in joint J or on a point's P.x to such a quantity.",
        metavar="LOAD:QUANTITY",
    )

    @property
    def requested(self) -> bool:
        """Whether any of them is asked for."""
        return bool(self.initial or self.until or self.statics or self.modes or self.response)


@dataclass(frozen=True, slots=True)
class Output:
    """Instants of a run, MuJoCo's method, files to write, and whether all checks are listed."""

    samples: int
    method: str | None
    csv: str | None
    plot: str | None
    verbose: bool


def forward_dynamics(
    source: ModelOptions, loads: LoadOptions, forward: ForwardOptions, output: Output
) -> Result[Any]:
    """Return a run from an initial state, equilibria, modes or a frequency response."""
    if output.plot is not None and (forward.statics or forward.modes or forward.response):
        raise InputError(
            "--plot draws a run from an initial state; drop it, or --statics, --modes, --response"
        )
    if output.csv is not None and (forward.statics or forward.modes):
        raise InputError("--csv holds a run or a response; take --json for --statics and --modes")
    # --duration is that of the run, not of motion laws
    model = loads.dynamic_model(replace(source, duration=None).load(still=True))
    initial = dict(forward.initial)
    if forward.statics:
        return _statics(model, initial)
    if forward.modes:
        return _modes(model, initial)
    if forward.response is not None:
        return _response(model, forward.response, initial, output.csv)
    result = run(
        model,
        initial=initial,
        duration=1.0 if source.duration is None else source.duration,
        until=forward.until,
        samples=output.samples,
        restitution=forward.restitution,
    )
    if output.csv is not None:
        files.write(output.csv, result.motion)
    if output.plot is not None:
        plots.write(output.plot, plots.motion_plot(result.motion))
    return _run(model, result, _verdict(model, result, initial, output.method), output.verbose)


def _verdict(
    model: DynamicModel, result: DynamicRun, initial: Mapping[str, str], method: str | None
) -> Verdict | None:
    """Return the comparison with MuJoCo; None where it is left out."""
    if method == "none" or result.events or result.outcome not in ("done", "stopped"):
        return None
    return crosscheck_forward(result, model, initial_values(model.mechanism, initial))


def _run(model: DynamicModel, result: DynamicRun, verdict: Verdict | None, verbose: bool) -> Result[Any]:
    """Return a run from an initial state."""
    name = model.mechanism.name
    data: dict[str, Any] = {
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
        data |= {"passed": verdict.passed, "checks": [check.as_dict() for check in verdict.checks]}

    def text() -> None:
        end = f": {result.reason}" if result.reason else ""
        print_text(f"{name}: {result.outcome} at {number(result.time[-1])} s{end}")
        print_text(
            f"energy balance to {result.energy_error:.1e}, work {number(result.work[-1])} J, lost "
            f"{number(result.lost[-1])} J, {result.steps} steps"
        )
        rows = [
            (joint, *_extent(motion.value), motion.unit, float(motion.rate[-1]))
            for joint, motion in result.motion.joints.items()
        ]
        head = ("joint", "least", "largest", "at the end", "unit", "rate at the end")
        print_table("coordinates", head, rows)
        if verdict is not None:
            print_verdicts({"against MuJoCo, stepped": verdict}, verbose=verbose)
        elif result.events:
            print_text("not compared with MuJoCo, whose impacts and dry friction are soft")

    passed = result.outcome in ("done", "stopped") and (verdict is None or verdict.passed)
    return Result(data, text, passed)


def _extent(values: Any) -> tuple[float, float, float]:
    return float(values.min()), float(values.max()), float(values[-1])


def _final(result: DynamicRun) -> dict[str, float]:
    """Return the coordinates and rates at the end."""
    final: dict[str, float] = {}
    for name, joint in result.motion.joints.items():
        final |= {f"{name}.q": float(joint.value[-1]), f"{name}.v": float(joint.rate[-1])}
    return final


def _statics(model: DynamicModel, initial: Mapping[str, str]) -> Result[Any]:
    """Return the equilibria, and what holds the initial configuration."""
    mechanism, solutions = model.mechanism, equilibria(model, initial=initial)
    efforts = holding(model, initial=initial) if initial else {}
    drivers = mechanism.drivers or tuple(solutions[0].q)[:1] if solutions else ()

    def text() -> None:
        rows = [
            (
                ", ".join(f"{driver} {number(equilibrium.q[driver])}" for driver in drivers),
                "yes" if equilibrium.stable else "no",
                number(equilibrium.potential),
                ", ".join(number(mode.frequency) for mode in equilibrium.modes) if equilibrium.stable else "",
            )
            for equilibrium in solutions
        ]
        searched = f"found from {STARTS + 1} configurations of this assembly"
        title = f"{mechanism.name}: {len(solutions)} equilibria {searched}"
        print_table(title, ("at [rad, m]", "stable", "potential [J]", "frequencies [Hz]"), rows)
        for driver, effort in efforts.items():
            unit = "N" if mechanism.unit(driver) == "m" else "N m"
            print_text(f"{number(effort)} {unit} in {driver} hold the initial configuration")

    facts = [_equilibrium_facts(equilibrium) for equilibrium in solutions]
    return Result({"mechanism": mechanism.name, "equilibria": facts, "holding": efforts}, text)


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


def _modes(model: DynamicModel, initial: Mapping[str, str]) -> Result[Any]:
    """Return frequencies, damping ratios and shapes of the modes about the nearest equilibrium."""
    equilibrium, name = nearest_equilibrium(model, initial=initial), model.mechanism.name

    def text() -> None:
        rows: list[tuple[str, str, str]] = []
        for mode in equilibrium.modes:
            shape = sorted(mode.shape.items(), key=lambda item: -abs(item[1]))[:MOST_AMPLITUDES]
            amplitudes = ", ".join(f"{joint} {value.real:+.3g}" for joint, value in shape)
            rows.append((number(mode.frequency), number(mode.damping_ratio), amplitudes))
        state = "stable" if equilibrium.stable else "unstable"
        title = f"{name}: modes about a {state} equilibrium"
        print_table(title, ("frequency [Hz]", "damping ratio", "shape"), rows)

    return Result({"mechanism": name, **_equilibrium_facts(equilibrium)}, text, equilibrium.stable)


def _response(
    model: DynamicModel, requested: str, initial: Mapping[str, str], csv: str | None
) -> Result[Any]:
    """Return the frequency response from a load to a quantity."""
    load, colon, quantity = requested.partition(":")
    if not colon:
        raise InputError(f"--response is {requested!r}; give LOAD:QUANTITY, as in crank:P.x")
    modes = nearest_equilibrium(model, initial=initial).modes
    natural = [mode.frequency for mode in modes if mode.frequency > 0.0] or [1.0]
    frequencies = np.geomspace(0.1 * min(natural), 10.0 * max(natural), FREQUENCIES)
    values = response(model, load, quantity, frequencies, initial=initial)
    magnitude = np.abs(values)
    table = {"frequency": frequencies, "magnitude": magnitude, "phase": np.angle(values)}
    if csv is not None:
        files.write_table(csv, table)
    peak = int(np.argmax(magnitude))
    text = (
        f"{model.mechanism.name}: from a unit load {load} to {quantity}: {number(magnitude[0])} at "
        f"{number(frequencies[0])} Hz, largest {number(magnitude[peak])} at {number(frequencies[peak])} Hz"
    )
    data = {"mechanism": model.mechanism.name, "response": table}
    return Result(data, lambda: print_text(text))
