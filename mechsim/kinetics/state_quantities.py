"""Quantities of a state by name, such as P.x, J.v or distance:P,Q: events and outputs of responses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from mechsim import units
from mechsim.errors import InputError
from mechsim.kinematics.loops.kinematics import Coordinates, twists
from mechsim.kinematics.loops.record import tracked_points, tree_joint_motions
from mechsim.kinetics.compiled_motion import NOTHING, Watched
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.kinetics.initial_state import StateLayout
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import LinkMotion, Motion, leading_joint
from mechsim.mechanism.quantities import numeric_quantity
from mechsim.mechanism.quantity import Quantity, record_columns
from mechsim.numerics.arrays import Array, cross, wrapped


def motion_of(
    equations: EquationsOfMotion,
    state: Kinematics,
    accelerations: Array | None,
    times: Array,
    only: Quantity | None = None,
) -> Motion:
    """Return the motion of links, joints and points at n states and their accelerations, (count, n), or none.

    If `only` a quantity is needed, it contains the first driver, and the joints and points of that.
    """
    tree, mechanism = equations.loops.tree, equations.model.mechanism
    names, scale = None, equations.loops.units[:, None]
    if only is not None:
        names = {*only.subjects("joint"), *only.subjects("point"), *mechanism.drivers[:1]}
    second, spatial = np.zeros_like(state.rates), np.zeros_like(state.twist)
    if accelerations is not None:
        second = accelerations * scale
        spatial = state.bias + twists(tree, state.poses, second)
    origins, rotations = state.poses.position.transpose(0, 2, 1), state.poses.rotation.transpose(0, 3, 1, 2)
    (linear, spins), (linear_second, spins_second) = (
        np.split(values.transpose(0, 2, 1), 2, 2) for values in (state.twist, spatial)
    )
    velocities = linear + cross(spins, origins)
    accelerations_of = linear_second + cross(spins_second, origins) + cross(spins, velocities)
    motions = origins, rotations, velocities, spins, accelerations_of, spins_second
    links = {name: LinkMotion(*(values[i] for values in motions)) for name, i in tree.links.items()}
    values = state.q.values, state.rates * scale, second
    needed = [j for j in mechanism.joints if names is None or not names.isdisjoint(j.coordinates)]
    joints = tree_joint_motions(tree, needed, links, values)
    first = leading_joint(joints, mechanism.drivers, len(times))
    return Motion(
        source="loop equations",
        angle=first.value,
        speed=first.rate,
        acceleration=first.acceleration,
        points=tracked_points(mechanism, links, names),
        links=links,
        joints=joints,
        time=times,
        drivers=mechanism.drivers,
    )


def joined_configurations(configurations: Sequence[Coordinates]) -> Coordinates:
    """Return several configurations together."""
    return Coordinates(
        np.concatenate([q.values for q in configurations], 1),
        np.concatenate([q.turns for q in configurations], -1),
    )


def state_quantity(name: str, mechanism: Mechanism) -> Quantity:
    """Return the quantity with a name, a scalar function of configuration and velocities.

    Raises:
        InputError: for an unknown name, or a quantity that needs accelerations or forces.
    """
    result = numeric_quantity(name, mechanism)
    if result.order > 1 or result.uses("force", "formula"):
        raise InputError(
            f"{name} of {mechanism.name} needs accelerations or forces; give a quantity of positions and "
            "velocities, such as J.q, P.vx or distance:P,Q"
        )
    return result


def tree_coordinate(equations: EquationsOfMotion, quantity: Quantity) -> tuple[int, int] | None:
    """Return index and order of a quantity that is a coordinate of the tree or its rate; None for others."""
    column, index_of = quantity.columns[0], equations.loops.tree.index_of
    if quantity.function or column.source != "joint" or column.subject not in index_of:
        return None
    return index_of[column.subject], column.order


def values_at(equations: EquationsOfMotion, quantity: Quantity, state: Kinematics) -> Array:
    """Return a quantity at n states, (n,)."""
    if (coordinate := tree_coordinate(equations, quantity)) is not None:
        index, order = coordinate
        return state.rates[index] * equations.loops.units[index] if order else state.q.values[index]
    motion = motion_of(equations, state, None, np.zeros(len(state.q)), quantity)
    return quantity.number(record_columns(motion, [quantity]))


@dataclass(frozen=True, slots=True)
class Event:
    """An event: a quantity reaches a value in SI."""

    quantity: Quantity
    value: float

    def function(self, equations: EquationsOfMotion, state: Kinematics) -> Array:
        """Return the quantity less its value at n states; not a number where an angle is opposite to it."""
        difference = values_at(equations, self.quantity, state) - self.value
        if self.quantity.kind != "angle":
            return difference
        # the jump of an angle between links by a whole revolution is no crossing
        difference = wrapped(difference)
        return np.where(np.abs(difference) < 0.5 * np.pi, difference, np.nan)

    def watched(self, equations: EquationsOfMotion, before: float) -> Watched:
        """Return the component of states that reaches a value at the event, from a difference before it."""
        coordinate = tree_coordinate(equations, self.quantity)
        if coordinate is None:
            return NOTHING
        index, order = coordinate
        component = index + order * StateLayout(equations).positions
        value = self.value / float(equations.loops.units[index])
        return (component, -np.inf, value) if before < 0.0 else (component, value, np.inf)


def parse_event(mechanism: Mechanism, text: str, written: units.WrittenUnits = units.SI_UNITS) -> Event:
    """Return the event in a text such as "P.y=0", "J.q=90deg" or "distance:P,Q=10mm".

    Args:
        mechanism: the mechanism.
        text: quantity and value.
        written: units that its file declares.

    Raises:
        InputError: for other text, an unknown name, or an ambiguous value without a unit.
    """
    name, sign, value = text.rpartition("=")
    if not sign:
        raise InputError(f"event {text!r} is not QUANTITY=VALUE; write it as P.y=0 or J.q=90deg")
    quantity = state_quantity(name.strip(), mechanism)
    unit: Any = quantity.unit
    if unit in ("m", "rad"):
        length = mechanism.characteristic_length
        units.require_written(value, unit, written.declared(unit), f"event {name}", length=length)
    # units of expressions, such as m2, are not read
    if unit in get_args(units.Unit):
        return Event(quantity, units.parse(value.strip(), unit, f"value of {quantity.name}"))
    try:
        return Event(quantity, float(value.strip()))
    except ValueError:
        raise InputError(f"value of {quantity.name} is {value.strip()!r}; give a number in {unit}") from None


def load_displacement(name: str, mechanism: Mechanism) -> Quantity:
    """Return the displacement on which a unit load in [N] or [N m] does work.

    Raises:
        InputError: for a name that is no displacement.
    """
    result = state_quantity(name, mechanism)
    if result.order or result.unit not in ("m", "rad"):
        raise InputError(f"{name} is no displacement on which a load does work; give J, P.x or distance:P,Q")
    return result


def displacement_of(name: str, mechanism: Mechanism) -> tuple[Quantity, int]:
    """Return the quantity of positions of which a name is a time derivative, and the order of the derivative.

    Raises:
        InputError: for a name of forces, or of velocities without such a quantity.
    """
    result = numeric_quantity(name, mechanism)
    if not result.order:
        return state_quantity(name, mechanism), 0
    if result.function is not None or len(result.columns) != 1:
        raise InputError(f"{name} has no linear response; give a component such as P.vx or J.v")
    (column,) = result.columns
    position = f"{column.subject}.{column.name[-1]}" if column.source == "point" else column.subject
    return numeric_quantity(position, mechanism), result.order


def change_from(
    equations: EquationsOfMotion, state: Kinematics, quantity: Quantity
) -> Callable[[Kinematics], Array]:
    """Return the change of a quantity from one state to n others, (n,); of angles without revolutions."""
    start = values_at(equations, quantity, state)

    def change(other: Kinematics) -> Array:
        difference = values_at(equations, quantity, other) - start
        return np.asarray(wrapped(difference) if quantity.angle else difference)

    return change
