"""Loop equations of a mechanism for several number types: balls, balls with derivatives, exact numbers.

The equations are those of `kinematics.loops.constraints`, in a second version for interval arithmetic.
Vectors are columns (..., 3, 1), frames (..., 3, 3). A rod between two ball joints, which spins freely, is
replaced by the distance between its ends.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.kinematics.loops.constraints import CoupledRow, Cut, coupled_rows, cuts_of
from mechsim.kinematics.loops.tree import SpanningTree, TreeJoint, spanning_tree
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, ORIGIN, VIRTUAL_PREFIX
from mechsim.mechanism.mechanism import Mechanism, require_polynomials
from mechsim.mechanism.moved_links import with_rods
from mechsim.numerics.arrays import Array
from mechsim.numerics.balls import Ball, DualBall, ball

# a ball, a ball with derivatives, or an array of exact numbers
Number = Any
# a rotation about z is CONSTANT plus cosine and sine times matrices
CONSTANT = np.diag([0, 0, 1])
COSINE = np.diag([1, 1, 0])
SINE = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
NEXT, BEFORE = [1, 2, 0], [2, 0, 1]
RIGHT_ANGLE = np.pi / 2
# largest distance of axes from the centre of a spherical linkage, relative to its size, due to rounding
CONCENTRIC = 1e-15


@dataclass(frozen=True)
class Rod:
    """A link between two ball joints, represented by the distance between their points.

    Attributes:
        joints: names of the ball joints.
        own: index of the joint's point on the rod among its `Constants.sides`, 0 or 2.
        sides: indices of the connected links in the tree; -1 is the ground.
    """

    joints: tuple[str, str]
    own: tuple[int, int]
    sides: tuple[int, int]


@dataclass(frozen=True)
class Placed:
    """Link poses at given coordinates, and the unit twists of the coordinates.

    Attributes:
        rotation, position: pose of each link, the ground last, (..., 3, 3) and (..., 3, 1).
        linear, angular: velocity at the ground's origin and angular velocity, (..., 3, count), or None.
    """

    rotation: list[Number]
    position: list[Number]
    linear: Number
    angular: Number


@dataclass(frozen=True)
class ClosureEquations:
    """Loop equations of a mechanism without its rods.

    Attributes:
        tree: spanning tree of the mechanism without its rods.
        rods: the omitted rods.
        rod_joints: ball joints of the rods.
        turn_offsets: whole revolutions between the two sides of each coupling.
        radii: JOINT.a or JOINT.b -> radii of point, axis and reference direction, (3, 3), for tolerances.
        selected: indices of the equations to solve; None for all that do not hold identically.
    """

    tree: SpanningTree
    rods: tuple[Rod, ...]
    rod_joints: tuple[Joint, ...]
    turn_offsets: tuple[float, ...]
    radii: Mapping[str, Array]
    selected: tuple[int, ...] | None = None

    @cached_property
    def cuts(self) -> tuple[Cut, ...]:
        """Joints that close loops."""
        return cuts_of(self.tree)

    @cached_property
    def couplings(self) -> tuple[CoupledRow, ...]:
        """Couplings between coordinates."""
        return coupled_rows(self.tree)

    @cached_property
    def driven(self) -> list[int]:
        """Indices of the prescribed coordinates: drivers, then locked coordinates."""
        mechanism = self.tree.mechanism
        return [self.tree.index_of[name] for name in (*mechanism.drivers, *mechanism.locked)]

    @cached_property
    def unknown(self) -> NDArray[np.intp]:
        """Indices of the coordinates that the loops determine."""
        return np.delete(np.arange(self.tree.count), self.driven)

    @cached_property
    def balls(self) -> "Constants":
        """Points and frames of all joints as balls."""
        return Constants.from_equations(self, exactly=False)

    @cached_property
    def kept(self) -> NDArray[np.intp]:
        """Indices of the equations that are solved."""
        if self.selected is not None:
            return np.array(self.selected, dtype=np.intp)
        constants = Constants.from_equations(self, exactly=True)
        turns = [unknown_numbers(3, 3) for _ in self.tree.balls]
        q = unknown_numbers(self.tree.count, 1)
        placed = placed_links(self.tree, constants, q, turns, with_twists=False)
        residuals = [cut_equations(cut, constants, placed, self.tree)[0] for cut in self.cuts]
        values = [value for residual in residuals for value in residual.ravel()]
        values += [1] * (len(self.rods) + len(self.couplings))
        return np.array([i for i, value in enumerate(values) if value != 0], dtype=np.intp)

    def evaluate(self, q: Number, turns: list[Number]) -> tuple[Number, Number]:
        """Return residuals (..., kept, 1) and Jacobians by the coordinates in their units (..., kept, count).

        Args:
            q: coordinates in [m] and [rad], Cayley vectors for ball joints, (..., count, 1).
            turns: rotation of side b relative to side a of each ball joint at the zero vector, (..., 3, 3).
        """
        constants = self.balls
        placed = placed_links(self.tree, constants, q, turns)
        # without loops, 0 equations
        rows = [(q[..., :0, :], q[..., :0, :] @ np.zeros((1, self.tree.count)))]
        rows += [cut_equations(cut, constants, placed, self.tree) for cut in self.cuts]
        rows += [self._rod_equation(rod, placed) for rod in self.rods]
        offsets = zip(self.couplings, self.turn_offsets, strict=True)
        rows += [coupled_equation(row, whole, q, self.tree.units) for row, whole in offsets]
        residual, jacobian = (concatenated([row[i] for row in rows], -2) for i in (0, 1))
        return residual[..., self.kept, :], jacobian[..., self.kept, :]

    def _rod_equation(self, rod: Rod, placed: Placed) -> tuple[Number, Number]:
        """Return half the difference of squared distances, divided by the rod's length and the size."""
        joints = [self.balls.sides[name] for name in rod.joints]
        points = [
            placed.position[side] + placed.rotation[side] @ joint[2 - own]
            for side, joint, own in zip(rod.sides, joints, rod.own, strict=True)
        ]
        own = joints[1][rod.own[1]] - joints[0][rod.own[0]]
        squared = own.T @ own
        length = float(np.sqrt(squared.mid[0, 0]))
        scale = 1.0 / (length * self.tree.length)
        gap = points[1] - points[0]
        relative = relative_motion(self.tree, rod.sides)
        jacobian = gap.T @ placed.linear + cross(points[0], gap).T @ placed.angular
        return (gap.T @ gap - squared) * (0.5 * scale), jacobian * scale * relative


