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
from mechsim.mechanism.links import AXES
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import LinkMotion, Motion, leading_joint
from mechsim.mechanism.quantities import numeric_quantity
from mechsim.mechanism.quantity import Column, Quantity, record_columns
from mechsim.numerics.arrays import Array, cross, wrapped


def motion_of(
    equations: EquationsOfMotion,
    state: Kinematics,
    accelerations: Array | None,
    times: Array,
) -> Motion:
    """Return the motion of links, joints and points at n states with accelerations, (count, n), or none."""
    tree, mechanism = equations.loops.tree, equations.model.mechanism
    scale = equations.loops.units[:, None]
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
    joints = tree_joint_motions(tree, mechanism.joints, links, values)
    first = leading_joint(joints, mechanism.drivers, len(times))
    return Motion(
        source="loop equations",
        angle=first.value,
        speed=first.rate,
        acceleration=first.acceleration,
        points=tracked_points(mechanism, links),
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


def _column_at(state: Kinematics, column: Column) -> Array | None:
    """Return a column at n states, (n,), if it is one of a coordinate of the tree or of a point of a link."""
    loops, points = state.equations.loops, state.equations.model.mechanism.points
    index = loops.tree.index_of.get(column.subject) if column.source == "joint" else None
    if index is not None:
        return state.rates[index] * loops.units[index] if column.order else state.q.values[index]
    link, local = points.get(column.subject, ("", None)) if column.source == "point" else ("", None)
    if local is None or link not in loops.tree.links:
        return None
    i, axis = loops.tree.links[link], AXES.index(column.name[-1])
    position = state.poses.position[i] + np.einsum("ijn,j->in", state.poses.rotation[i], np.array(local))
    if not column.order:
        return position[axis]
    before, after = axis - 2, axis - 1
    linear, spin = state.twist[i, :3], state.twist[i, 3:]
    return linear[axis] + spin[before] * position[after] - spin[after] * position[before]


def values_at(equations: EquationsOfMotion, quantity: Quantity, state: Kinematics) -> Array:
    """Return a quantity of positions and velocities at n states, (n,)."""
    columns = {column.name: _column_at(state, column) for column in quantity.columns}
    direct = {name: column for name, column in columns.items() if column is not None}
    if len(direct) < len(columns):
        motion = motion_of(equations, state, None, np.zeros(len(state.q)))
        direct = record_columns(motion, [quantity])
    return quantity.number(direct)


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
        column, index_of = self.quantity.columns[0], equations.loops.tree.index_of
        if self.quantity.kind not in ("joint", "joint rate") or column.subject not in index_of:
            return NOTHING
        index = index_of[column.subject]
        component = index + column.order * StateLayout(equations).positions
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
