"""Straight-line code of a mechanism: its loop equations, motion and drive torques, traced symbolically.

The functions of `kinematics.loops` run on arrays of expressions and thereby return the formulas of the code.
"""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mechsim.codegen.assembly import SolvedAssembly
from mechsim.codegen.expressions import Block, ExpressionTable, SymbolicExpression, statements
from mechsim.kinematics.loops.constraints import TreeLoops
from mechsim.kinematics.loops.design_motion import DesignLoops
from mechsim.kinematics.loops.kinematics import (
    Coordinates,
    LinkPoses,
    cross,
    link_poses,
    twists,
    velocity_products,
)
from mechsim.kinematics.vector_method.rotations import from_quaternion
from mechsim.mechanism.design_arrays import DesignArrays, design_arrays
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND
from mechsim.numerics.arrays import Array

# quantities of a point, of a link, and of a link's inertia -> number of values
POINT = {"position": 3, "velocity": 3, "acceleration": 3}
LINK = {
    "position": 3,
    "rotation": 9,
    "velocity": 3,
    "angular_velocity": 3,
    "acceleration": 3,
    "angular_acceleration": 3,
}
# value, rate and acceleration of a coordinate
JOINT = {"motion": 3}
# mass, centre of mass, and moments xx, yy, zz, xy, xz, yz about it, in the link's frame
INERTIA_NUMBERS = 10
# index in the moments of each element of an inertia matrix
MOMENTS = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return for each name a unique suffix of an identifier in C and JavaScript."""
    out: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        plain = plain if plain[:1].isalpha() else f"n{plain}"
        numbered = (f"{plain}_{k}" for k in itertools.count(len(out)))
        out[name] = next(text for text in itertools.chain([plain], numbered) if text not in out.values())
    return out


@dataclass(frozen=True)
class VaryingNumbers:
    """Numbers of a mechanism that the code reads from an array instead of constants.

    Attributes:
        sides: (joint, "a" or "b") -> index of the first of the point's three numbers, and of the first of the
            frame's nine numbers row by row; None for constants.
        points: tracked point -> index of the first of its three numbers.
    """

    sides: Mapping[tuple[str, str], tuple[int | None, int | None]]
    points: Mapping[str, int]

    @property
    def count(self) -> int:
        """Count of the numbers."""
        ends = [0, *(first + 3 for first in self.points.values())]
        for point, frame in self.sides.values():
            ends += [0 if point is None else point + 3, 0 if frame is None else frame + 9]
        return max(ends)


def _joint_numbers(assembly: SolvedAssembly, varying: VaryingNumbers, table: ExpressionTable) -> DesignArrays:
    """Return points and frames of an assembly's joints as arrays of one design; variables are symbols."""
    mechanism = assembly.loops.tree.mechanism
    numbers = design_arrays(mechanism, [mechanism])

    def symbols(first: int | None, values: Array) -> Array:
        if first is None:
            return values
        names = [table.symbol(f"number{first + k}") for k in range(values.size)]
        return np.array(names, dtype=object).reshape(values.shape)

    ends = dict(numbers.ends)
    for name, arrays in numbers.ends.items():
        firsts = [first for side in "ab" for first in varying.sides.get((name, side), (None, None))]
        point_a, frame_a, point_b, frame_b = map(symbols, firsts, arrays)
        ends[name] = point_a, frame_a, point_b, frame_b
    original = design_arrays(assembly.loops.tree.original, [assembly.loops.tree.original])
    points = {name: symbols(varying.points.get(name), values) for name, values in original.points.items()}
    return DesignArrays(mechanism, {**original.ends, **ends}, points)


def _with_numbers(loops: TreeLoops, numbers: DesignArrays) -> TreeLoops:
    """Return loop equations with other numbers of joints."""
    designs = DesignLoops(
        loops.tree, loops.cuts, loops.turn_offsets, loops.driven, numbers, np.zeros(1, np.intp)
    )
    return designs.at_instants(1)