@dataclass(frozen=True)
class Constants:
    """Points and frames of all joints.

    Attributes:
        sides: joint -> points (3, 1) and frames (3, 3) of its sides a and b.
        angles: joint -> cosine and sine of the angle between crossed axes, (1, 1) each.
    """

    sides: dict[str, tuple[Number, Number, Number, Number]]
    angles: dict[str, tuple[Number, Number]]

    @classmethod
    def from_equations(cls, equations: ClosureEquations, exactly: bool) -> "Constants":
        """Return the constants of a mechanism as exact numbers or as balls."""
        number, unit = (rational, exact_unit_vector) if exactly else (_ball_of, _unit_ball)
        sides: dict[str, tuple[Number, Number, Number, Number]] = {}
        angles: dict[str, tuple[Number, Number]] = {}
        for joint in (*equations.tree.mechanism.joints, *equations.rod_joints):
            numbers: list[Number] = []
            for name, end in (("a", joint.a), ("b", joint.b)):
                radii = equations.radii.get(f"{joint.name}.{name}", np.zeros((3, 3)))
                values = (end.point, end.axis, end.reference)
                point, axis, reference = (
                    number(np.array(value)[:, None], radius[:, None])
                    for value, radius in zip(values, radii, strict=True)
                )
                numbers += [point, joint_frame(axis, reference, unit)]
            sides[joint.name] = (numbers[0], numbers[1], numbers[2], numbers[3])
            if KINDS[joint.kind].crossed:
                if joint.cross_angle == RIGHT_ANGLE:
                    angles[joint.name] = number(np.eye(1)), number(np.zeros((1, 1)))
                elif exactly:
                    angles[joint.name] = unknown_numbers(1, 1), unknown_numbers(1, 1)
                else:
                    angles[joint.name] = ball(np.array([[joint.cross_angle]])).sin_cos()
        return cls(sides, angles)


def _ball_of(values: Array, radius: Array | float = 0.0) -> Ball:
    return Ball(values, np.broadcast_to(radius, values.shape))


