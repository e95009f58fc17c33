"""Forward dynamics, statics and vibrations of `mechsim dynamics`, from any state with free drivers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict

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
)
from mechsim.analytic.dynamics.dynamic_run import initial_values
from mechsim.cli.command import Result
from mechsim.cli.load_options import InitialOptions, ModelOptions
from mechsim.cli.output import Value, number, print_table, print_text, without_noise
from mechsim.cli.progress import progress, sections
from mechsim.cli.verdict_text import print_verdicts
from mechsim.model.finding import Outcome
from mechsim.model.masses import LinkMass
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.model.progress import Progress
from mechsim.model.quantities import coordinate_units, quantity_names
from mechsim.numerics.arrays import Array
from mechsim.pictures import plots
from mechsim.studies.dynamics_check import compared_segments, crosscheck_equilibrium, crosscheck_forward
from mechsim.studies.release import Release, frequency_response, mode_motions
from mechsim.units import option
from mechsim.verdict.checks import Check, Verdict


class Extent(TypedDict):
    """Minimum, maximum and last value of a quantity over a run."""

    least: float
    largest: float
    final: float


class QuantityJson(Extent):
    """A quantity over a run."""

    unit: str


class ForwardRunJson(TypedDict):
    """End and energies of a run from an initial state, and the comparison with MuJoCo, if there is one."""

    mechanism: str
    masses: list[LinkMass]
    gravity: list[float]
    outcome: Outcome
    reason: str
    duration: float
    energy_error: float
    work: float
    lost: float
    events: list[float]
    singular: list[float]
    steps: int
    final: dict[str, float]
    quantities: dict[str, QuantityJson]
    passed: bool | None
    checks: list[Check]


class ModeJson(TypedDict):
    """A mode of small motions; amplitudes of the joints are numbers, or real and imaginary parts.

    `eigenvalue` is [real part, imaginary part] of s in [1/s], `error` the bound of its error.
    """

    frequency: float
    damping_ratio: float
    eigenvalue: list[float]
    error: float
    shape: dict[str, float | list[float]]


class EquilibriumJson(TypedDict):
    """A configuration at rest, its potential energy in [J], and the modes about it.

    `stable` is null if rounding leaves it undecided. `dimension` is 0 for an isolated equilibrium, else the
    dimension of the family of equilibria that `q` is one of; each family has one entry. At a `singular`
    configuration, which has more degrees of freedom than its neighbours, there are no modes.
    """

    q: dict[str, float]
    stable: bool | None
    dimension: int
    singular: bool
    reached: bool
    everywhere: bool
    potential: float
    modes: list[ModeJson]


class StaticsJson(TypedDict):
    """Equilibria, holding forces of the initial configuration, and checks of the equilibria in MuJoCo."""

    mechanism: str
    masses: list[LinkMass]
    gravity: list[float]
    equilibria: list[EquilibriumJson]
    holding: dict[str, float]
    passed: bool | None
    checks: list[Check]


class ModesJson(EquilibriumJson):
    """The equilibrium next to the initial configuration."""

    mechanism: str
    masses: list[LinkMass]
    gravity: list[float]


class ResponseColumns(TypedDict):
    """Columns of a frequency response, over frequencies in [Hz]; phases in [rad]."""

    frequency: list[float]
    magnitude: list[float]
    phase: list[float]


class ResponseJson(TypedDict):
    """Frequency response from a unit load to a quantity."""

    mechanism: str
    masses: list[LinkMass]
    gravity: list[float]
    load: str
    quantity: str
    unit: str
    response: ResponseColumns


ForwardJson = ForwardRunJson | StaticsJson | ModesJson | ResponseJson


# analyses from an initial state, as parts of messages
RUN, STATICS, MODES = "in a run from an initial state", "with --statics", "with --modes"
RESPONSE = "with --response"
# imaginary parts of a mode shape below this fraction of its largest amplitude are rounding errors
REAL = 1e-6
# maximum number of printed amplitudes of a mode shape, the largest first
MAX_AMPLITUDES = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class ForwardOptions(InitialOptions):
    """A run from an initial state, equilibria, modes of vibration, or a frequency response."""

    statics: bool = option(
        False,
        "List equilibria and families of them; with --initial also the torques that hold that configuration.",
        name="--statics",
    )
    assemblies: int = option(
        0, "With --statics: also search from N random configurations of any assembly.", metavar="N"
    )
    modes: bool = option(
        False,
        "Natural frequencies, damping ratios and mode shapes about the equilibrium next to the initial "
        "configuration (--initial); --statics lists all equilibria, with their modes in JSON.",
        name="--modes",
    )
    response: str | None = option(
        None,
        "Frequency response of a quantity to a unit load in joint J or on coordinate P.x of a point.",
        metavar="LOAD:QUANTITY",
    )
    quantities: tuple[str, ...] = option(
        (),
        "Also list these quantities: distance:P,Q, angle:LINK,LINK or expr:EXPRESSION.",
        read=quantity_names,
        name="--of",
        metavar="Q,...",
    )

    @property
    def requested(self) -> bool:
        """Whether any of these is requested."""
        named = self.initial or self.until or self.statics or self.assemblies or self.modes or self.response
        return bool(named)

    @property
    def analysis(self) -> str:
        """The requested analysis, as a part of a message."""
        if self.statics or self.modes:
            return STATICS if self.statics else MODES
        return RUN if self.response is None else RESPONSE


@dataclass(frozen=True, slots=True)
class Output:
    """Rows of a run, MuJoCo's method, files to write, and whether all checks are listed."""

    rows: int
    method: str | None
    csv: str | None
    plot: str | None
    verbose: bool