class SolverFormulas:
    """The formulas of an assembly in its coordinates.

    Attributes:
        assembly: the assembly.
        names: identifiers of the coordinates of the tree, by index.
        symbols: symbol of an expression -> the code that reads it.
        loops: loop equations of the assembly, with symbols for variable numbers.
        numbers: numbers of its joints and points, with symbols for variable numbers.
    """

    def __init__(self, assembly: SolvedAssembly, varying: VaryingNumbers | None = None):
        self.assembly, self.table = assembly, ExpressionTable()
        numbers = _joint_numbers(assembly, varying or VaryingNumbers({}, {}), self.table)
        self.loops = assembly.loops if varying is None else _with_numbers(assembly.loops, numbers)
        self.tree, self.numbers = self.loops.tree, numbers
        count = self.tree.count
        names = {i: name for name, i in self.tree.index_of.items()}
        for ball in self.tree.balls:
            names |= {ball.first_angle + i: f"{ball.joint.name} {axis}" for i, axis in enumerate("xyz")}
        self.coordinates = [names[i] for i in range(count)]
        plain = identifiers(self.coordinates)
        self.names = [plain[name] for name in self.coordinates]
        self.links = [link.name for link in self.tree.original.links if link.is_body]
        self.points = [name for name, (link, _) in self.tree.original.points.items() if link != GROUND]
        # joints whose coordinates follow from the poses of their sides
        self.closing_joints = [
            joint
            for joint in self.tree.original.joints
            if joint.name not in self.tree.joint_names and KINDS[joint.kind].aligned
        ]
        self.joints = [name for joint in self.closing_joints for name in joint.coordinates]
        self.symbols: dict[str, str] = {}
        for i, name in enumerate(self.names):
            self.symbols |= {
                f"{name}_q": f"s->coordinates[{i}]",
                f"cos({name}_q)": f"s->cosines[{i}]",
                f"sin({name}_q)": f"s->sines[{i}]",
                f"{name}_rate": f"rates[{i}]",
                f"{name}_acceleration": f"s->accelerations[{i}]",
            }
        if varying is not None:
            self.symbols |= {f"number{k}": f"@GEOMETRY[{k}]" for k in range(varying.count)}
        for k in range(len(self.tree.balls)):
            self.symbols |= {f"ball{k}_q{axis}": f"s->balls[{4 * k + i}]" for i, axis in enumerate("wxyz")}
        for link in range(len(self.links)):
            self.symbols |= {
                f"inertia{link}_{i}": f"inertias[{link * INERTIA_NUMBERS + i}]"
                for i in range(INERTIA_NUMBERS)
            }
        self.symbols |= {f"gravity{i}": f"gravity[{i}]" for i in range(3)}

    @cached_property
    def q(self) -> Coordinates:
        """The coordinates as symbols."""
        turns = np.empty((len(self.tree.balls), 3, 3, 1), dtype=object)
        for k in range(len(turns)):
            w, x, y, z = (self.table.symbol(f"ball{k}_q{axis}") for axis in "wxyz")
            turns[k, ..., 0] = from_quaternion(w, x, y, z)
        return Coordinates(self._symbols("_q"), turns)

    def _symbols(self, ending: str) -> Array:
        symbols = [self.table.symbol(name + ending) for name in self.names]
        return np.array(symbols, dtype=object).reshape(-1, 1)

    @cached_property
    def linearised(self) -> tuple[Array, Array, LinkPoses]:
        """Residuals of all rows (rows, 1), their Jacobian (rows, count, 1), and the link poses."""
        return self.loops.linearise(self.q)

    @cached_property
    def poses(self) -> LinkPoses:
        """The poses of the links."""
        return link_poses(self.tree, self.q)

    @cached_property
    def motion(self) -> tuple[Array, Array]:
        """The links' twists and spatial accelerations at the ground's origin, (links, 6, 1) each."""
        rates = self._symbols("_rate")
        twist = twists(self.tree, self.poses, rates)
        product = velocity_products(self.tree, self.poses, twist, rates)
        return twist, product + twists(self.tree, self.poses, self._symbols("_acceleration"))

    def equations(self) -> list[str]:
        """Return the code for residuals and Jacobians by unknowns and by drivers."""
        loops, rows = self.loops, self.assembly.solver.rows.tolist()
        residual, jacobian, _ = self.linearised
        unknown, driven = loops.unknown.tolist(), self.assembly.driven
        blocks = self._link_blocks()
        for comment, span in self._row_groups():
            assignments: dict[str, SymbolicExpression] = {}
            for row in (row for row in rows if row in span):
                k = rows.index(row)
                assignments[f"residual[{k}]"] = self._expression(residual[row, 0])
                for columns, count, matrix in (
                    (unknown, len(unknown), "s->lu"),
                    (driven, len(driven), "by_drivers"),
                ):
                    for j, column in enumerate(columns):
                        entry = self._expression(jacobian[row, column, 0])
                        if entry.number != 0.0:
                            assignments[f"{matrix}[{k * count + j}]"] = entry
            blocks.append(Block(comment, assignments))
        return statements(blocks, self.symbols)

    def velocity_products(self) -> list[str]:
        """Return the code for the second time derivative of the residuals at constant coordinate rates."""
        rates = self._symbols("_rate")
        twist = twists(self.tree, self.poses, rates)
        product = velocity_products(self.tree, self.poses, twist, rates)
        values = self.loops.velocity_products(self.q, self.poses, rates, twist, product)
        rows = self.assembly.solver.rows.tolist()
        blocks = [*self._link_blocks(), *self._twist_blocks(twist)]
        for comment, span in self._row_groups():
            block = {
                f"out[{k}]": self._expression(values[row, 0]) for k, row in enumerate(rows) if row in span
            }
            blocks.append(Block(comment, block))
        return statements(blocks, self.symbols)

    def link_motions(self) -> list[str]:
        """Return the code for positions, rotations and rates of the links."""
        blocks = self._link_blocks()
        for k, name in enumerate(self.links):
            i = self.tree.links[name]
            twist, spatial = (values[i, :, 0] for values in self.motion)
            position = self.poses.position[i, :, 0]
            velocity, acceleration = point_rates(twist, spatial, position)
            rotation = self.poses.rotation[i, ..., 0].ravel()
            values = position, rotation, velocity, twist[3:], acceleration, spatial[3:]
            blocks.append(self._record_block(f"link {name}", f"links[{k}]", LINK, values))
        return statements(blocks, self.symbols)

    def point_motions(self) -> list[str]:
        """Return the code for positions and rates of the tracked points."""
        blocks = self._link_blocks()
        for k, name in enumerate(self.points):
            link = self.tree.original.points[name][0]
            i = self.tree.links[link]
            position = self._point(i, self.numbers.points[name][:, 0])
            twist, spatial = (values[i, :, 0] for values in self.motion)
            rates = point_rates(twist, spatial, position)
            blocks.append(
                self._record_block(f"point {name} of link {link}", f"points[{k}]", POINT, (position, *rates))
            )
        return statements(blocks, self.symbols)

    def joint_motions(self) -> list[str]:
        """Return the code for value, rate and acceleration of the joints that close loops."""
        blocks = self._link_blocks()
        k = 0
        for joint in self.closing_joints:
            values: dict[str, SymbolicExpression] = {}
            for motion in self._closing_motion(joint):
                values |= {f"joints[{k}].motion[{i}]": self._expression(motion[i]) for i in range(3)}
                k += 1
            blocks.append(Block(f"{joint.kind} joint {joint.name}", values))
        return statements(blocks, self.symbols)

    def _closing_motion(self, joint: Joint) -> Iterator[tuple[Any, Any, Any]]:
        """Yield value, rate and acceleration of each coordinate of a joint that closes a loop."""
        kind = KINDS[joint.kind]
        numbers = self.numbers.ends[joint.name]
        point_a, frame_a, twist_a, spatial_a = self._side(joint.a, numbers[:2])
        point_b, frame_b, twist_b, spatial_b = self._side(joint.b, numbers[2:])
        rates_a, rates_b = point_rates(twist_a, spatial_a, point_a), point_rates(twist_b, spatial_b, point_b)
        gap, spin = point_b - point_a, twist_a[3:]
        # relative to side a
        relative = rates_b[0] - rates_a[0] - cross(spin, gap)
        second = rates_b[1] - rates_a[1] - cross(spatial_a[3:], gap)
        second = second - cross(spin, 2.0 * relative + cross(spin, gap))
        for axis in kind.slides:
            direction = frame_a[:, COLUMN[axis]]
            yield direction @ gap, direction @ relative, direction @ second
        if kind.turns:
            axis_a, reference = frame_a[:, 2], frame_b[:, 0]
            sine, cosine = (self._expression(frame_a[:, k] @ reference) for k in (1, 0))
            angle = self.table.angle(sine, cosine)
            yield angle, axis_a @ (twist_b - twist_a)[3:], axis_a @ (spatial_b - spatial_a)[3:]

    def _side(self, end: End, numbers: Sequence[Array]) -> tuple[Array, Array, Array, Array]:
        """Return point, frame, twist and spatial acceleration of a side of a joint."""
        point, frame = numbers[0][:, 0], numbers[1][..., 0]
        if end.link == GROUND:
            zero = np.full(6, self.table.expression(0.0), dtype=object)
            return point.astype(object), frame.astype(object), zero, zero
        i = self.tree.index[end.link]
        twist, spatial = (values[i, :, 0] for values in self.motion)
        return self._point(i, point), self.poses.rotation[i, ..., 0] @ frame, twist, spatial

    def torques(self) -> list[str]:
        """Return the code for the generalised forces on all coordinates due to inertia and gravity."""
        symbol = self.table.symbol
        gravity = np.array([symbol(f"gravity{i}") for i in range(3)], dtype=object)
        wrench = np.full((len(self.tree.branches), 6), self.table.expression(0.0), dtype=object)
        for k, name in enumerate(self.links):
            i = self.tree.links[name]
            twist, spatial = (values[i, :, 0] for values in self.motion)
            numbers: list[Any] = [symbol(f"inertia{k}_{j}") for j in range(INERTIA_NUMBERS)]
            rotation = self.poses.rotation[i, ..., 0]
            centre = self._point(i, np.array(numbers[1:4], dtype=object))
            force = (point_rates(twist, spatial, centre)[1] - gravity) * numbers[0]
            moments = np.array(numbers[4:], dtype=object)[MOMENTS]
            # Euler's equation in the link's frame
            angular, angular_rate = rotation.T @ twist[3:], rotation.T @ spatial[3:]
            moment = rotation @ (moments @ angular_rate + cross(angular, moments @ angular))
            wrench[i] = np.concatenate([force, moment + cross(centre, force)])
        blocks = self._link_blocks()
        unit_twists = self.poses.unit_twists[..., 0]
        for j, name in enumerate(self.coordinates):
            carried = np.flatnonzero(self.tree.moved_by[:, j])
            total = wrench[carried].sum(0)
            value = self._expression((unit_twists[j] * total).sum())
            blocks.append(Block(f"along {name}", {f"forces[{j}]": value}))
        return statements(blocks, self.symbols)

    def _expression(self, value: Any) -> SymbolicExpression:
        return self.table.expression(value)

    def _point(self, link: int, local: Array) -> Array:
        return self.poses.position[link, :, 0] + self.poses.rotation[link, ..., 0] @ local

    def _record_block(
        self, comment: str, target: str, quantities: Mapping[str, int], values: Sequence[Array]
    ) -> Block:
        """Return a block that fills in a record."""
        return Block(
            comment,
            {
                f"{target}.{quantity}[{i}]": self._expression(vector[i])
                for (quantity, count), vector in zip(quantities.items(), values, strict=True)
                for i in range(count)
            },
        )

    def _link_blocks(self) -> list[Block]:
        """Return blocks that define names for rotations and origins of the links."""
        blocks: list[Block] = []
        plain = identifiers(self.tree.index)
        for branch in self.tree.branches:
            i = branch.child
            name = next(link for link, index in self.tree.index.items() if index == i)
            elements = itertools.product(range(3), repeat=2)
            frame = [(f"{row}{column}", self.poses.rotation[i, row, column, 0]) for row, column in elements]
            origin = [(axis, self.poses.position[i, j, 0]) for j, axis in enumerate("xyz")]
            values = {
                f"{plain[name]}_{ending}": self._expression(value) for ending, value in (*frame, *origin)
            }
            blocks.append(Block(f"link {name} by joint {branch.joint.name}", values, names=True))
        return blocks

    def _twist_blocks(self, twist: Array) -> list[Block]:
        plain = identifiers(self.tree.index)
        return [
            Block(
                f"angular velocity of link {name}, and velocity of its point at the origin",
                {
                    f"{plain[name]}_{kind}{axis}": self._expression(twist[i, 3 * (kind == "w") + j, 0])
                    for kind in "wv"
                    for j, axis in enumerate("xyz")
                },
                names=True,
            )
            for name, i in self.tree.index.items()
        ]

    def _row_groups(self) -> list[tuple[str, range]]:
        """Return a comment and the rows for each joint that closes a loop, and for each coupling."""
        groups: list[tuple[str, range]] = []
        first = 0
        for cut in self.loops.cuts:
            joint = cut.joint
            text = f"{joint.kind} joint {joint.name} closes a loop: {joint.a.link} meets {joint.b.link}"
            groups.append((text, range(first, first + cut.rows)))
            first += cut.rows
        for row in self.loops.couplings:
            groups.append((f"coupling {row.coupling.label}", range(first, first + 1)))
            first += 1
        return groups


def point_rates(twist: Array, spatial: Array, position: Array) -> tuple[Array, Array]:
    """Return velocity and acceleration of a point of a link, (3,) each.

    Args:
        twist: velocity at the ground's origin and angular velocity of the link, (6,).
        spatial: spatial acceleration of the link in the same order, (6,).
        position: position of the point, (3,).
    """
    velocity = twist[:3] + cross(twist[3:], position)
    return velocity, spatial[:3] + cross(spatial[3:], position) + cross(twist[3:], velocity)
