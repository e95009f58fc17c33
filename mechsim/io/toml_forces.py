"""Forces on a mechanism in a TOML file, and the pitch points at which teeth transmit them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.io.law_text import LoadComponent, combine_components, parse_component
from mechsim.io.toml_coordinates import leaves
from mechsim.io.toml_links import end_of
from mechsim.io.toml_motors import actuators_of, expression_controllers, require_motor_keys
from mechsim.io.toml_springs import nonlinear_springs_of, point_of, springs_of
from mechsim.io.toml_values import KeyPath, TomlSource, Values, dotted, shown, suggestion
from mechsim.mechanism.clearances import Clearance, hertz_stiffness
from mechsim.mechanism.forces import (
    WEIGHT,
    Couple,
    Forces,
    Friction,
    JointSpring,
    Load,
)
from mechsim.mechanism.joint_friction import RADII
from mechsim.mechanism.joint_kinds import KINDS, KindName
from mechsim.mechanism.load_profile import LoadProfile, constant
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.meshes import mesh_of
from mechsim.mechanism.motors import ConstantTorque, Controller, DCMotor, Geared, Motor, TorqueSpeedLine
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring, diagonal
from mechsim.units import Unit

# smallest and largest plausible rest length of a spring, in sizes of the mechanism
PLAUSIBLE = (0.01, 10.0)
# unit of the coordinate -> unit of viscous friction, Coulomb friction and stiffness
_VISCOUS: dict[str, Unit] = {"m": "N s/m", "rad": "N m s/rad"}
_COULOMB: dict[str, Unit] = {"m": "N", "rad": "N m"}
# other numbers of a friction
FRICTION_NUMBERS = (
    *("viscous_turn", "coulomb_turn", "coefficient", "pin_radius", "collar_radius", "bearing_length"),
)
_STIFFNESS: dict[str, Unit] = {"m": "N/m", "rad": "N m/rad"}
# kind of motor on the crank -> its class, and the keys of its parameters
_MOTORS = {
    "constant": (ConstantTorque, ("torque",)),
    "line": (TorqueSpeedLine, ("stall", "no_load")),
    "dc": (DCMotor, ("voltage", "resistance", "constant")),
}


def forces_of(
    values: Values, mechanism: Mechanism, read: Mapping[str, Any], stops: Sequence[NonlinearSpring]
) -> Forces | None:
    """Return the forces on a mechanism, with those of its stops; None if the file defines none."""
    rubbing = {
        name: joint["friction"] for name, joint in read.get("joints", {}).items() if "friction" in joint
    }
    losses, clearances = tuple(_losses(values, mechanism, read)), tuple(_clearances(values, read))
    if "forces" not in read and not rubbing and not stops and not losses and not clearances:
        return None
    table: dict[str, Any] = read.get("forces", {})
    for joint in rubbing.keys() & table.get("friction", {}).keys():
        path = ("forces", "friction", joint)
        raise values.source.error(path, f"is also given in joints.{joint}.friction; leave one of them out")
    with values.source.error_context(("forces",)):
        forces = Forces(
            gravity=table.get("gravity", WEIGHT.gravity),
            friction=(
                *_frictions(values, mechanism, table.get("friction", {}), ("forces", "friction")),
                *_frictions(values, mechanism, rubbing, ("joints",), ("friction",)),
                *losses,
            ),
            springs=tuple(springs_of(values, mechanism, table)),
            joint_springs=tuple(_joint_springs(values, mechanism, table)),
            nonlinear_springs=(*stops, *nonlinear_springs_of(values, mechanism, table)),
            bushings=tuple(_bushings(values, table)),
            clearances=clearances,
            loads=tuple(_loads(values, mechanism, table)),
            couples=tuple(
                Couple(link, load_profile_of(values, mechanism, moment, "N m", ("forces", "couples", link)))
                for link, moment in table.get("couples", {}).items()
            ),
            crank_torque=_crank_torque(values, mechanism, table),
            flywheel=table.get("flywheel", 0.0),
            motor=_motor(values, table["motor"]) if "motor" in table else None,
            controllers=(*_controllers(values, table), *expression_controllers(values, table)),
            actuators=tuple(actuators_of(values, mechanism, table)),
            armature={
                ".".join(p[2:]): x for p, x in leaves(table.get("armature", {}), ("forces", "armature"))
            },
        )
        forces.check(mechanism)
    return forces


def _losses(values: Values, mechanism: Mechanism, read: Mapping[str, Any]) -> Iterator[Friction]:
    """Yield the frictions of couplings with an efficiency."""
    for name, table in read.get("couplings", {}).items():
        if "efficiency" in table:
            sides = table["driven"], table.get("driver", {})
            laws = mechanism.named_laws.items()
            label = next(label for label, law in laws if (law.left, law.right) == sides)
            with values.source.error_context(("couplings", name, "efficiency")):
                yield Friction.of_efficiency(mechanism, label, table["efficiency"])


def require_pitch_points(source: TomlSource, mechanism: Mechanism, read: Mapping[str, Any]) -> None:
    """Raise InputError for a pressure angle of a coupling without a pitch point."""
    for name, table in read.get("couplings", {}).items():
        if not table.get("pressure_angle"):
            continue
        sides = table["driven"], table.get("driver", {})
        law = next(law for law in mechanism.laws if (law.left, law.right) == sides)
        if mesh_of(mechanism, law) is None:
            reason = (
                "is of teeth, and this coupling has no pitch point; couple two hinges whose axes are "
                "parallel or intersect, or a hinge and a slide perpendicular to it, on the same link, or "
                "leave it out"
            )
            raise source.error(("couplings", name, "pressure_angle"), reason)


def _frictions(
    values: Values, mechanism: Mechanism, tables: Mapping[str, Any], before: KeyPath, after: KeyPath = ()
) -> Iterator[Friction]:
    """Yield the frictions of joints, whose tables have the key path before, joint, after."""
    for joint, entry in tables.items():
        path = (*before, joint, *after)
        unit = _unit(values, mechanism, joint, path)
        units: dict[str, Unit] = {
            "viscous": _VISCOUS[unit],
            "coulomb": _COULOMB[unit],
            "static": "1" if "coefficient" in entry else _COULOMB[unit],
            "stribeck": "m/s" if unit == "m" else "rad/s",
            "bristle_stiffness": _STIFFNESS[unit],
            "bristle_damping": _VISCOUS[unit],
        }
        first = {key: values.quantity(entry[key], units[key], (*path, key)) for key in units if key in entry}
        others = {key: entry[key] for key in FRICTION_NUMBERS if key in entry}
        if "coefficient" not in entry and (unused := [key for key in RADII if key in entry]):
            raise values.source.error((*path, unused[0]), "has no effect without a coefficient; give one")
        with values.source.error_context(path):
            friction = Friction(joint, **first, **others)
            friction.check(mechanism.joint(joint))
        yield friction


def _loads(values: Values, mechanism: Mechanism, table: Mapping[str, Any]) -> Iterator[Load]:
    for name, entry in table.get("loads", {}).items():
        with values.source.error_context(("forces", "loads", name)):
            path = ("forces", "loads", name, "force")
            yield Load(
                point_of(mechanism, entry["at"]),
                load_profile_of(values, mechanism, entry["force"], "N", path),
            )


def _crank_torque(values: Values, mechanism: Mechanism, table: Mapping[str, Any]) -> LoadProfile | None:
    if "crank_torque" not in table:
        return None
    return load_profile_of(values, mechanism, (table["crank_torque"],), "N m", ("forces", "crank_torque"))


def facts_of(values: Values, mechanism: Mechanism, forces: Forces | None) -> tuple[str, ...]:
    """Return sentences on lengths without a unit, and on where clearances act."""
    facts, free = _implausible_lengths(values, mechanism), () if forces is None else forces.clearances
    if free:
        names = ", ".join(clearance.joint for clearance in free)
        facts.append(
            f"the pin of {names} is free in its hole in runs from an initial state (dynamics forward), and "
            "at its centre elsewhere"
        )
    return tuple(facts)


def _implausible_lengths(values: Values, mechanism: Mechanism) -> list[str]:
    """Return questions about rest lengths without a unit that fit the mechanism in metres only."""
    scale = values.in_si(1.0, "m")
    straight = {joint.name for joint in mechanism.joints if "m" in KINDS[joint.kind].units}
    facts: list[str] = []
    for table, names in (("springs", None), ("joint_springs", straight)):
        for name, entry in values.source.document.get("forces", {}).get(table, {}).items():
            rest, path = entry.get("rest", 0.0), ("forces", table, name, "rest")
            if not isinstance(rest, int | float) or not rest or (names is not None and name not in names):
                continue
            extent = mechanism.characteristic_length
            if scale * abs(rest) < PLAUSIBLE[0] * extent <= abs(rest) <= PLAUSIBLE[1] * extent:
                facts.append(
                    f"line {values.source.line(path)}: {dotted(path)} is {rest:g} {values.length} in a "
                    f"mechanism of {extent:.2g} m; was '{rest:g} m' meant?"
                )
    return facts


def _controllers(values: Values, table: Mapping[str, Any]) -> Iterator[Controller]:
    for path, text in leaves(table.get("controllers", {}), ("forces", "controllers")):
        with values.source.error_context(path):
            yield Controller(".".join(path[2:]), text)


def _joint_springs(values: Values, mechanism: Mechanism, table: Mapping[str, Any]) -> Iterator[JointSpring]:
    for joint, entry in table.get("joint_springs", {}).items():
        path = ("forces", "joint_springs", joint)
        unit = _unit(values, mechanism, joint, path)
        stiffness = values.quantity(entry["stiffness"], _STIFFNESS[unit], (*path, "stiffness"))
        with values.source.error_context(path):
            rest = values.quantity(entry.get("rest", 0.0), unit, (*path, "rest"))
            yield JointSpring(joint, stiffness, rest)


def _bushings(values: Values, table: Mapping[str, Any]) -> Iterator[Bushing]:
    for name, entry in table.get("bushings", {}).items():
        path = ("forces", "bushings", name)
        matrices = {
            key: _six_by_six(values, entry[key], units, (*path, key))
            for key, units in (("stiffness", _STIFFNESS), ("damping", _VISCOUS))
            if key in entry
        }
        with values.source.error_context(path):
            yield Bushing(name, end_of(entry["a"]), end_of(entry["b"]), **matrices)


def _clearances(values: Values, read: Mapping[str, Any]) -> Iterator[Clearance]:
    """Yield the clearances of joints: by their radius or those of hole and pin, and by their material."""
    tables = {
        name: {**joint["clearance"]} for name, joint in read.get("joints", {}).items() if "clearance" in joint
    }
    for name, entry in tables.items():
        path, radii = ("joints", name, "clearance"), {"hole_radius", "pin_radius"}
        if {"radius", *radii} & {*entry} not in ({"radius"}, radii):
            raise values.source.error(path, "needs radius alone, or hole_radius and pin_radius; give these")
        hole, pin = entry.pop("hole_radius", 0.0), entry.pop("pin_radius", 0.0)
        material = {key: entry.pop(key) for key in ("young", "poisson") if key in entry}
        if material and ("young" not in material or not hole or "stiffness" in entry):
            reason = (
                "needs young, hole_radius and pin_radius for a stiffness by Hertz, or stiffness; give these"
            )
            raise values.source.error(path, reason)
        with values.source.error_context(path):
            if material:
                entry["stiffness"] = hertz_stiffness(hole, pin, **{"poisson": 0.3, **material})
            yield Clearance(name, **({"radius": hole - pin} | entry))


def _six_by_six(
    values: Values, written: Sequence[Any], units: Mapping[str, Unit], path: KeyPath
) -> tuple[tuple[float, ...], ...]:
    """Return a matrix from its diagonal, with units of displacements and rotations, or from its rows."""
    rows = [isinstance(entry, tuple) for entry in written]
    if all(rows):
        return tuple(written)
    if any(rows):
        raise values.source.error(path, "mixes numbers and rows; give six numbers, or six rows of six")
    along = ("m",) * 3 + ("rad",) * 3
    return diagonal(
        *(
            values.quantity(entry, units[unit], (*path, i))
            for i, (entry, unit) in enumerate(zip(written, along, strict=True))
        )
    )


def _unit(values: Values, mechanism: Mechanism, joint: str, path: KeyPath) -> Unit:
    """Return the unit of a joint's first coordinate; "rad" for a spherical joint."""
    kinds: dict[str, KindName] = {joint_.name: joint_.kind for joint_ in mechanism.joints}
    if joint not in kinds:
        raise values.source.error(path, f"names joint {joint!r}{suggestion(joint, kinds)}")
    return "m" if "m" in KINDS[kinds[joint]].units else "rad"


