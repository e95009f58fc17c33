"""What acts on a mechanism, as a TOML file says it."""

from collections.abc import Iterator, Mapping
from typing import Any

from mechsim.model.forces import Couple, Forces, Friction, JointSpring, Load, Place, Spring, located
from mechsim.model.joint_kinds import KINDS, KindName
from mechsim.model.links import ORIGIN
from mechsim.model.load_profile import LoadProfile
from mechsim.model.mechanism import Mechanism
from mechsim.model.motors import ConstantTorque, DCMotor, Geared, Motor, TorqueSpeedLine
from mechsim.subjects.checked_values import Values
from mechsim.subjects.force_keys import MOTORS
from mechsim.subjects.key_kinds import Number
from mechsim.subjects.toml_loads import course_of
from mechsim.subjects.toml_source import nearest
from mechsim.units import Unit

GRAVITY = (0.0, -9.81, 0.0)
# by the coordinate's unit: of viscous friction, dry friction, stiffness
_VISCOUS: dict[str, Unit] = {"m": "N s/m", "rad": "N m s/rad"}
_DRY: dict[str, Unit] = {"m": "N", "rad": "N m"}
_STIFFNESS: dict[str, Unit] = {"m": "N/m", "rad": "N m/rad"}


def forces_of(values: Values, mechanism: Mechanism, read: Mapping[str, Any]) -> Forces | None:
    """Return what acts on a mechanism; None where a file says nothing of it."""
    if "forces" not in read:
        return None
    given: dict[str, Any] = read["forces"]
    with values.source.about(("forces",)):
        found = Forces(
            gravity=given.get("gravity", GRAVITY),
            friction=tuple(_frictions(values, mechanism, given)),
            springs=tuple(_springs(values, mechanism, given)),
            joint_springs=tuple(_joint_springs(values, mechanism, given)),
            loads=tuple(_loads(values, mechanism, given)),
            couples=tuple(
                Couple(link, course_of(values, mechanism, moment, "N m", ("forces", "couples", link)))
                for link, moment in given.get("couples", {}).items()
            ),
            crank_torque=_crank_torque(values, mechanism, given),
            flywheel=given.get("flywheel", 0.0),
            motor=_motor(values, given["motor"]) if "motor" in given else None,
        )
        found.check(mechanism)
    return found


def _frictions(values: Values, mechanism: Mechanism, given: Mapping[str, Any]) -> Iterator[Friction]:
    for joint, one in given.get("friction", {}).items():
        path = ("forces", "friction", joint)
        unit = _unit(values, mechanism, joint, path)
        kept = {
            "viscous": values.checked(
                Number(_VISCOUS[unit], ""), one.get("viscous", 0.0), (*path, "viscous")
            ),
            "coulomb": values.checked(Number(_DRY[unit], ""), one.get("coulomb", 0.0), (*path, "coulomb")),
        }
        rest = {key: one[key] for key in ("viscous_turn", "coulomb_turn") if key in one}
        with values.source.about(path):
            yield Friction(joint, **kept, **rest)


def _loads(values: Values, mechanism: Mechanism, given: Mapping[str, Any]) -> Iterator[Load]:
    for name, one in given.get("loads", {}).items():
        with values.source.about(("forces", "loads", name)):
            path = ("forces", "loads", name, "force")
            yield Load(_place(mechanism, one["at"]), course_of(values, mechanism, one["force"], "N", path))


def _crank_torque(values: Values, mechanism: Mechanism, given: Mapping[str, Any]) -> LoadProfile | None:
    if "crank_torque" not in given:
        return None
    return course_of(values, mechanism, (given["crank_torque"],), "N m", ("forces", "crank_torque"))


def _springs(values: Values, mechanism: Mechanism, given: Mapping[str, Any]) -> Iterator[Spring]:
    for table in ("springs", "dampers"):
        for name, one in given.get(table, {}).items():
            with values.source.about(("forces", table, name)):
                a, b = (_place(mechanism, one[side]) for side in "ab")
                yield Spring(a, b, one.get("stiffness", 0.0), one.get("rest", 0.0), one.get("damping", 0.0))


def _joint_springs(values: Values, mechanism: Mechanism, given: Mapping[str, Any]) -> Iterator[JointSpring]:
    for joint, one in given.get("joint_springs", {}).items():
        path = ("forces", "joint_springs", joint)
        unit = _unit(values, mechanism, joint, path)
        stiffness = values.checked(Number(_STIFFNESS[unit], ""), one["stiffness"], (*path, "stiffness"))
        with values.source.about(path):
            rest = values.checked(Number(unit, ""), one.get("rest", 0.0), (*path, "rest"))
            yield JointSpring(joint, stiffness, rest)


def _unit(values: Values, mechanism: Mechanism, joint: str, path: tuple[str, ...]) -> Unit:
    """Return the unit of a joint's first coordinate; of a ball's turning "rad"."""
    kinds: dict[str, KindName] = {one.name: one.kind for one in mechanism.joints}
    if joint not in kinds:
        raise values.source.refusal(path, f"names joint {joint!r}{nearest(joint, kinds)}")
    return "m" if "m" in KINDS[kinds[joint]].units else "rad"


def _place(mechanism: Mechanism, read: Any) -> Place:
    place: Place = read if isinstance(read, str) else (read["link"], read.get("at", ORIGIN))
    located(mechanism, place)
    return place


def _motor(values: Values, one: Mapping[str, Any]) -> Motor:
    path, kind = ("forces", "motor"), one["kind"]
    wanted = MOTORS[kind]
    for key in wanted:
        if key not in one:
            raise values.source.refusal(
                path, f"is of kind {kind!r} and has no {key!r}; give {', '.join(wanted)}"
            )
    for key in one:
        if key not in ("kind", "gear", *wanted):
            raise values.source.refusal((*path, key), f"does not go with kind {kind!r}; take it out")
    numbers = [one[key] for key in wanted]
    made = {"constant": ConstantTorque, "line": TorqueSpeedLine, "dc": DCMotor}[kind](*numbers)
    return Geared(made, one["gear"]) if "gear" in one else made
