"""Commands `mechsim dynamics statics`, `modes`, `response`: equilibria and small motions about them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import typer

from mechsim import files, kinetics
from mechsim.cli.command import Result, Without, command, table_file, table_or_plot_file
from mechsim.cli.dynamics_report import Verbose, require_method, with_masses, write_outputs
from mechsim.cli.exit_codes import notes
from mechsim.cli.load_options import InitialOptions, LoadOptions
from mechsim.cli.options import ModelOptions
from mechsim.cli.output import DEGREES, number, print_table, print_text, without_noise
from mechsim.cli.verdict_text import print_verdicts
from mechsim.errors import InputError, several
from mechsim.kinetics import DynamicModel, Equilibrium, LoadCurve, Mode
from mechsim.kinetics.contact_forces import contact_unit
from mechsim.kinetics.dynamic_run import Initial
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.quantities import coordinate_units
from mechsim.numerics.arrays import Array
from mechsim.pictures import plots
from mechsim.studies.dynamics_check import crosscheck_equilibrium
from mechsim.studies.release import frequency_response, mode_motions
from mechsim.units import option

AtRest = Annotated[ModelOptions, Without("drive", "track", "duration", "loops")]
InitialConfiguration = Annotated[InitialOptions, Without("until")]
# imaginary parts of a mode shape below this fraction of its largest amplitude are rounding errors
REAL = 1e-6
# maximum number of printed amplitudes of a mode shape, the largest first
MAX_AMPLITUDES = 4


@command
def statics(
    source: AtRest,
    loads: LoadOptions,
    initial: InitialConfiguration,
    verbose: Verbose = False,
    output: Annotated[str | None, table_file("Table of the equilibria, or of the curve, to write")] = None,
    curve: str | None = option(
        None,
        "Load-displacement curve of a load on J, P.x or distance:P,Q, within an interval in SI.",
        metavar="LOAD[=A:B]",
    ),
    assemblies: int = option(0, "Also search from N random configurations of any assembly.", metavar="N"),
    method: str = option("pose", "Whether MuJoCo checks the equilibria: pose, or none.", metavar="pose|none"),
) -> Result:
    """List the equilibria and the families of them, and the torques that hold a configuration.

    The torques are those of the configuration that --initial states.

    Examples:
    mechsim dynamics statics four_bar --initial crank.q=30deg
    mechsim dynamics statics four_bar --curve crank=0:3
    """
    require_method(method, "pose", "none")
    model, state = loads.dynamic_model(source.load(still=True)), dict(initial.initial)
    mechanism, solutions = model.mechanism, kinetics.equilibria(model, initial=state, assemblies=assemblies)
    verdicts = {
        f"equilibrium {index} in MuJoCo": crosscheck_equilibrium(equilibrium, model)
        for index, equilibrium in enumerate(solutions, start=1)
        # a structure without degrees of freedom has nothing to compare
        if method == "pose" and not equilibrium.singular and len(equilibrium.linear.roots.values)
    }
    torques, ranges, none = _holding(model, state)
    moved = model.forces.motor or model.forces.actuators or model.forces.controllers
    besides = ", besides the motors and controllers at rest" if moved else ""
    loaded = None if curve is None else _load_curve(model, curve, state)
    if output is not None:
        files.write_table(output, _columns(solutions, loaded))

    def text() -> None:
        if any(equilibrium.everywhere for equilibrium in solutions):
            print_text(
                f"{mechanism.name}: every configuration is an equilibrium: loads, springs and weights balance"
            )
        else:
            _print_equilibria(mechanism, solutions, assemblies)
        if state and not torques and curve is None:
            print_text(none)
        for driver, torque in torques.items():
            print_text(
                f"{number(torque)} {mechanism.effort_unit(driver)} in {driver} hold the initial configuration"
                f"{besides}"
            )
        for driver, (low, high) in ranges.items():
            locking = ": self-locking" if low <= 0.0 <= high and not besides else ""
            unit = mechanism.effort_unit(driver) + locking
            print_text(f"with friction, so do {number(low)} to {number(high)} {unit}")

        if loaded is not None and curve is not None:
            _print_curve(curve, loaded)
        if verdicts:
            print_verdicts(verdicts, verbose=verbose)

    checks = [replace(check, variant=name) for name, verdict in verdicts.items() for check in verdict.checks]
    agreed = all(verdict.passed for verdict in verdicts.values())
    data: dict[str, Any] = {
        "equilibria": [_equilibrium_facts(equilibrium) for equilibrium in solutions],
        "holding": torques,
        "holding_range": ranges,
        "passed": agreed if verdicts else None,
        "checks": checks,
    }
    if loaded is not None:
        data["curve"] = files.attributes(loaded, "load", "displacement", "stable", "limit_points", "pulling")
    return _with_masses(model, Result(data, text, agreed), verbose)


def _holding(
    model: DynamicModel, state: Mapping[str, Initial]
) -> tuple[dict[str, float], dict[str, tuple[float, float]], str]:
    """Return the forces that hold a stated configuration, their ranges, and why there are none."""
    try:
        torques = kinetics.holding(model, initial=state) if state else {}
    except InputError as error:
        return {}, {}, str(error)
    ranges: dict[str, tuple[float, float]] = {}
    try:
        ranges = kinetics.holding_range(model, initial=state) if state else {}
    except InputError as error:
        notes.append(str(error))
    none = "no driver can hold the initial configuration: none is named, as by inverse --drive"
    return torques, ranges, none


def _with_masses(model: DynamicModel, result: Result, verbose: bool | None = None) -> Result:
    """Return a result with its masses, and notes of what varies over time, or is the state of a motor."""
    forces = model.forces
    if any(load.over == "time" for load in forces.load_profiles) or any(c.varies for c in forces.controllers):
        notes.append("loads and controllers that vary over time have their values at 0 s")
    stated = [actuator.name for actuator in forces.actuators if actuator.inflow is not None]
    if stated:
        notes.append(
            f"{', '.join(stated)}: the state is steady: a current or a filter follows at once, and an "
            "integral keeps its initial value"
        )
    return with_masses(model, result, verbose)


def _columns(solutions: Sequence[Equilibrium], curve: LoadCurve | None) -> dict[str, Array]:
    """Return the columns of a table of a load-displacement curve, or without one of the equilibria."""
    if curve is not None:
        columns = {f"{name}.q": values for name, values in curve.q.items()}
        return {"load": curve.load, "displacement": curve.displacement, **columns}
    names = list(solutions[0].q) if solutions else []
    columns = {f"{name}.q": np.array([item.q[name] for item in solutions]) for name in names}
    return {**columns, "potential": np.array([item.potential for item in solutions])}


def _load_curve(model: DynamicModel, text: str, initial: Mapping[str, Initial]) -> LoadCurve:
    """Return the curve of a text such as "P.y=-0.1:0.1"."""
    load, equals, interval = text.partition("=")
    low, _, high = interval.partition(":")
    try:
        ends = sorted((float(low), float(high))) if equals else [-np.inf, np.inf]
    except ValueError:
        raise InputError(
            f"--curve is {text!r}; give LOAD=A:B with two numbers in SI, as in P.y=-0.1:0.1"
        ) from None
    return kinetics.load_curve(model, load, between=(ends[0], ends[1]), initial=initial)


def _print_curve(name: str, curve: LoadCurve) -> None:
    """Print the extent of a load-displacement curve, and its limit points."""
    rows = [tuple(map(number, row)) for row in curve.limit_points]
    spans = [f"{number(x.min())} to {number(x.max())}" for x in (curve.load, curve.displacement)]
    wrong = f"; at {curve.pulling.sum()} of {len(curve.load)} points a contact would pull, or a rope push"
    limits = several(len(rows), "limit point") + (wrong if curve.pulling.any() else "")
    print_text(f"curve {name}: loads {spans[0]}, displacements {spans[1]}, {limits}")
    print_table(f"limit points of {name}", ("load", "displacement"), rows)


def _print_equilibria(mechanism: Mechanism, solutions: Sequence[Equilibrium], assemblies: int) -> None:
    """Print equilibria, their stability and natural frequencies as a table."""
    rows = [
        (
            _position(mechanism, equilibrium),
            equilibrium.dimension,
            {True: "yes", False: "no", None: "undecided"}[equilibrium.stable],
            "yes" if equilibrium.reached else "no",
            number(equilibrium.potential),
            ", ".join(
                [f"no force in {name}" for name in equilibrium.open]
                + [
                    f"stop of {name} presses with {number(force)} {mechanism.effort_unit(name)}"
                    for name, force in equilibrium.stops.items()
                ]
                + [
                    f"{number(force)} {contact_unit(mechanism, name)} in {name}"
                    for name, force in equilibrium.contacts.items()
                ]
                + [_root_text(mode) for mode in equilibrium.modes]
            ),
        )
        for equilibrium in solutions
    ]
    searched = "found along the motion"
    if assemblies:
        searched += f" and {assemblies} random ones of any assembly"
    if not rows:
        hint = "" if assemblies else "; --assemblies N also searches from N random ones of any assembly"
        print_text(f"{mechanism.name}: no equilibrium {searched}{hint}")
    families = sum(equilibrium.dimension > 0 for equilibrium in solutions)
    isolated = len(solutions) - families
    noun = "equilibrium" if isolated == 1 else "equilibria"
    kinds = f"{isolated} {noun}"
    if families:
        kinds = f"{isolated} isolated {noun} and {families} famil{'y' if families == 1 else 'ies'}"
    head = ("at", "dimension", "stable", "reached", "potential [J]", "modes")
    print_table(f"{mechanism.name}: {kinds} {searched}", head, rows)


def _root_text(mode: Mode) -> str:
    """Return the frequency of a mode; of a real root, which does not oscillate, the root itself."""
    real = mode.eigenvalue.real if mode.frequency and not mode.eigenvalue.imag else 0.0
    return f"{number(real)} 1/s" if real else f"{number(mode.frequency)} Hz"


def _position(mechanism: Mechanism, equilibrium: Equilibrium) -> str:
    """Return the coordinates at an equilibrium: the drivers', and others up to the degrees of freedom."""
    units, texts = coordinate_units(mechanism), list[str]()
    count = max(1, len(mechanism.drivers), len(equilibrium.linear.stiffness))
    for name in [*dict.fromkeys((*mechanism.drivers, *equilibrium.q))][:count]:
        scale = mechanism.characteristic_length if units[name] == "m" else 1.0
        value = without_noise([equilibrium.q[name], scale])[0]
        by, unit = DEGREES.converted(units[name])
        texts.append(f"{name} {number(value / by)} {unit}")
    return ", ".join(texts)