def _motor(values: Values, table: Mapping[str, Any]) -> Motor:
    make, required = _MOTORS[table["kind"]]
    require_motor_keys(values, table, ("forces", "motor"), required, ("gear",))
    motor = make(*(table[key] for key in required))
    return Geared(motor, table["gear"]) if "gear" in table else motor


Written = float | str


def load_profile_of(
    values: Values, mechanism: Mechanism, written: Sequence[Written], unit: str, path: KeyPath
) -> LoadProfile:
    """Return the load profile of a load.

    Args:
        values: reader of the file's numbers.
        mechanism: the mechanism.
        written: one component of the crank's torque, else three, as checked by a key `Profile`.
        unit: "N" or "N m".
        path: its key path.

    Raises:
        InputError: for text that is no load; names file, line, key, value and remedy.
    """
    single = len(written) == 1
    components = [
        _component(values, mechanism, component, name, unit, path if single else (*path, i))
        for i, (name, component) in enumerate(zip(("crank",) if single else "xyz", written, strict=True))
    ]
    try:
        return combine_components(components)
    except InputError as error:
        raise values.source.error(path, str(error)) from None


def _component(
    values: Values, mechanism: Mechanism, written: Written, name: str, unit: str, path: KeyPath
) -> LoadComponent:
    if not isinstance(written, str):
        return LoadComponent(written, constant(written))
    from_file = is_table(written)
    try:
        text = values.source.sibling(written) if from_file else written
        component = parse_component(text, name, unit, values.parameters)
    except InputError as error:
        link = ": " if from_file else ", which "
        raise values.source.error(path, f"is {shown(written)}{link}{error}") from None
    if component.profile.over == "angle" and not mechanism.has_crank:
        drivers = ", ".join(mechanism.drivers)
        reason = (
            f"is {shown(written)}, but with the drivers {drivers} there is no crank angle; give it over t"
        )
        raise values.source.error(path, reason)
    return component