def _unit_ball(vector: Ball) -> Ball:
    return vector * (vector.T @ vector).sqrt().reciprocal()


def joint_frame(axis: Number, reference: Number, unit: Any) -> Number:
    """Return the frame (3, 3) of a joint side: reference direction, axis x reference direction, axis."""
    z = unit(axis)
    x = unit(reference - z * (z.T @ reference))
    return concatenated([x, cross(z, x), z], -1)


def concatenated(matrices: list[Number], axis: int) -> Number:
    """Return arrays of any number type concatenated along an axis."""
    if isinstance(matrices[0], np.ndarray):
        return np.concatenate(matrices, axis)
    dual = any(isinstance(matrix, DualBall) for matrix in matrices)
    return (DualBall if dual else Ball).joined(matrices, axis)


def cross(a: Number, b: Number) -> Number:
    """Return vector products of columns, (..., 3, k)."""
    return a[..., NEXT, :] * b[..., BEFORE, :] - a[..., BEFORE, :] * b[..., NEXT, :]


def relative_motion(tree: SpanningTree, sides: tuple[int, int]) -> Array:
    """Return the factors from unit twists to the motion of side b relative to side a, (count,)."""
    zero = np.zeros(tree.count)
    a, b = (zero if side < 0 else tree.moved_by[side] for side in sides)
    return (b - a) * tree.units


def _about_z(angle: Number) -> Number:
    sine, cosine = (angle, angle) if isinstance(angle, np.ndarray) else angle.sin_cos()
    return cosine * COSINE + sine * SINE + CONSTANT


def _relative_rotation(
    branch: TreeJoint, constants: Constants, q: Number, initial: Number
) -> tuple[Number, Number | None]:
    """Return the frame of side b in side a, and for a ball joint the angular velocities of its components."""
    name, first = branch.joint.name, branch.first_angle
    if branch.kind.ball:
        if isinstance(initial, np.ndarray):
            return initial, None
        # (I - A)^-1 (I + A) times the start; A is the cross-product matrix of half the Cayley vector
        half = q[..., first : first + 3, :] * 0.5
        skew = concatenated([cross(half, np.eye(3)[:, i : i + 1]) for i in range(3)], -1)
        scale = (half.T @ half + 1.0).reciprocal()
        return (skew + skew @ skew) * (scale * 2.0) @ initial + initial, (skew + np.eye(3)) * scale
    angles = [q[..., first + i : first + i + 1, :] for i in range(len(branch.kind.turns))]
    if branch.kind.crossed:
        sine, cosine = constants.angles[name]
        zero, unit = cosine * 0, cosine * 0 + 1
        rows = [-cosine, zero, sine], [zero, -unit, zero], [sine, zero, cosine]
        middle = concatenated([concatenated(row, -1) for row in rows], -2)
        return _about_z(angles[0]) @ middle @ _about_z(angles[1]), None
    return _about_z(angles[0]) if angles else np.eye(3, dtype=np.int64), None


def placed_links(
    tree: SpanningTree, constants: Constants, q: Number, turns: list[Number], with_twists: bool = True
) -> Placed:
    """Return link poses and unit twists at coordinates; see `ClosureEquations.evaluate`."""
    count = len(tree.branches)
    rotation: list[Number] = [np.eye(3, dtype=np.int64)] * (count + 1)
    position: list[Number] = [np.zeros((3, 1), dtype=np.int64)] * (count + 1)
    twists: list[tuple[Number, Number]] = []
    ball_turns = iter(turns)
    for branch in tree.branches:
        initial = next(ball_turns) if branch.kind.ball else None
        relative, components = _relative_rotation(branch, constants, q, initial)
        parent, child = branch.parent, branch.child
        sides = constants.sides[branch.joint.name]
        parent_point, parent_frame, child_point, child_frame = (
            sides if branch.forward else (*sides[2:], *sides[:2])
        )
        joint_at_parent = rotation[parent] @ parent_frame
        joint_at_child = joint_at_parent @ (relative if branch.forward else relative.T)
        side_a, side_b = (
            (joint_at_parent, joint_at_child) if branch.forward else (joint_at_child, joint_at_parent)
        )
        centre = position[parent] + rotation[parent] @ parent_point
        for k, axis in enumerate(branch.kind.slides, branch.first):
            moved = side_a[..., [COLUMN[axis]]] * q[..., k : k + 1, :]
            centre = centre + moved if branch.forward else centre - moved
        rotation[child] = joint_at_child @ child_frame.T
        position[child] = centre - rotation[child] @ child_point
        if with_twists:
            # the axes pass through the point of side b
            through = centre if branch.forward else position[parent] + rotation[parent] @ parent_point
            twists += _twists(branch, side_a, side_b, through, components)
    if not twists:
        return Placed(rotation, position, None, None)
    linear, angular = (concatenated([twist[i] for twist in twists], -1) for i in (0, 1))
    return Placed(rotation, position, linear, angular)


