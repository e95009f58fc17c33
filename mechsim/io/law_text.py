"""Motion laws of drivers written as text: constant speed, an expression of t, or a table in a file."""

import ast
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from mechsim import files, units
from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.mechanism import expressions
from mechsim.mechanism.expressions import VARIABLES, Expression, Instruction, Term, unit_powers, without_time
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.load_profile import LoadProfile, Over, constant, function, table, whole_revolutions
from mechsim.mechanism.motion_laws import State, steady, tabled
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet
from mechsim.units import Unit

# a number followed by letters, a quantity within an expression; an exponent belongs to the number
_NUMBER = r"(?<![\w.])((?>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))"
_QUANTITY = re.compile(_NUMBER + r"\s*((?:[^\W\d_]|°)+)(?![\w(]|\s*\()")
# name of a quantity in the syntax tree
_PLACEHOLDER = "quantity_{}_"
# units allowed in an expression
_UNITS = ("m", "rad", "s", "N", "N m")


@dataclass(frozen=True)
class TimeFunction:
    """A motion law or load that an expression of one variable states.

    Attributes:
        expression: the expression, in SI.
    """

    expression: Expression

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return the value and its first two derivatives at times or angles (n,)."""
        zero = 0.0 * time
        result = self.expression.jet({self.expression.names[0]: Jet(time, 1.0 + zero, zero)})
        return result.value + zero, result.rate + zero, result.second + zero

    @property
    def instructions(self) -> tuple[Instruction, ...]:
        """Its evaluation."""
        return self.expression.instructions


def time_function(
    text: str,
    unit: str,
    *,
    default_unit: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    variable: str = "t",
    declared: str = "",
) -> tuple[str, TimeFunction]:
    """Return the text in SI without parameters, and the motion law of an expression of t.

    Args:
        text: the expression; t is the time in s, sines take radians, and quantities have units.
        unit: unit of its value: "m" or "rad" of a coordinate, "N" or "N m" of a load.
        default_unit: unit of a result without a unit, in SI.
        parameters: parameter -> its number.
        variable: one of `VARIABLES`, instead of t.
        declared: unit of the file, in which a result without a unit could be meant; an error unless it is SI.

    Raises:
        InputError: for text that is no expression of t, or has another unit; the caller puts the subject
            before the message.
    """
    quantities: dict[str, Term] = {}

    def placeholder(match: re.Match[str]) -> str:
        if match[2] == variable:
            raise InputError(f"holds {match[0]!r}; write {match[1]}*{variable}")
        name = _PLACEHOLDER.format(len(quantities))
        quantities[name] = quantity(f"{match[1]} {match[2]}")
        return name

    tree = expressions.parse_expression(_QUANTITY.sub(placeholder, text))
    numbers = {name: Term(value) for name, value in (parameters or {}).items()}

    used: dict[str, Term] = {}
    terms = {variable: Term(Jet(np.ones(1), np.ones(1), np.zeros(1))), **numbers, **quantities}

    def name_value(name: str) -> Term:
        used[name] = terms[name] if name in terms else _unit(name, (variable, "pi", *numbers, "units"))
        return used[name]

    try:
        with np.errstate(all="ignore"):
            probe = expressions.Evaluator(name_value).evaluate(tree)
    except (ArithmeticError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("has no value that is a finite real number") from None
    if not any(isinstance(node, ast.Name) and node.id == variable for node in ast.walk(tree)):
        raise InputError(f"contains no {variable}, {VARIABLES[variable]}")
    _require_unit(probe, unit, default_unit, declared)
    scale = default_unit if probe.dimensionless else 1.0
    product = [Instruction("number", scale), Instruction("Mult", operator.mul, 2)]
    values = {name: float(term.value) for name, term in used.items() if name != variable}
    instructions = (*expressions.instructions_of(tree, values), *(product if scale != 1.0 else []))
    state = TimeFunction(Expression(text, (variable,), instructions))
    si_text = text if scale == 1.0 else f"({text})*{scale:.17g}"
    for name, value in (parameters or {}).items():
        si_text = re.sub(rf"(?<![\w.]){name}(?![\w(])", f"({value:.17g})", si_text)
    return si_text, state


def _require_unit(probe: Term, unit: str, default_unit: float, declared: str) -> None:
    """Raise InputError for a value with a wrong or ambiguous unit."""
    expected = without_time(unit_powers(unit))
    # a length times an angle is a length
    fits = probe.powers[:3] == expected[:3] and (unit != "rad" or probe.powers == expected)
    if not (probe.dimensionless or fits):
        raise InputError(f"is {probe.description}; give {expressions.described(expected)}")
    needs_unit = bool(declared) and units.in_si(1.0, declared, unit) != 1.0  # pyright: ignore[reportArgumentType]
    if probe.dimensionless and needs_unit and not probe.zero:
        raise InputError(f"has no unit, and the file is in {declared}; give it one")
    if probe.without_unit and (default_unit != 1.0 or needs_unit):
        raise InputError("adds a number without a unit to a quantity; give it a unit")


def _unit(name: str, names: Iterable[str]) -> Term:
    """Return the quantity that the name of a unit stands for."""
    try:
        return quantity(f"1 {name}")
    except InputError:
        raise InputError(f"names {name!r}, which is not defined; choose from {', '.join(names)}") from None


def python_expression(text: str) -> str:
    """Return an expression of t in Python, with quantities in SI."""

    def number(match: re.Match[str]) -> str:
        return repr(float(quantity(f"{match[1]} {match[2]}").value))

    return _QUANTITY.sub(number, text)


def quantity(text: str) -> Term:
    """Return a number with a unit of length, angle, force, moment or time, in SI; time is a plain number."""
    if text.split()[-1] == "Hz":
        return Term(float(text.split()[0]))
    value, unit = units.of_any_kind(text, "the quantity")
    if unit.removesuffix("/s") not in _UNITS:
        raise InputError(f"contains {text!r}, which is neither a length, an angle, a force nor a time")
    return Term(value, without_time(unit_powers(unit)))


# returns the initial value of a driver, in SI
Start = Callable[[], float]

# a number with an optional unit, and nothing else
_WHOLE_QUANTITY = re.compile(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*([^\d\W_°%][^*+()]*|[°%])?")
_RATES: dict[str, Unit] = {"m": "m/s", "rad": "rad/s"}
_EXAMPLES = {
    "m": "20mm/s, 10mm*sin(2*pi*t), a constant 15mm, or FILE.csv",
    "rad": "600rpm, 30deg*sin(2*pi*0.6*t), a constant 45deg, or FILE.csv",
}


@dataclass(frozen=True)
class MotionLaw:
    """The motion law of a driver.

    Attributes:
        text: the law as text for the command line or a file in SI.
        state: times (n,) in [s] -> value, rate, acceleration.
        end_time: last time of its table, in [s]; None without a table.
    """

    text: str
    state: State
    end_time: float | None = None

    def __call__(self, time: Array) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at times (n,) in [s]."""
        return self.state(time)

    @property
    def instructions(self) -> tuple[Instruction, ...] | None:
        """The evaluation of its value; None for a table."""
        return getattr(self.state, "instructions", None)