def _equilibrium_facts(equilibrium: Equilibrium) -> dict[str, Any]:
    names = (
        "q",
        "stable",
        "dimension",
        "singular",
        "reached",
        "everywhere",
        "potential",
        "stops",
        "contacts",
        "open",
    )
    return files.attributes(equilibrium, *names) | {"modes": [*map(_mode_facts, equilibrium.modes)]}


def _mode_facts(mode: Mode) -> dict[str, Any]:
    """Return a mode as plain data; amplitudes that are in phase or opposed are real numbers."""
    largest = max((abs(value) for value in mode.shape.values()), default=0.0)
    real = all(abs(value.imag) <= REAL * largest for value in mode.shape.values())
    return files.attributes(mode, "frequency", "damping_ratio", "error") | {
        "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
        "shape": {
            name: value.real if real else [value.real, value.imag] for name, value in mode.shape.items()
        },
    }


@command
def modes(
    source: AtRest,
    loads: LoadOptions,
    initial: InitialConfiguration,
    output: Annotated[list[str] | None, table_or_plot_file("Table of the modes", "their plot")] = None,
) -> Result:
    """Compute natural frequencies, damping ratios and mode shapes about an equilibrium.

    It is the equilibrium next to the initial configuration; `mechsim dynamics statics` lists all.

    Examples:
    mechsim dynamics modes four_bar --initial crank.q=-95deg
    mechsim dynamics modes four_bar --motor crank=-3*crank.q -o modes.svg
    """
    model = loads.dynamic_model(source.load(still=True))
    equilibrium = kinetics.nearest_equilibrium(model, initial=dict(initial.initial))
    name = model.mechanism.name

    def figure() -> Any:
        cycles = {cycle.title: cycle.motion for cycle in mode_motions(equilibrium)}
        return plots.mode_plot(model.mechanism, cycles)

    write_outputs(output, lambda: _mode_columns(equilibrium.modes), figure)

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
        title = f"{name}: modes about the {state} equilibrium at {_position(model.mechanism, equilibrium)}"
        if equilibrium.singular:
            print_text(f"{title}: none, since it can move there in more ways than next to it")
        elif not rows:
            stops = f"stops of {', '.join(equilibrium.stops)} hold it" if equilibrium.stops else "it is rigid"
            print_text(f"{title}: none, since {stops}")
        print_table(title, ("frequency [Hz]", "damping ratio", "s [1/s]", "shape"), rows)

    return _with_masses(model, Result(_equilibrium_facts(equilibrium), text, equilibrium.stable is True))