def _twists(
    branch: TreeJoint, side_a: Number, side_b: Number, centre: Number, components: Number | None
) -> Iterator[tuple[Number, Number]]:
    """Yield the unit twist of each coordinate of a joint, for the motion of its outer link."""
    for axis in branch.kind.slides:
        along = side_a[..., [COLUMN[axis]]] * branch.direction
        yield along, along * 0.0
    if branch.kind.ball:
        axes = side_a @ components
        directions = [axes[..., [i]] for i in range(3)]
    else:
        directions = [(side_b if axis == "b" else side_a)[..., 2:] for axis in branch.kind.turns]
    for direction in directions:
        angular = direction * branch.direction
        yield cross(centre, angular), angular


def cut_equations(
    cut: Cut, constants: Constants, placed: Placed, tree: SpanningTree
) -> tuple[Number, Number | None]:
    """Return residuals (..., rows, 1) and Jacobians (..., rows, count) of a joint that closes a loop.

    Residuals are in characteristic lengths or [rad]. Without unit twists there is no Jacobian.
    """
    point_a, frame_a, point_b, frame_b = constants.sides[cut.joint.name]
    (a, b), position, rotation = cut.sides, placed.position, placed.rotation
    side_a, side_b = rotation[a] @ frame_a, rotation[b] @ frame_b
    point_a, point_b = position[a] + rotation[a] @ point_a, position[b] + rotation[b] @ point_b
    rows: list[Number] = []
    if cut.lengths:
        rows.append(side_a[..., cut.lengths].T @ (point_b - point_a) * (1.0 / cut.length))
    for i, j, target in cut.directions:
        product = side_a[..., i : i + 1].T @ side_b[..., j : j + 1]
        if target != 0.0 and cut.joint.cross_angle != RIGHT_ANGLE:
            product = product - constants.angles[cut.joint.name][1]
        rows.append(product)
    if placed.linear is None:
        return concatenated(rows, -2), None
    blocks: list[Number] = []
    if cut.lengths:
        along = side_a[..., cut.lengths]
        power = along.T @ placed.linear + cross(point_b, along).T @ placed.angular
        blocks.append(power * (1.0 / cut.length))
    if cut.directions:
        i, j = ([pair[k] for pair in cut.directions] for k in (0, 1))
        blocks.append(cross(side_b[..., j], side_a[..., i]).T @ placed.angular)
    return concatenated(rows, -2), concatenated(blocks, -2) * relative_motion(tree, cut.sides)


def coupled_equation(row: CoupledRow, turns: float, q: Number, units: Array) -> tuple[Number, Number]:
    """Return residual and Jacobian, (..., 1, count), of a coupling."""
    on_left, on_right = row.left_weights[None], row.right_weights[None]
    offset = on_right @ q - row.coupling.zeros[1]
    value = derivative = offset * 0.0
    for coefficient in reversed(row.coupling.coefficients):
        derivative = derivative * offset + value
        value = value * offset + coefficient
    whole_turns = TWO_PI * turns
    scale = ball(1.0) / row.unit
    residual = (on_left @ q - row.coupling.zeros[0] - value - whole_turns) * scale
    return residual, (on_left - derivative * on_right) * (ball(units) * scale)


# 2 pi
TWO_PI = Ball(np.array([[2.0 * np.pi]]), np.array([[3e-16]]))


