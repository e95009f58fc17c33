"""What a machine is made of and what acts on it, as the command line says it: text to `Forces`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeVar

import numpy as np
import typer
from numpy.typing import NDArray

from mechsim import files, units
from mechsim.analytic import dynamics
from mechsim.analytic.forms import Form
from mechsim.cli.output import print_table
from mechsim.errors import InputError
from mechsim.model import motors
from mechsim.model.forces import Couple, Forces, Friction, JointSpring, Load, Location, Spring
from mechsim.model.load_profile import table
from mechsim.model.masses import LinkMass, summary
from mechsim.model.motors import Geared, PlainMotor
from mechsim.units import option

Element = TypeVar("Element")
# where nothing is said
WEIGHT = (0.0, -9.81, 0.0)
MOTORS = {
    "constant": "constant:TORQUE in N m",
    "line": "line:STALL in N m,NO-LOAD speed",
    "dc": "dc:VOLTAGE in V,RESISTANCE in ohm,CONSTANT in N m/A",
}


def gravity_of(text: str) -> tuple[float, float, float]:
    """Return the acceleration of gravity, three numbers in [m/s2]."""
    given = units.parse_vector(text, "1", "--gravity")
    if len(given) != 3:
        raise InputError(f"--gravity is {text!r}, {len(given)} numbers; give three in m/s2, with commas")
    return given[0], given[1], given[2]


def motor_of(text: str) -> PlainMotor:
    """Return a motor written as KIND:NUMBERS."""
    kind, _, rest = text.partition(":")
    parts = rest.split(",") if rest else []
    wanted = {"constant": 1, "line": 2, "dc": 3}.get(kind)
    if wanted != len(parts):
        raise InputError(f"--motor is {text!r}; write {', '.join(MOTORS.values())}")
    if kind == "line":
        stall = units.parse(parts[0], "1", "stall torque of --motor")
        return motors.TorqueSpeedLine(stall, units.parse_speed(parts[1], "no-load speed of --motor"))
    values = [units.parse(part, "1", "--motor") for part in parts]
    return motors.ConstantTorque(values[0]) if kind == "constant" else motors.DCMotor(*values)


def friction_of(text: str) -> Friction:
    """Return friction written as JOINT=VISCOUS or JOINT=VISCOUS,COULOMB, in SI; of a sleeve four numbers."""
    joint, values = _named(text, "--friction", (1, 2, 4), "JOINT=VISCOUS,COULOMB", "crank=1e-4,2e-3")
    return Friction(joint, *values)


def spring_of(text: str) -> Spring | JointSpring:
    """Return a spring written as A:B=STIFFNESS,REST between places, or JOINT=STIFFNESS,REST in a joint."""
    form = "A:B=STIFFNESS,REST or JOINT=STIFFNESS,REST"
    name, values = _named(text, "--spring", (1, 2), form, "P3:ground@0,0.1,0=500,0.05")
    if ":" in name:
        return Spring(*_places(name, "--spring"), *values)
    return JointSpring(name, *values)


def damper_of(text: str) -> Spring | Friction:
    """Return a damper written as A:B=DAMPING between places, or JOINT=DAMPING in a joint."""
    form = "A:B=DAMPING or JOINT=DAMPING"
    name, values = _named(text, "--damper", (1,), form, "P3:ground@0,0.1,0=2")
    if ":" in name:
        return Spring(*_places(name, "--damper"), 0.0, 0.0, values[0])
    return Friction(name, values[0])


def _named(
    text: str, option: str, counts: tuple[int, ...], form: str, example: str
) -> tuple[str, tuple[float, ...]]:
    """Return the name and the numbers of an option written as NAME=NUMBERS."""
    name, equals, rest = text.partition("=")
    values = units.parse_vector(rest, "1", option) if equals else ()
    if len(values) not in counts:
        raise InputError(f"{option} is {text!r}; write {form} in SI, as in {example}")
    return name.strip(), tuple(values)


def _places(text: str, option: str) -> tuple[Location, Location]:
    """Return two places written as A:B; each a point, or LINK@X,Y,Z in the link's frame."""

    def place(part: str) -> Location:
        link, at, rest = part.strip().partition("@")
        if not at:
            return link
        x = units.parse_vector(rest, "m", option)
        if len(x) != 3:
            raise InputError(f"{option} has a place {part!r}; write LINK@X,Y,Z in m")
        return link, (x[0], x[1], x[2])

    first, _, second = text.partition(":")
    return place(first), place(second)