def _mode_columns(modes: Sequence[Mode]) -> dict[str, Array]:
    """Return the columns of a table of modes: roots s in [1/s], and complex amplitudes of the joints."""
    columns = {
        name: np.array([getattr(mode, name) for mode in modes]) for name in ("frequency", "damping_ratio")
    }
    shapes = {joint: [mode.shape[joint] for mode in modes] for joint in (modes[0].shape if modes else ())}
    for name, numbers in {"s": [mode.eigenvalue for mode in modes], **shapes}.items():
        columns[f"{name}.real"] = np.array([number.real + 0.0 for number in numbers])
        columns[f"{name}.imag"] = np.array([number.imag + 0.0 for number in numbers])
    return columns


def _eigenvalue_text(mode: Mode) -> str:
    """Return an eigenvalue and the bound of its error."""
    real, imaginary = without_noise([mode.eigenvalue.real, mode.eigenvalue.imag, abs(mode.eigenvalue)])[:2]
    text = f"{number(real)} +- {number(imaginary)}i" if imaginary else number(real)
    return f"{text} (error {mode.error:.0e})" if mode.error else text


@command
def response(
    source: AtRest,
    response: Annotated[
        str,
        typer.Argument(
            metavar="LOAD:QUANTITY",
            help="Unit load in joint J or on coordinate P.x of a point, and the quantity that responds.",
        ),
    ],
    loads: LoadOptions,
    initial: InitialConfiguration,
    output: Annotated[list[str] | None, table_or_plot_file("Table of the response", "Bode diagram")] = None,
) -> Result:
    """Compute the frequency response of a quantity to a load, about an equilibrium.

    Examples:
    mechsim dynamics response four_bar crank:B.x --initial crank.q=-95deg
    mechsim dynamics response four_bar B.y:B.y -o bode.svg
    """
    model = loads.dynamic_model(source.load(still=True))
    result = frequency_response(model, response, dict(initial.initial))
    columns = result.columns()
    label = f"{result.quantity} [{result.unit}]"
    write_outputs(output, lambda: columns, lambda: plots.bode_plot(columns, label))
    magnitude, frequency = columns["magnitude"], columns["frequency"]
    peak = int(np.argmax(magnitude))
    text = (
        f"{model.mechanism.name}: from a unit load {result.load} to {result.quantity}: "
        f"{number(magnitude[0])} {result.unit} at {number(frequency[0])} Hz, largest "
        f"{number(magnitude[peak])} {result.unit} at {number(frequency[peak])} Hz"
    )
    data = {"load": result.load, "quantity": result.quantity, "unit": result.unit, "response": columns}
    return _with_masses(model, Result(data, lambda: print_text(text)))