def parse_motion_law(
    text: str,
    name: str,
    unit: str,
    start: Start,
    *,
    default_unit: float = 1.0,
    parameters: Mapping[str, float] | None = None,
    declared: str = "",
) -> MotionLaw:
    """Return the motion law of a driver.

    Args:
        text: `600rpm` or `20mm/s`, a constant speed from the initial value of the driver; an expression of t
            in s, such as `30deg*sin(2*pi*t)`; `30deg`, a constant value; or FILE.csv with columns t and value
            in SI.
        name: name of the driven coordinate.
        unit: unit of the coordinate, "m" or "rad".
        start: returns its initial value, in SI.
        default_unit: unit of numbers without a unit, in SI.
        parameters: parameter -> its number in that unit.
        declared: unit that the mechanism's file declares for the coordinate, if the text has another
            origin; text without a unit is then an error.

    Raises:
        InputError: names the driver, the text and the remedy.
    """
    if is_table(text):
        return _tabulated_law(text.strip(), name)
    subject = f"the motion law of {name}, {text!r},"
    try:
        quantity = _WHOLE_QUANTITY.fullmatch(text)
        if quantity is None or quantity[1] == "t":
            return MotionLaw(
                *time_function(
                    text, unit, default_unit=default_unit, parameters=parameters, declared=declared
                )
            )
    except InputError as error:
        raise InputError(f"{subject} {error}, as in {_EXAMPLES[unit]}") from None
    if quantity[1] is None:
        speed, position = (f"{text.strip()}{declared or unit}{end}" for end in ("/s", ""))
        raise InputError(f"{subject} has no unit; write {speed} for a speed or {position} for a position")
    try:
        rate = units.parse(text, _RATES[unit])
    except InputError:
        pass
    else:
        return MotionLaw(text, steady(start(), rate))
    try:
        position = units.parse(text, "m" if unit == "m" else "rad")
    except InputError:
        kind = "a speed or a length" if unit == "m" else "a speed of rotation or an angle"
        raise InputError(f"{subject} has another unit; give {kind}, as in {_EXAMPLES[unit]}") from None
    return MotionLaw(text, steady(position, 0.0))