def loads_of(drive: Form, path: str) -> dict[str, Any]:
    """Return loads from a table: angle [rad] or time [s]; P3.fx .. [N], LINK.mx .. [N m], crank [N m]."""
    columns = files.read(path)
    over = "angle" if "angle" in columns else "time"
    if over not in columns:
        raise InputError(
            f"{path!r} has no column angle [rad] or time [s] (it has {', '.join(columns)}); add one"
        )
    at = columns[over]
    points = dict.fromkeys(name.rsplit(".", 1)[0] for name in columns if ".f" in name)
    links = dict.fromkeys(name.rsplit(".", 1)[0] for name in columns if ".m" in name)
    known = {over, "crank", *(f"{point}.f{axis}" for point in points for axis in "xyz")}
    known |= {f"{link}.m{axis}" for link in links for axis in "xyz"}
    if strange := sorted(set(columns) - known):
        raise InputError(
            f"{path!r} has columns {', '.join(strange)}; loads are POINT.fx, POINT.fy, POINT.fz in N, "
            "LINK.mx, LINK.my, LINK.mz and crank in N m"
        )
    repeats = over == "angle" and drive.crank_range().full
    made: dict[str, Any] = {
        "loads": tuple(
            Load(point, table(at, _vectors(columns, f"{point}.f", len(at)), over=over, periodic=repeats))
            for point in points
        ),
        "couples": tuple(
            Couple(link, table(at, _vectors(columns, f"{link}.m", len(at)), over=over, periodic=repeats))
            for link in links
        ),
    }
    if "crank" in columns:
        made["crank_torque"] = table(at, columns["crank"], over=over, periodic=repeats)
    if not (points or links or "crank" in columns):
        raise InputError(f"{path!r} holds no load; add columns POINT.fx, POINT.fy, POINT.fz or crank")
    return made


def _vectors(columns: Mapping[str, "NDArray[np.float64]"], what: str, rows: int) -> NDArray[np.float64]:
    return np.column_stack([columns.get(what + axis, np.zeros(rows)) for axis in "xyz"])


def _of(kind: type[Element], elements: Sequence[object]) -> Iterator[Element]:
    return (one for one in elements if isinstance(one, kind))


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineOptions:
    """What the links are made of, and what acts on them."""

    gravity: tuple[float, float, float] = option(
        WEIGHT,
        "Three numbers in m/s2, with commas; a file's own if it says so.",
        read=gravity_of,
        text="0,-9.81,0",
    )
    load: str | None = option(
        None, "Loads: angle [rad] or time [s], POINT.fx.. [N], LINK.mx.., crank [N m].", metavar="FILE"
    )
    motor: PlainMotor | None = option(
        None,
        "constant:N m, line:N m,no-load speed or dc:V,ohm,N m/A; the machine runs free from rest, "
        "with --free from --speed.",
        read=motor_of,
    )
    gear: float | None = option(None, "Turns of the motor per turn of the crank, by a gear between.")
    friction: tuple[Friction, ...] = option(
        (), "Friction in a joint, SI.", read=friction_of, many=True, metavar="JOINT=VISCOUS,COULOMB"
    )
    spring: tuple[Spring | JointSpring, ...] = option(
        (),
        "A spring between points, or places LINK@X,Y,Z; JOINT=STIFFNESS,REST in a joint. SI.",
        read=spring_of,
        many=True,
        metavar="A:B=STIFFNESS,REST",
    )
    damper: tuple[Spring | Friction, ...] = option(
        (),
        "A damper, likewise between points or in a joint. SI.",
        read=damper_of,
        many=True,
        metavar="A:B=DAMPING",
    )
    flywheel: float = option(0.0, "Moment of inertia on the crank, kg m2.")
    density: float = option(7850.0, "Of links, which are round rods, kg/m3.")
    diameter: float | None = option(None, "Of those rods; 0.05 of the size if left out.", unit="m")

    def __post_init__(self) -> None:
        if self.gear is not None and self.motor is None:
            raise InputError("--gear is the gear of a motor, and none is given; add --motor")

    def forces(self, drive: Form) -> Forces:
        """Return all that acts on a mechanism: what its file says, and what is given beside it."""
        loads: dict[str, Any] = {} if self.load is None else loads_of(drive, self.load)
        motor = self.motor
        if motor is not None and self.gear is not None:
            motor = Geared(motor, self.gear)
        elastic = (*self.spring, *self.damper)
        told = drive.forces
        file = told or Forces(gravity=self.gravity)
        return replace(
            file,
            gravity=file.gravity if self.gravity == WEIGHT else self.gravity,
            friction=(*file.friction, *self.friction, *_of(Friction, elastic)),
            springs=(*file.springs, *_of(Spring, elastic)),
            joint_springs=(*file.joint_springs, *_of(JointSpring, elastic)),
            flywheel=self.flywheel or file.flywheel,
            motor=motor or file.motor,
            **loads,
        )

    def machine(self, drive: Form) -> dynamics.Machine:
        """Return a mechanism with links that weigh and all that acts on it."""
        return dynamics.machine(drive, self.forces(drive), density=self.density, diameter=self.diameter)


Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="List the masses of the links, too.")]


def print_masses(masses: Sequence[LinkMass], verbose: bool | None = None, of: str = "") -> None:
    """Print the masses and where they come from.

    Args:
        masses: of the links; nothing is printed where there are none.
        verbose: whether they are listed; None where a command has no -v.
        of: what has these masses, where a command computes with several.
    """
    if not masses:
        return
    if not verbose:
        hint = "; -v lists them" if verbose is not None and any(one.source == "rod" for one in masses) else ""
        typer.echo(summary(masses).replace("masses", f"masses {of}".rstrip(), 1) + hint)
        return
    rows = [(one.link, f"{one.mass:.6g}", "kg", one.text) for one in masses]
    print_table("masses", ("link", "mass", "unit", "source"), rows)