# shares of the processor time, measured on runs of four_bar, rssr and klann from an initial state
SHARES = {"formulas": 1.0, "check in MuJoCo": 2.0}


def forward_dynamics(
    model: DynamicModel, forward: ForwardOptions, source: ModelOptions, output: Output
) -> Result[Any]:
    """Return a run from an initial state, equilibria, modes or a frequency response."""
    release = forward.release(model, source)
    if forward.statics:
        return _statics(model, release.initial, output, forward.assemblies)
    if forward.modes:
        return _modes(model, release.initial, output.plot)
    if forward.response is not None:
        return _response(model, forward.response, release.initial, output)
    # rejects unknown names before the run
    release.quantities(forward.quantities)
    # MuJoCo stops when its steps are short enough
    with progress("dynamics", None, at_least=True) as report:
        formulas, check = sections(report, SHARES)
        result = release.run(output.rows - 1, formulas)
        verdict = _verdict(release, result, output.method, check)
    values = release.values(result, forward.quantities)
    if output.csv is not None:
        more = {quantity.name: column for quantity, column in values.items()}
        files.write_table(output.csv, dict(result.columns()) | more)
    if output.plot is not None:
        shown = {f"{quantity.name} [{quantity.unit}]": column for quantity, column in values.items()}
        plots.write(output.plot, plots.history_plot(result, shown))
    extents = {
        quantity.name: QuantityJson(**_extent(column), unit=quantity.unit)
        for quantity, column in values.items()
    }
    return _run(model, result, extents, verdict, output.verbose)


def _verdict(release: Release, result: DynamicRun, method: str | None, report: Progress) -> Verdict | None:
    """Return the comparison with MuJoCo; None if it is omitted."""
    if method == "none" or result.outcome not in ("done", "stopped") or not compared_segments(result):
        return None
    values = initial_values(release.model, release.initial)
    return crosscheck_forward(result, release.model, values, progress=report)


def _run(
    model: DynamicModel,
    result: DynamicRun,
    quantities: Mapping[str, QuantityJson],
    verdict: Verdict | None,
    verbose: bool,
) -> Result[Any]:
    """Return a run from an initial state."""
    name = model.mechanism.name
    data = {
        "outcome": result.outcome,
        "reason": result.reason,
        "duration": float(result.time[-1]),
        "energy_error": result.energy_error,
        "work": float(result.work[-1]),
        "lost": float(result.lost[-1]),
        "events": list(result.events),
        "singular": list(result.singular),
        "steps": result.steps,
        "final": _final(result),
        "quantities": dict(quantities),
        "passed": None if verdict is None else verdict.passed,
        "checks": () if verdict is None else verdict.checks,
    }

    def text() -> None:
        end = f": {result.reason}" if result.reason else ""
        print_text(f"{name}: {result.outcome} at {number(result.time[-1])} s{end}")
        print_text(
            f"energy error {result.energy_error:.1e} (relative), work {number(result.work[-1])} J, lost "
            f"{number(result.lost[-1])} J, {result.steps} steps"
        )
        print_text(_passages(result))
        extents = {
            name: QuantityJson(**_extent(joint.value), unit=joint.unit)
            for name, joint in result.motion.joints.items()
        }
        ends = {name: float(joint.rate[-1]) for name, joint in result.motion.joints.items()}
        rows: list[tuple[Value, ...]] = []
        for quantity, extent in [*extents.items(), *quantities.items()]:
            numbers = without_noise([extent["least"], extent["largest"], extent["final"]])
            rows.append((quantity, *numbers, extent["unit"], ends.get(quantity)))
        head = ("quantity", "least", "largest", "at the end", "unit", "rate at the end")
        rows += [
            (f"drive {name}", float(effort.min()), float(effort.max()), float(effort[-1]), unit, None)
            for name, effort in result.driving.items()
            for unit in [model.mechanism.effort_unit(name)]
        ]
        print_table("", head, rows)
        if verdict is not None:
            print_verdicts({"against MuJoCo, stepped": verdict}, verbose=verbose)
        if result.events or result.segments[0].sticking:
            print_text(_comparison(result, verdict is not None))

    passed = result.outcome in ("done", "stopped") and (verdict is None or verdict.passed)
    return Result(data, text, passed)


