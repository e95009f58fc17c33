"""Options for loads, motors and initial states."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim import files, units
from mechsim.cli.command import Stated
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import ModelOptions, pairs
from mechsim.cli.output import print_table, print_text
from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import DynamicModel, dynamic_model
from mechsim.mechanism import motors
from mechsim.mechanism.forces import Couple, Forces, Load, forces_of
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.load_profile import Over, table
from mechsim.mechanism.masses import LinkMass, summary
from mechsim.mechanism.motors import Controller, Geared, Motor, PlainMotor
from mechsim.studies.release import DURATION, Release
from mechsim.units import option

# kind -> its form, class, and the units of its numbers
MOTORS: dict[str, tuple[str, type[PlainMotor], tuple[units.Unit, ...]]] = {
    "constant": ("constant:TORQUE in N m", motors.ConstantTorque, ("N m",)),
    "line": ("line:STALL in N m,NO-LOAD speed", motors.TorqueSpeedLine, ("N m", "rad/s")),
    "dc": ("dc:VOLTAGE in V,RESISTANCE in ohm,CONSTANT in N m/A", motors.DCMotor, ("V", "ohm", "N m/A")),
}


def gravity_of(text: str) -> tuple[float, float, float]:
    """Return the acceleration of gravity, three numbers in [m/s2]."""
    try:
        x, y, z = units.parse_vector(text, "m/s^2", "--gravity")
    except ValueError:
        raise InputError(f"--gravity is {text!r}; give three numbers in m/s2, as in 0,0,-9.81") from None
    return x, y, z


def motor_of(text: str) -> Motor | Controller:
    """Return a motor of the crank written as KIND:NUMBERS, or a torque on a joint written as J=EXPRESSION.

    One number more than a kind has is the gear ratio.
    """
    joint, equals, expression = text.partition("=")
    if equals and joint.strip():
        return Controller(joint.strip(), expression)
    kind, _, rest = text.partition(":")
    numbers = rest.split(",") if rest else []
    _, motor, kinds = MOTORS.get(kind, ("", None, ()))
    if motor is None or len(numbers) not in (len(kinds), len(kinds) + 1):
        kinds_text = ", ".join(row[0] for row in MOTORS.values())
        raise InputError(
            f"--motor is {text!r}; write {kinds_text}, each with a gear ratio if there is one, or "
            "J=EXPRESSION, as in crank=-20*crank.q-2*crank.v"
        )
    values = [
        units.parse(number, unit, "--motor") for number, unit in zip(numbers, (*kinds, "1"), strict=False)
    ]
    made = motor(*values[: len(kinds)])
    return made if len(values) == len(kinds) else Geared(made, values[-1])


def loads_of(solver: KinematicSolver, path: str) -> dict[str, Any]:
    """Return loads from a table: angle [rad] or t [s]; P3.fx .. [N], LINK.mx .. [N m], crank [N m]."""
    # the column t may also be called time
    columns = {"t" if name == "time" else name: column for name, column in files.read_in_si(path).items()}
    instants = "angle" if "angle" in columns else "t"
    if instants not in columns:
        raise InputError(
            f"{path!r} has no column angle [rad] or t [s] (it has {', '.join(columns)}); add one"
        )
    points = dict.fromkeys(name.rsplit(".", 1)[0] for name in columns if ".f" in name)
    links = dict.fromkeys(name.rsplit(".", 1)[0] for name in columns if ".m" in name)
    names = {instants, "crank", *(f"{point}.f{axis}" for point in points for axis in "xyz")}
    names |= {f"{link}.m{axis}" for link in links for axis in "xyz"}
    if unknown := sorted(set(columns) - names):
        raise InputError(
            f"{path!r} has columns {', '.join(unknown)}; loads are POINT.fx, POINT.fy, POINT.fz in N, "
            "LINK.mx, LINK.my, LINK.mz and crank in N m"
        )
    if not (points or links or "crank" in columns):
        raise InputError(f"{path!r} holds no load; add columns POINT.fx, POINT.fy, POINT.fz or crank")
    over: Over = "angle" if instants == "angle" else "time"
    periodic = over == "angle" and solver.crank_range().full

    def profile(prefix: str) -> Any:
        zero = np.zeros(len(columns[instants]))
        vectors = np.column_stack([columns.get(prefix + axis, zero) for axis in "xyz"])
        return table(columns[instants], vectors, over=over, periodic=periodic)

    loads: dict[str, Any] = {
        "loads": tuple(Load(point, profile(f"{point}.f")) for point in points),
        "couples": tuple(Couple(link, profile(f"{link}.m")) for link in links),
    }
    if "crank" in columns:
        loads["crank_torque"] = table(columns[instants], columns["crank"], over=over, periodic=periodic)
    return loads


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadOptions:
    """Masses of the links, loads, and motors."""

    gravity: tuple[float, float, float] | None = option(
        None,
        "Acceleration of gravity in m/s2. Default: that of the file, else 0,-9.81,0.",
        read=gravity_of,
    )
    load: str | None = option(
        None,
        "Table of loads: columns angle [rad] or t [s], POINT.fx ... [N], LINK.mx ... [N m], crank [N m].",
        metavar="FILE",
    )
    motor: tuple[Motor | Controller, ...] = option(
        (),
        "Motor of the crank: constant:TORQUE, line:STALL TORQUE,NO-LOAD SPEED or dc:V,OHM,N m/A; a further "
        "number is its gear ratio, turns of the motor per turn of the crank. Or an effort on joint J: "
        "an expression of J.q, J.v and t, in SI.",
        read=motor_of,
        many=True,
        metavar="KIND:NUMBERS|J=EXPRESSION",
    )

    def forces(self, solver: KinematicSolver) -> Forces:
        """Return all forces on a mechanism, from its file and the options."""
        loads: dict[str, Any] = {} if self.load is None else loads_of(solver, self.load)
        own = forces_of(solver)
        controllers = [motor for motor in self.motor if isinstance(motor, Controller)]
        motors = [motor for motor in self.motor if not isinstance(motor, Controller)]
        if len(motors) > 1:
            raise InputError("--motor gives two motors of the crank; give one")
        return replace(
            own,
            gravity=own.gravity if self.gravity is None else self.gravity,
            motor=motors[0] if motors else own.motor,
            controllers=(*own.controllers, *controllers),
            **loads,
        )

    def dynamic_model(self, solver: KinematicSolver) -> DynamicModel:
        """Return the dynamic model of a mechanism; note effects that it omits."""
        read = solver.source
        if read is not None and read.left_out:
            notes.append(f"{solver.name}: left out of the dynamics: {', '.join(read.left_out)}")
        forces = self.forces(solver)
        by_load = {each.joint for each in forces.friction if each.coefficient and not each.bearing_length}
        slides = [joint.name for joint in solver.mechanism.joints if KINDS[joint.kind].units == ("m",)]
        if by_load := [name for name in slides if name in by_load]:
            notes.append(
                f"friction of {', '.join(by_load)}: without bearing_length, bending moments cause none"
            )
        return dynamic_model(solver, forces)


def note_replaced(solver: KinematicSolver) -> None:
    """Note which forces of a file a prescribed motion replaces: its torques are without them."""
    driven = {*solver.mechanism.drivers, *solver.mechanism.locked}
    if replaced := forces_of(solver).replaced_by(driven):
        notes.append(f"{solver.name}: the prescribed motion replaces {', '.join(replaced)} of the file")


def masses_in_json(masses: Sequence[LinkMass]) -> dict[str, Any]:
    """Return the entry of a JSON object; empty if no masses are used."""
    return {"masses": masses} if masses else {}


def print_masses(masses: Sequence[LinkMass], verbose: bool | None = None, design: str = "") -> None:
    """Print the masses and their origin, if there are any.

    Args:
        masses: masses of the links.
        verbose: whether the masses are listed; None for a command without -v.
        design: name of the design with these masses.
    """
    if verbose:
        rows = [(mass.link, mass.mass, "kg", mass.text) for mass in masses]
        print_table("masses", ("link", "mass", "unit", "source"), rows)
    elif masses:
        computed = verbose is not None and any(mass.source == "rod" for mass in masses)
        text = summary(masses).replace("masses", f"masses {design}".rstrip(), 1)
        print_text(text + ("; -v lists them" if computed else ""))


@dataclass(frozen=True, slots=True, kw_only=True)
class InitialOptions:
    """A run from an initial state."""

    initial: tuple[tuple[str, str], ...] = pairs(
        "--initial crank.q=10deg",
        "Initial coordinate J.q or rate J.v of a joint; other independent ones keep their start, at rest. "
        "A bare number is SI, but a length or angle needs its unit where the file is in another one.",
        "J.q=VALUE",
    )
    until: str | None = option(
        None,
        "End the run at this event: P.y=0, J.q=90deg or distance:P,Q=10mm.",
        metavar="QUANTITY=VALUE",
    )

    def release(self, model: DynamicModel, source: ModelOptions, **more: Any) -> Release:
        """Return the release of a model, with `more` fields; its run has a default duration of 1 s."""
        stated: dict[str, Any] = {
            "initial": dict(self.initial),
            "prescribed": tuple(name for name, _ in source.drive),
            "until": self.until,
            "duration": DURATION if source.duration is None else source.duration,
        }
        return Release(model=model, **(stated | more))


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseOptions(InitialOptions):
    """A run from an initial state, or a mode of vibration, for drawing."""

    mode: int | None = option(
        None, "Draw mode of vibration N about the equilibrium; 1 is the slowest.", metavar="N"
    )

    @property
    def requested(self) -> bool:
        """Whether a run or a mode is requested."""
        return bool(self.initial or self.until or self.mode is not None)

    def exclude(self, stated: Stated) -> None:
        """Raise InputError for options that do not change what is drawn of a run or a mode."""
        if self.mode is None:
            stated.exclude(["speed"], "in a run from an initial state")
        else:
            stated.exclude(["speed", "duration", "drive", "track"], "on a mode of vibration")


def released_model(source: ModelOptions, loads: LoadOptions | None = None) -> DynamicModel:
    """Return the dynamic model of a mechanism; --duration sets the duration of its run."""
    loads = LoadOptions() if loads is None else loads
    return loads.dynamic_model(replace(source, duration=None).load(still=True))
