"""Forces on a mechanism in a TOML file, and the pitch points at which teeth transmit them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.io.law_text import LoadComponent, combine_components, parse_component
from mechsim.io.toml_coordinates import leaves
from mechsim.io.toml_elements import FileForces, linear_spring, motor_of, require_motor_keys, spring_of
from mechsim.io.toml_links import end_of
from mechsim.io.toml_values import KeyPath, Values, dotted, shown, suggestion
from mechsim.mechanism.actuators import Actuator
from mechsim.mechanism.clearances import Clearance, hertz_stiffness
from mechsim.mechanism.forces import WEIGHT, Couple, Forces, Friction, JointSpring, Load, Spring
from mechsim.mechanism.joint_friction import RADII
from mechsim.mechanism.joint_kinds import KINDS, KindName
from mechsim.mechanism.load_profile import LoadProfile, constant
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.meshes import mesh_of
from mechsim.mechanism.motors import ConstantTorque, Controller, DCMotor, Geared, Motor, TorqueSpeedLine
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring, diagonal
from mechsim.units import ALONG, Unit

# smallest and largest plausible rest length of a spring, in sizes of the mechanism
PLAUSIBLE = (0.01, 10.0)
Written = float | str
# numbers of a friction whose unit does not depend on the coordinate
FRICTION_NUMBERS = (
    *("viscous_turn", "coulomb_turn", "coefficient", "pin_radius", "collar_radius", "bearing_length"),
)
# kind of motor on the crank -> its class, and the keys of its parameters in the order of its fields
MOTORS = {
    "constant": (ConstantTorque, ("torque",)),
    "line": (TorqueSpeedLine, ("stall", "no_load")),
    "dc": (DCMotor, ("voltage", "resistance", "constant")),
}


def forces_of(
    values: Values, mechanism: Mechanism, read: Mapping[str, Any], stops: Sequence[NonlinearSpring]
) -> Forces | None:
    """Return the forces on a mechanism, with those of its stops; None if the file defines none."""
    losses, clearances = tuple(_losses(values, mechanism, read)), tuple(_clearances(values, read))
    table: dict[str, Any] = read.get("forces", {})
    friction = {
        name: (("forces", "friction", name), entry) for name, entry in table.get("friction", {}).items()
    }
    for joint, entry in read.get("joints", {}).items():
        if "friction" in entry and joint in friction:
            reason = f"is also given in joints.{joint}.friction; leave one of them out"
            raise values.source.error(friction[joint][0], reason)
        if "friction" in entry:
            friction[joint] = ("joints", joint, "friction"), entry["friction"]
    if not (table or "forces" in read or friction or stops or losses or clearances):
        return None
    file = FileForces(values, mechanism, table)
    with values.source.error_context(("forces",)):
        springs, motors = file.each("springs", spring_of), file.each("motors", motor_of)
        controllers = list[Controller]()
        for path, text in leaves(table.get("controllers", {}), ("forces", "controllers")):
            with values.source.error_context(path):
                controllers.append(Controller(".".join(path[2:]), text))
        torque = None
        if "crank_torque" in table:
            path = ("forces", "crank_torque")
            torque = load_profile_of(file, (table["crank_torque"],), "N m", path)
        forces = Forces(
            gravity=table.get("gravity", WEIGHT.gravity),
            friction=(
                *(_friction(file, joint, entry, path) for joint, (path, entry) in friction.items()),
                *losses,
            ),
            springs=(
                *(each for each in springs if isinstance(each, Spring)),
                *file.each("dampers", linear_spring),
            ),
            joint_springs=tuple(file.each("joint_springs", _joint_spring)),
            nonlinear_springs=(*stops, *(each for each in springs if isinstance(each, NonlinearSpring))),
            bushings=tuple(file.each("bushings", _bushing)),
            clearances=clearances,
            loads=tuple(file.each("loads", _load)),
            couples=tuple(file.each("couples", _couple)),
            crank_torque=torque,
            flywheel=table.get("flywheel", 0.0),
            motor=_motor(values, table["motor"]) if "motor" in table else None,
            controllers=(*controllers, *(each for each in motors if isinstance(each, Controller))),
            actuators=tuple(each for each in motors if isinstance(each, Actuator)),
            armature={
                ".".join(p[2:]): x for p, x in leaves(table.get("armature", {}), ("forces", "armature"))
            },
        )
        forces.check(mechanism)
    return forces


def _losses(values: Values, mechanism: Mechanism, read: Mapping[str, Any]) -> Iterator[Friction]:
    """Yield the frictions of couplings with an efficiency; reject teeth without a pitch point."""
    for name, table in read.get("couplings", {}).items():
        if not (table.get("pressure_angle") or "efficiency" in table):
            continue
        sides, laws = (table["driven"], table.get("driver", {})), mechanism.named_laws.items()
        label, law = next((label, law) for label, law in laws if (law.left, law.right) == sides)
        if table.get("pressure_angle") and mesh_of(mechanism, law) is None:
            reason = (
                "is of teeth, and this coupling has no pitch point; couple two hinges whose axes are "
                "parallel or intersect, or a hinge and a slide perpendicular to it, on the same link, or "
                "leave it out"
            )
            raise values.source.error(("couplings", name, "pressure_angle"), reason)
        if "efficiency" in table:
            with values.source.error_context(("couplings", name, "efficiency")):
                yield Friction.of_efficiency(mechanism, label, table["efficiency"])


def _friction(file: FileForces, joint: str, entry: Mapping[str, Any], path: KeyPath) -> Friction:
    unit, values = _unit(file, joint, path), file.values
    along = ALONG[unit]
    units: dict[str, Unit] = {
        "viscous": along["damping"],
        "coulomb": along["force"],
        "static": "1" if "coefficient" in entry else along["force"],
        "stribeck": along["rate"],
        "bristle_stiffness": along["stiffness"],
        "bristle_damping": along["damping"],
    }
    first = {key: values.quantity(entry[key], units[key], (*path, key)) for key in units if key in entry}
    others = {key: entry[key] for key in FRICTION_NUMBERS if key in entry}
    if "coefficient" not in entry and (unused := [key for key in RADII if key in entry]):
        raise values.source.error((*path, unused[0]), "has no effect without a coefficient; give one")
    with values.source.error_context(path):
        friction = Friction(joint, **first, **others)
        friction.check(file.mechanism.joint(joint))
    return friction


def _load(file: FileForces, _: str, entry: Mapping[str, Any], path: KeyPath) -> Load:
    force = load_profile_of(file, entry["force"], "N", (*path, "force"))
    return Load(file.point(entry["at"]), force)


def _couple(file: FileForces, link: str, moment: Sequence[Written], path: KeyPath) -> Couple:
    return Couple(link, load_profile_of(file, moment, "N m", path))


def facts_of(values: Values, mechanism: Mechanism, forces: Forces | None) -> tuple[str, ...]:
    """Return questions about rest lengths that fit the mechanism in metres only, and where clearances act."""
    facts, scale = list[str](), values.in_si(1.0, "m")
    straight = {joint.name for joint in mechanism.joints if "m" in KINDS[joint.kind].units}
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
    if forces is not None and forces.clearances:
        free = ", ".join(clearance.joint for clearance in forces.clearances)
        facts.append(
            f"the pin of {free} is free in its hole in runs from an initial state (dynamics forward), and "
            "at its centre elsewhere"
        )
    return tuple(facts)


def _joint_spring(file: FileForces, joint: str, entry: Mapping[str, Any], path: KeyPath) -> JointSpring:
    unit, values = _unit(file, joint, path), file.values
    stiffness = values.quantity(entry["stiffness"], ALONG[unit]["stiffness"], (*path, "stiffness"))
    return JointSpring(joint, stiffness, values.quantity(entry.get("rest", 0.0), unit, (*path, "rest")))


def _bushing(file: FileForces, name: str, entry: Mapping[str, Any], path: KeyPath) -> Bushing:
    matrices: dict[str, Any] = {}
    for key in ("stiffness", "damping"):
        written = entry.get(key, ())
        rows = [isinstance(row, tuple) for row in written]
        if any(rows) and not all(rows):
            reason = "mixes numbers and rows; give six numbers, or six rows of six"
            raise file.values.source.error((*path, key), reason)
        if all(rows):
            matrices |= {key: written} if written else {}
            continue
        # a diagonal has units of displacements and rotations
        units: list[Unit] = [ALONG[unit][key] for unit in ("m",) * 3 + ("rad",) * 3]
        numbers = enumerate(zip(written, units, strict=True))
        matrices[key] = diagonal(
            *(file.values.quantity(x, unit, (*path, key, i)) for i, (x, unit) in numbers)
        )
    return Bushing(name, end_of(entry["a"]), end_of(entry["b"]), **matrices)


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


def _unit(file: FileForces, joint: str, path: KeyPath) -> Unit:
    """Return the unit of a joint's first coordinate; "rad" for a spherical joint."""
    kinds: dict[str, KindName] = {joint_.name: joint_.kind for joint_ in file.mechanism.joints}
    if joint not in kinds:
        raise file.values.source.error(path, f"names joint {joint!r}{suggestion(joint, kinds)}")
    return "m" if "m" in KINDS[kinds[joint]].units else "rad"