def _tabulated_law(path: str, name: str) -> MotionLaw:
    """Return the motion law in two columns of a file, or in the column with the driver's name."""
    _, time, value = read_column(path, name, ("t", "time"), f"the motion law of {name} give two, t in s")
    state = tabled(name, time, value)
    if not time[0] <= 0.0 < time[-1]:
        raise InputError(
            f"{path} goes from {time[0]:g} to {time[-1]:g} s; "
            f"give the motion law of {name} from 0 s to a later time"
        )
    return MotionLaw(path, state, float(time[-1]))


def read_column(path: str, name: str, axes: Sequence[str], expected: str) -> tuple[str, Array, Array]:
    """Return the axis of a table in a file, its positions, and the values there, (n,) each.

    Args:
        path: path of the file.
        name: name of the column of values if there are several.
        axes: possible names of the axis.
        expected: expected contents of the file with its axis, for messages.

    Raises:
        InputError: for a file without a table, axis or such a column, or with two axes.
    """
    table = files.read_in_si(path)
    axis_columns = [name_ for name_ in axes if name_ in table]
    value_columns = [name_ for name_ in table if name_ not in axes]
    if len(axis_columns) != 1 or not value_columns or (len(value_columns) > 1 and name not in value_columns):
        raise InputError(
            f"{path} has columns {', '.join(table)}; as {expected} and its value, or one called {name}, in "
            "SI or with a unit: value [deg]"
        )
    axis, values = axis_columns[0], value_columns[0] if len(value_columns) == 1 else name
    return axis, table[axis], table[values]


_AXES: dict[str, Over] = {"t": "time", "time": "time", "angle": "angle"}


@dataclass(frozen=True)
class LoadComponent:
    """A load along one axis.

    Attributes:
        text: its number, or the text that defines it in a file in SI.
        profile: its load profile, one number at each position.
        instructions: its evaluation; None for a number.
    """

    text: float | str
    profile: LoadProfile
    instructions: tuple[Instruction, ...] | None = None


@dataclass(frozen=True)
class WrittenLoad:
    """The value of a load over time or angle, with its text.

    Attributes:
        components: one or three components.
    """

    components: tuple[LoadComponent, ...]

    def __call__(self, position: Array) -> Array:
        """Return the values at positions (n,), (n,) or (n, 3)."""
        columns = [component.profile.evaluate(position, position) for component in self.components]
        return columns[0] if len(columns) == 1 else np.stack(columns, 1)

    @property
    def instructions(self) -> tuple[tuple[Instruction, ...] | None, ...]:
        """The evaluation of each component."""
        return tuple(
            component.instructions
            if isinstance(component.text, str)
            else (Instruction("number", component.text),)
            for component in self.components
        )