def _passages(result: DynamicRun) -> str:
    """Return the instants of singular configurations in words; empty for none."""
    instants = ", ".join(number(instant) for instant in result.singular)
    return instants and (
        f"passes singular configurations at {instants} s: there drivers do not determine the motion"
    )


def _comparison(result: DynamicRun, compared: bool) -> str:
    """Return which segments of a run with impacts or changes of friction are compared with MuJoCo."""
    soft = "its impacts, contacts and changes of friction are soft"
    if not compared:
        return f"not compared with MuJoCo: {soft}"
    spans = [f"{number(segment.first)} to {number(segment.last)} s" for segment in compared_segments(result)]
    return f"compared with MuJoCo in {', '.join(spans)}: {soft}"


def _extent(values: Array) -> Extent:
    return Extent(least=float(values.min()), largest=float(values.max()), final=float(values[-1]))


def _final(result: DynamicRun) -> dict[str, float]:
    """Return the coordinates and rates at the end."""
    final: dict[str, float] = {}
    for name, joint in result.motion.joints.items():
        final |= {f"{name}.q": float(joint.value[-1]), f"{name}.v": float(joint.rate[-1])}
    return final


def _statics(
    model: DynamicModel, initial: Mapping[str, float | str], output: Output, assemblies: int
) -> Result[Any]:
    """Return the equilibria, holding forces of the initial configuration, and the comparison with MuJoCo."""
    mechanism, solutions = model.mechanism, equilibria(model, initial=initial, assemblies=assemblies)
    compared = output.method != "none"
    verdicts = {
        f"equilibrium {index} in MuJoCo": crosscheck_equilibrium(equilibrium, model)
        for index, equilibrium in enumerate(solutions, start=1)
        # a structure without degrees of freedom has nothing to compare
        if compared and not equilibrium.singular and len(equilibrium.linear.roots.values)
    }
    torques = holding(model, initial=initial) if initial else {}

    def text() -> None:
        if any(equilibrium.everywhere for equilibrium in solutions):
            print_text(
                f"{mechanism.name}: every configuration is an equilibrium, for no load, spring or weight "
                "moves the mechanism"
            )
        else:
            _print_equilibria(mechanism, solutions, assemblies)
        for driver, torque in torques.items():
            print_text(
                f"{number(torque)} {mechanism.effort_unit(driver)} in {driver} hold the initial configuration"
            )

        if verdicts:
            print_verdicts(verdicts, verbose=output.verbose)

    facts = [_equilibrium_facts(equilibrium) for equilibrium in solutions]
    checks = [replace(check, variant=name) for name, verdict in verdicts.items() for check in verdict.checks]
    agreed = all(verdict.passed for verdict in verdicts.values())
    data = {"equilibria": facts, "holding": torques, "passed": agreed if verdicts else None, "checks": checks}
    return Result(data, text, agreed)


def _print_equilibria(mechanism: Mechanism, solutions: Sequence[Equilibrium], assemblies: int) -> None:
    """Print equilibria, their stability and natural frequencies as a table."""
    rows = [
        (
            _position(mechanism, equilibrium),
            equilibrium.dimension,
            _stability(equilibrium),
            "yes" if equilibrium.reached else "no",
            number(equilibrium.potential),
            ", ".join(_root_text(mode) for mode in equilibrium.modes),
        )
        for equilibrium in solutions
    ]
    searched = "found along the motion"
    other = f" and {assemblies} random ones of any assembly" if assemblies else ""
    if not rows:
        hint = "" if assemblies else "; --assemblies N also searches from N random ones of any assembly"
        print_text(f"{mechanism.name}: no equilibrium {searched}{other}{hint}")
    families = sum(equilibrium.dimension > 0 for equilibrium in solutions)
    kinds = f"{len(solutions) - families} isolated equilibria and {families} families" if families else ""
    title = f"{mechanism.name}: {kinds or f'{len(solutions)} equilibria'} {searched}{other}"
    head = ("at", "dimension", "stable", "reached", "potential [J]", "modes")
    print_table(title, head, rows)


def _stability(equilibrium: Equilibrium) -> str:
    """Return "yes", "no" or "undecided"."""
    return {True: "yes", False: "no", None: "undecided"}[equilibrium.stable]


def _root_text(mode: Mode) -> str:
    """Return the frequency of a mode; of a real root, which does not oscillate, the root itself."""
    real = mode.eigenvalue.real if mode.frequency and not mode.eigenvalue.imag else 0.0
    return f"{number(real)} 1/s" if real else f"{number(mode.frequency)} Hz"