def _motor(values: Values, table: Mapping[str, Any]) -> Motor:
    make, required = MOTORS[table["kind"]]
    require_motor_keys(values, table, ("forces", "motor"), required, ("gear",))
    motor = make(*(table[key] for key in required))
    return Geared(motor, table["gear"]) if "gear" in table else motor


def load_profile_of(file: FileForces, written: Sequence[Written], unit: str, path: KeyPath) -> LoadProfile:
    """Return the load profile of a load.

    Args:
        file: the forces of its file.
        written: one component of the crank's torque, else three, as checked by a key `Profile`.
        unit: "N" or "N m".
        path: its key path.

    Raises:
        InputError: for text that is no load; names file, line, key, value and remedy.
    """
    single = len(written) == 1
    components = [
        _component(file, component, name, unit, path if single else (*path, i))
        for i, (name, component) in enumerate(zip(("crank",) if single else "xyz", written, strict=True))
    ]
    try:
        return combine_components(components)
    except InputError as error:
        raise file.values.source.error(path, str(error)) from None


def _component(file: FileForces, written: Written, name: str, unit: str, path: KeyPath) -> LoadComponent:
    if not isinstance(written, str):
        return LoadComponent(written, constant(written))
    values, from_file = file.values, is_table(written)
    try:
        text = values.source.sibling(written) if from_file else written
        component = parse_component(text, name, unit, values.parameters)
    except InputError as error:
        link = ": " if from_file else ", which "
        raise values.source.error(path, f"is {shown(written)}{link}{error}") from None
    if component.profile.over == "angle" and not file.mechanism.has_crank:
        drivers = ", ".join(file.mechanism.drivers)
        reason = (
            f"is {shown(written)}, but with the drivers {drivers} there is no crank angle; give it over t"
        )
        raise values.source.error(path, reason)
    return component