def loop_equations(
    mechanism: Mechanism, turn_offsets: tuple[float, ...], radii: Mapping[str, Array]
) -> ClosureEquations:
    """Return the loop equations of a mechanism, with distances in place of freely spinning rods.

    Raises:
        AssemblyError: if a link is disconnected from the ground without the rods.
    """
    require_polynomials(mechanism, "proved")
    mechanism = with_rods(mechanism, {})[0]
    # the second joints of the rods of distance joints have the same ends
    radii = {**radii, **{f"{VIRTUAL_PREFIX}{end}": radius for end, radius in radii.items()}}
    joints_on = {
        link.name: [joint for joint in mechanism.joints if link.name in joint.links]
        for link in mechanism.links
    }
    kinds = ["spherical", "spherical"]
    rods = {name: on for name, on in joints_on.items() if [joint.kind for joint in on] == kinds}
    rod_joints = tuple(joint for joints in rods.values() for joint in joints)
    if rods:
        mechanism = replace(
            mechanism,
            links=tuple(link for link in mechanism.links if link.name not in rods),
            joints=tuple(joint for joint in mechanism.joints if joint not in rod_joints),
            points={name: location for name, location in mechanism.points.items() if location[0] not in rods},
            guess={name: pose for name, pose in mechanism.guess.items() if name not in rods},
        )
    # with tolerances, the points of a spherical linkage depend on its axes
    mechanism = mechanism if radii else concentric(mechanism)
    tree = spanning_tree(mechanism)
    index = {**tree.index, GROUND: -1}
    return ClosureEquations(
        tree,
        tuple(_rod(name, first, second, index) for name, (first, second) in rods.items()),
        rod_joints,
        turn_offsets,
        radii,
    )


def concentric(mechanism: Mechanism) -> Mechanism:
    """Return a spherical linkage with all joint points moved along their axes to one point.

    A linkage is spherical if all joints are revolute and their axes pass the origins of their links within
    `CONCENTRIC`. Other mechanisms are returned unchanged.
    """
    moved: list[Joint] = []
    for joint in mechanism.joints:
        shift = float(np.dot(joint.b.point, joint.b.axis))
        ends = [np.array(end.point) - shift * np.array(end.axis) for end in (joint.a, joint.b)]
        if not KINDS[joint.kind].hinge or np.abs(ends).max() > CONCENTRIC * mechanism.characteristic_length:
            return mechanism
        a, b = (replace(end, point=ORIGIN) for end in (joint.a, joint.b))
        moved.append(replace(joint, a=a, b=b))
    return replace(mechanism, joints=tuple(moved))


def _rod(name: str, first: Joint, second: Joint, index: Mapping[str, int]) -> Rod:
    start, end = (0 if joint.a.link == name else 2 for joint in (first, second))
    a, b = (joint.links[1 - own // 2] for joint, own in ((first, start), (second, end)))
    return Rod((first.name, second.name), (start, end), (index[a], index[b]))


# exact numbers: rational constants and unknown values. A product with an exact zero is an exact zero for any
# other factor, so that the equations of a planar linkage normal to its plane evaluate to zero exactly
ExactArray = NDArray[np.object_]


class Unknown:
    """A number with an unknown value."""

    def _combined(self, _: object) -> "Unknown":
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = _combined

    def __neg__(self) -> "Unknown":
        return self

    def __mul__(self, other: object) -> object:
        return 0 if other == 0 else self

    __rmul__ = __mul__


UNKNOWN = Unknown()


def rational(values: ArrayLike, radius: ArrayLike = 0.0) -> ExactArray:
    """Return floating-point numbers as fractions; numbers with a radius above zero are unknown."""
    numbers, radii = np.broadcast_arrays(np.asarray(values, dtype=np.float64), radius)
    entries: list[Any] = [
        UNKNOWN if rad > 0.0 else Fraction(float(number))
        for number, rad in zip(numbers.ravel(), radii.ravel(), strict=True)
    ]
    return np.array(entries, dtype=object).reshape(numbers.shape)


def unknown_numbers(*shape: int) -> ExactArray:
    """Return an array of unknown numbers."""
    return np.full(shape, UNKNOWN, dtype=object)


def exact_unit_vector(vector: ExactArray) -> ExactArray:
    """Return a column (3, 1) divided by its length; it is exact along a coordinate axis."""
    nonzero = [value for value in vector.ravel() if value != 0]
    alone = len(nonzero) == 1 and nonzero[0] is not UNKNOWN
    entries = [
        0 if value == 0 else (1 if value > 0 else -1) if alone else UNKNOWN for value in vector.ravel()
    ]
    return np.array(entries, dtype=object).reshape(3, 1)