def _position(mechanism: Mechanism, equilibrium: Equilibrium) -> str:
    """Return the drivers' coordinates at an equilibrium; without drivers, the first coordinate."""
    units, texts = coordinate_units(mechanism), list[str]()
    for name in mechanism.drivers or tuple(equilibrium.q)[:1]:
        scale = mechanism.characteristic_length if units[name] == "m" else 1.0
        value = without_noise([equilibrium.q[name], scale])[0]
        texts.append(f"{name} {number(value)} {units[name]}")
    return ", ".join(texts)


def _equilibrium_facts(equilibrium: Equilibrium) -> EquilibriumJson:
    return {
        "q": dict(equilibrium.q),
        "stable": equilibrium.stable,
        "dimension": equilibrium.dimension,
        "singular": equilibrium.singular,
        "reached": equilibrium.reached,
        "everywhere": equilibrium.everywhere,
        "potential": equilibrium.potential,
        "modes": [_mode_facts(mode) for mode in equilibrium.modes],
    }


def _mode_facts(mode: Mode) -> ModeJson:
    """Return a mode as plain data; amplitudes that are in phase or opposed are real numbers."""
    largest = max((abs(value) for value in mode.shape.values()), default=0.0)
    real = all(abs(value.imag) <= REAL * largest for value in mode.shape.values())
    shape: dict[str, float | list[float]] = {
        name: value.real if real else [value.real, value.imag] for name, value in mode.shape.items()
    }
    return {
        "frequency": mode.frequency,
        "damping_ratio": mode.damping_ratio,
        "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
        "error": mode.error,
        "shape": shape,
    }


def _modes(model: DynamicModel, initial: Mapping[str, float | str], plot: str | None) -> Result[Any]:
    """Return frequencies, damping ratios and shapes of the modes about an equilibrium."""
    equilibrium, name = nearest_equilibrium(model, initial=initial), model.mechanism.name
    if plot is not None:
        plots.write(plot, plots.mode_plot(model.mechanism, _cycles(equilibrium)))

    def text() -> None:
        rows: list[tuple[str, ...]] = []
        for mode in equilibrium.modes:
            shape = sorted(mode.shape.items(), key=lambda item: -abs(item[1]))[:MAX_AMPLITUDES]
            amplitudes = ", ".join(f"{joint} {value.real:+.3g}" for joint, value in shape)
            # a ratio is compared with 1, critical damping
            damping = without_noise([mode.damping_ratio, 1.0])[0]
            rows.append((number(mode.frequency), number(damping), _eigenvalue_text(mode), amplitudes))
        state = {True: "stable", False: "unstable", None: "undecided"}[equilibrium.stable]
        state += f", of a family of dimension {equilibrium.dimension}," if equilibrium.dimension else ""
        position = _position(model.mechanism, equilibrium)
        title = f"{name}: modes about the {state} equilibrium at {position}"
        print_table(title, ("frequency [Hz]", "damping ratio", "s [1/s]", "shape"), rows)

    return Result(_equilibrium_facts(equilibrium), text, equilibrium.stable is True)


def _eigenvalue_text(mode: Mode) -> str:
    """Return an eigenvalue and the bound of its error."""
    real, imaginary = without_noise([mode.eigenvalue.real, mode.eigenvalue.imag, abs(mode.eigenvalue)])[:2]
    text = f"{number(real)} +- {number(imaginary)}i" if imaginary else number(real)
    return f"{text} (error {mode.error:.0e})" if mode.error else text


def _cycles(equilibrium: Equilibrium) -> dict[str, Motion]:
    return {cycle.title: cycle.motion for cycle in mode_motions(equilibrium)}


def _response(
    model: DynamicModel, requested: str, initial: Mapping[str, float | str], output: Output
) -> Result[Any]:
    """Return the frequency response from a load to a quantity."""
    result = frequency_response(model, requested, initial)
    table = result.columns()
    if output.csv is not None:
        files.write_table(output.csv, table)
    if output.plot is not None:
        plots.write(output.plot, plots.bode_plot(table, f"{result.quantity} [{result.unit}]"))
    magnitude, frequency = table["magnitude"], table["frequency"]
    peak = int(np.argmax(magnitude))
    text = (
        f"{model.mechanism.name}: from a unit load {result.load} to {result.quantity}: "
        f"{number(magnitude[0])} {result.unit} at {number(frequency[0])} Hz, largest "
        f"{number(magnitude[peak])} {result.unit} at {number(frequency[peak])} Hz"
    )
    data = {"load": result.load, "quantity": result.quantity, "unit": result.unit, "response": table}
    return Result(data, lambda: print_text(text))