def parse_component(text: str, name: str, unit: str, parameters: Mapping[str, float]) -> LoadComponent:
    """Return a load along one axis that varies.

    Args:
        text: an expression of t in s or of the crank angle in rad, or FILE.csv with columns t or angle and
            value in SI. Straight lines connect its rows, and whole revolutions of angles repeat.
        name: name of the column in a file with several columns.
        unit: "N" or "N m"; numbers without a unit are in it.
        parameters: parameter -> its number.

    Raises:
        InputError: for any other text; for an expression the caller puts the subject before the message.
    """
    if is_table(text):
        axis, position, value = read_column(
            text, name, list(_AXES), "a load give two, t in s or angle in rad"
        )
        turns = whole_revolutions(float(np.ptp(position))) if axis == "angle" else 0
        # several revolutions with other values at the end are the course of a motion
        repeats = turns == 1 or (turns > 1 and value[0] == value[-1])
        profile = table(position, value, over=_AXES[axis], periodic=bool(repeats))
        return LoadComponent(text, profile, profile.instructions[0])
    names = expressions.variables(text)
    if len(names) > 1:
        raise InputError(f"names both {' and '.join(names)}; a load varies over only one of them")
    (variable,) = names
    if variable in parameters:
        raise InputError(f"names {variable!r}, which is also a parameter; give the parameter another name")
    si_text, state = time_function(text, unit, parameters=parameters, variable=variable)
    profile = function(lambda position: state(position)[0], over=_AXES[variable])
    return LoadComponent(si_text, profile, state.instructions)


def combine_components(components: Sequence[LoadComponent]) -> LoadProfile:
    """Return a load of one component or three.

    Raises:
        InputError: if components vary over different variables; the caller puts the subject before the
            message.
    """
    axes: set[Over] = {
        component.profile.over for component in components if component.profile.over is not None
    }
    if len(axes) > 1:
        raise InputError("varies over t in one component and over angle in another; use the same in all")
    if not axes:
        numbers = [component.text for component in components]
        return constant(numbers[0] if len(numbers) == 1 else numbers)
    return LoadProfile(axes.pop(), WrittenLoad(tuple(components)), len(components))


def control_law(text: str, name: str) -> MotionLaw:
    """Return the control law of an actuator.

    Args:
        text: a number or a constant quantity such as `20deg` or `30rpm`; an expression of t in s, such as
            `255*(0.5-0.5*cos(2*pi*t))`; or FILE.csv with columns t and value. Numbers are in the unit of the
            control, quantities in SI.
        name: name of the actuator.

    Raises:
        InputError: names the actuator, the text and the remedy.
    """
    if is_table(text):
        return parse_motion_law(text, name, "rad", lambda: 0.0)
    with suppress(ValueError):
        return MotionLaw(text, steady(float(text), 0.0))
    with suppress(InputError):
        return MotionLaw(text, steady(units.of_any_kind(text, "the control")[0], 0.0))
    reason = ""
    for unit in ("rad", "m"):
        try:
            return MotionLaw(*time_function(text, unit))
        except InputError as error:
            reason = str(error)
    raise InputError(
        f"the control of actuator {name}, {text!r}, {reason}, as in --ctrl '{name}=0.3*sin(2*pi*t)'"
    )


def control_laws(texts: Mapping[str, str]) -> dict[str, MotionLaw]:
    """Return the control laws of several actuators: actuator -> control law."""
    return {name: control_law(text, name) for name, text in texts.items()}


def with_controls(forces: Forces, texts: Mapping[str, str]) -> Forces:
    """Return forces whose actuators follow control laws: actuator -> text, as in `control_law`.

    Raises:
        InputError: for an unknown actuator, or text that is no control.
    """
    names = [actuator.name for actuator in forces.actuators]
    for name in texts:
        if name not in names:
            raise InputError(f"--ctrl names {name!r}; actuators are {', '.join(names) or 'none'}")
    changes = {name: {"control": law, "text": texts[name]} for name, law in control_laws(texts).items()}
    actuators = (replace(actuator, **changes.get(actuator.name, {})) for actuator in forces.actuators)
    return replace(forces, actuators=tuple(actuators))
