"""A closed curve of assemblies: poses anywhere along it, and turning points of its coordinates."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mechsim.kinematics.continuation.free_loops import FreeLoops
from mechsim.kinematics.continuation.segments import MIN_DISTANCE_FROM_BRANCH_POINT, NODES, TracedCurve
from mechsim.kinematics.loops.kinematics import LinkPoses, link_poses
from mechsim.kinematics.loops.tree import SpanningTree
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import joint_coordinate
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array, numbers, wrapped
from mechsim.numerics.collocation import Interpolant, Piecewise
from mechsim.numerics.newton import root

Extremum = Literal["highest", "lowest"]
# arcs in a segment at which rates are checked for a change of sign
SAMPLES = 4 * NODES
# change of a coordinate between two turns, in [rad] or characteristic lengths, below which it dwells
DWELL = 1e-8


@dataclass(frozen=True, slots=True)
class JointColumn:
    """A coordinate of a joint: "rocker.q", or "guide.q0" where the joint has several.

    Attributes:
        name: of the column.
        joint: its joint.
        coordinate: as drivers and couplings call it.
        unit: "rad" or "m".
    """

    name: str
    joint: str
    coordinate: str
    unit: str


def joint_columns(mechanism: Mechanism) -> tuple[JointColumn, ...]:
    """Return the coordinates of all joints of a mechanism; rotations of ball joints have none."""
    columns: list[JointColumn] = []
    for joint in mechanism.joints:
        units = KINDS[joint.kind].units
        for i, (name, unit) in enumerate(zip(joint.coordinates, units, strict=True)):
            label = f"{joint.name}.q{i if len(units) > 1 else ''}"
            columns.append(JointColumn(label, joint.name, name, unit))
    return tuple(columns)


def read_joints(tree: SpanningTree, poses: LinkPoses) -> Array:
    """Return the coordinates of all joints at n poses, (n, columns) in SI; angles in (-pi, pi]."""
    by_link = {GROUND: IDENTITY, **poses.by_link(tree.index)}
    joints = [joint for joint in tree.original.joints if KINDS[joint.kind].units]
    values = [joint_coordinate(joint, by_link[joint.a.link], by_link[joint.b.link]) for joint in joints]
    return np.concatenate(values, 1)


@dataclass(frozen=True)
class CurveJoints:
    """The joints' coordinates along a traced curve, continuous across segments.

    Attributes:
        tree: of the mechanism.
        traced: the curve.
    """

    tree: SpanningTree
    traced: TracedCurve

    @cached_property
    def columns(self) -> tuple[JointColumn, ...]:
        """Names, joints and units of the coordinates."""
        return joint_columns(self.tree.original)

    @cached_property
    def angular(self) -> Array:
        """1 for each angle, 0 for each length, (columns,)."""
        return np.array([column.unit == "rad" for column in self.columns], dtype=np.float64)

    @cached_property
    def tables(self) -> Piecewise[Interpolant]:
        """Their polynomials."""
        tables: list[Interpolant] = []
        last: Array | None = None
        angles = self.angular > 0.0
        for segment in self.traced.segments:
            values = read_joints(self.tree, link_poses(self.tree, segment.coordinates))
            values[:, angles] = np.unwrap(values[:, angles], axis=0)
            if last is not None:
                values += self.angular * REVOLUTION * np.round((last - values[0]) / REVOLUTION)
            last = values[-1]
            tables.append(Interpolant(segment.nodes, values, segment.weights))
        return Piecewise(tables)

    @cached_property
    def rates(self) -> Piecewise[Interpolant]:
        """Their derivatives by arc."""
        return self.tables.derivative()

    def interpolated(self, arc: float) -> Array:
        """Return the interpolated coordinates at an arc, (columns,)."""
        return self.tables.segment_at(arc).value_at(arc)

    @cached_property
    def gains(self) -> Array:
        """Increase of each coordinate along the whole curve in revolutions or periods, (columns,)."""
        increase = self.interpolated(self.traced.length) - self.interpolated(0.0)
        closed = self.tree.closed_parameters
        periods = [closed.get(column.coordinate, REVOLUTION) for column in self.columns]
        counted = [column.unit == "rad" or column.coordinate in closed for column in self.columns]
        return np.where(counted, np.round(increase / periods), 0.0)

    def turns(self) -> list[tuple[int, Extremum, float]]:
        """Return the turning points by columns: index of the column, its kind, and the arc.

        Accuracy: of the arcs about 1e-9.
        """
        turns: list[tuple[int, Extremum, float]] = []
        # arcs over the whole curve, and values and rates there, (n, columns)
        chunks: list[tuple[Array, Array, Array]] = []
        for table, rate in zip(self.tables.segments, self.rates.segments, strict=True):
            grid = np.linspace(table.low, table.high, SAMPLES, endpoint=False)
            grid = grid[grid < self.traced.length]
            chunks.append((grid, table.evaluate(grid), rate.evaluate(grid)))
        grid, values, rates = (np.concatenate(column) for column in zip(*chunks, strict=True))
        units = np.where(self.angular > 0.0, 1.0, self.tree.mechanism.characteristic_length)
        for i in np.flatnonzero(np.ptp(values, axis=0) > ROUNDING * units).tolist():
            rising = rates[:, i] > 0.0

            def rate_at(arc: float, column: int = i) -> float:
                return float(self.rates.segment_at(arc).value_at(arc)[column])

            # the curve is closed: the last sample is followed by the first
            for k in np.flatnonzero(rising != np.roll(rising, -1)).tolist():
                low, high = float(grid[k]), float(grid[k + 1]) if k + 1 < len(grid) else self.traced.length
                arc = root(rate_at, low, high) if rate_at(low) * rate_at(high) < 0.0 else high
                turns.append((i, "highest" if rising[k] else "lowest", arc))
        return turns


@dataclass(frozen=True, slots=True)
class TurningPoint:
    """A turning point of a coordinate: a maximum or minimum along the curve.

    Attributes:
        coordinate: name of its column.
        which: "highest" at a maximum, "lowest" at a minimum.
        value: of the coordinate, in [rad] or [m].
        arc: position on the curve.
        angle: of the crank in [rad].
    """

    coordinate: str
    which: Extremum
    value: float
    arc: float
    angle: float


@dataclass(frozen=True, slots=True)
class CurvePoses:
    """Poses of a mechanism along a curve of assemblies.

    Attributes:
        arc: from the start of the curve, (n,).
        angle: of the crank, not wrapped, (n,) in [rad]; of a driving slider its displacement in [m].
        joints: column of a joint's coordinate -> (n,) in [rad] or [m], angles not wrapped.
        poses: moving link -> n poses.
        points: tracked point -> (n, 3) in [m].
        driver_rotates: whether the driver is a crank.
    """

    arc: Array
    angle: Array
    joints: Mapping[str, Array]
    poses: Mapping[str, Pose]
    points: Mapping[str, Array]
    driver_rotates: bool = True

    __repr__ = short_repr

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the columns of a table: arc, angle of a crank, J.q ..., P.x ..., in SI."""
        yield "arc", self.arc
        if self.driver_rotates:
            yield "angle", self.angle
        yield from self.joints.items()
        for name, positions in self.points.items():
            for axis, column in zip("xyz", positions.T, strict=True):
                yield f"{name}.{axis}", column


@dataclass(frozen=True)
class AssemblyCurve:
    """A closed curve of assemblies: every pose that a mechanism reaches by continuous motion.

    Arc length is the integral of the norm of all links' velocities: of each link the velocity of its origin
    over the characteristic length, and the angular velocity. For a link with a passive degree of freedom the
    velocities of its joints are used instead.

    Attributes:
        loops: loop equations.
        traced: the curve as segments.
        starts_ended: number of random starts that ended on it.
    """

    loops: FreeLoops
    traced: TracedCurve
    starts_ended: int = 0

    __repr__ = short_repr

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""
        return self.loops.loops.tree.original

    @property
    def length(self) -> float:
        """Arc of the whole curve."""
        return self.traced.length

    @property
    def branch_points(self) -> tuple[float, ...]:
        """Arcs at which another curve, or the curve itself, crosses it."""
        return self.traced.branch_points

    @cached_property
    def joints(self) -> CurveJoints:
        """The coordinates of the joints as polynomials."""
        return CurveJoints(self.loops.loops.tree, self.traced)

    @cached_property
    def driver(self) -> JointColumn:
        """The driven coordinate."""
        return self.joints.columns[self._driver]

    @property
    def turns(self) -> int:
        """Revolutions of the crank, or rounds of a closed curve; 0 if it only oscillates."""
        return round(float(self.joints.gains[self._driver]))

    @cached_property
    def turning_points(self) -> tuple[TurningPoint, ...]:
        """Turning points of the joints' coordinates, in the order of arc; of a dwell its middle.

        Accuracy: values to rounding, arcs to about 1e-9, in a dwell to the spacing of the samples.
        """
        rows = groupby(self._turning_points(self.joints.turns()), lambda point: point.coordinate)
        points = [point for _, row in rows for point in self._one_per_dwell([*row])]
        return tuple(sorted(points, key=lambda point: point.arc))

    def _turning_points(self, turns: Sequence[tuple[int, Extremum, float]]) -> list[TurningPoint]:
        """Return turning points from the index of the column, the kind and the arc of each."""
        if not turns:
            return []
        poses, names = self.poses_at([arc for _, _, arc in turns]), self._names
        return [
            TurningPoint(names[i], which, float(poses.joints[names[i]][k]), arc, float(poses.angle[k]))
            for k, (i, which, arc) in enumerate(turns)
        ]

    def _one_per_dwell(self, points: Sequence[TurningPoint]) -> Iterator[TurningPoint]:
        """Yield the turning points of a column without those at which rounding turns it in a dwell."""
        column = self._names.index(points[0].coordinate)
        values = np.array([point.value for point in points])
        angle = self.joints.columns[column].unit == "rad"
        unit = 1.0 if angle else self.mechanism.characteristic_length
        change = values - np.roll(values, 1)
        starts = np.flatnonzero(np.abs(wrapped(change) if angle else change) > DWELL * unit)
        order = np.roll(np.arange(len(points)), -starts[0] if len(starts) else 0)
        for row in np.split(order, starts[1:] - starts[0]) if len(starts) else [order]:
            first, last = points[row[0]], points[row[-1]]
            if len(row) == 1:
                yield first
            # after an even number of turns the coordinate goes on as before
            elif len(row) % 2:
                middle = (first.arc + 0.5 * ((last.arc - first.arc) % self.length)) % self.length
                yield from self._turning_points([(column, first.which, middle)])

    @property
    def crank_turns(self) -> tuple[TurningPoint, ...]:
        """Turning points of the crank, in the order of arc."""
        return tuple(point for point in self.turning_points if point.coordinate == self.driver.name)

    @property
    def dead_centres(self) -> Array:
        """Crank angles of the dead centres, (k,) in [rad], in the order of arc."""
        return np.array([point.value for point in self.crank_turns])

    def poses_at(self, arc: ArrayLike) -> CurvePoses:
        """Return the poses at arcs (n,) from 0 to the length; angles at the end include whole revolutions.

        Accuracy: loop residuals at rounding level; within 2e-3 of a branch point 1e-11 of the size.
        """
        arcs = np.atleast_1d(numbers(arc))
        tree, chunks, order = self.loops.loops.tree, [], []
        for segment, rows in self.traced.groups(arcs):
            singular = np.zeros(len(rows), dtype=np.bool_)
            for branch_point in self.branch_points:
                singular |= np.abs(arcs[rows] - branch_point) < MIN_DISTANCE_FROM_BRANCH_POINT
            placed = self.loops.corrected(segment.solver, segment.evaluate(arcs[rows]), singular)
            interpolated = self.joints.tables.evaluate(arcs[rows])
            joints = read_joints(tree, placed)
            joints += self.joints.angular * REVOLUTION * np.round((interpolated - joints) / REVOLUTION)
            chunks.append((joints, placed.position, placed.rotation))
            order.append(rows)
        back = np.argsort(np.concatenate(order))
        joints = np.concatenate([chunk[0] for chunk in chunks])[back] + self._revolution_offsets
        position, rotation = (np.concatenate([chunk[k] for chunk in chunks], -1)[..., back] for k in (1, 2))
        poses = LinkPoses(position, rotation, np.empty(0)).by_link(tree.index)
        named = {column.name: joints[:, i] for i, column in enumerate(self.joints.columns)}
        moving = [(name, owner) for name, owner in self.mechanism.points.items() if owner[0] != GROUND]
        points = {name: poses[link].point(local) for name, (link, local) in moving}
        return CurvePoses(arcs, named[self.driver.name], named, poses, points, self.driver.unit == "rad")

    def samples(self, count: int) -> CurvePoses:
        """Return the poses at `count` arcs, evenly spaced over the closed curve, both ends included."""
        return self.poses_at(np.linspace(0.0, self.length, count))

    @property
    def _names(self) -> list[str]:
        return [column.name for column in self.joints.columns]

    @cached_property
    def _driver(self) -> int:
        columns, driver = self.joints.columns, self.mechanism.drivers[0]
        return next(i for i, column in enumerate(columns) if column.coordinate == driver)

    @cached_property
    def _revolution_offsets(self) -> Array:
        """Whole revolutions that wrap the start of each coordinate into (-pi, pi], the crank about its start.

        Coordinates in a coupling keep their multi-turn values.
        """
        initial, columns = self.joints.interpolated(0.0), self.joints.columns
        middle = np.zeros(len(initial))
        middle[self._driver] = self.mechanism.start
        offsets = -REVOLUTION * np.round((initial - middle) / REVOLUTION)
        tree, first = self.loops.loops.tree, self.traced.segments[0].coordinates.values[:, 0]
        coupled = {name for law in self.mechanism.laws for name in law.coordinates}
        for i, column in enumerate(columns):
            if column.coordinate in coupled:
                offsets[i] = REVOLUTION * np.round(
                    (first[tree.index_of[column.coordinate]] - initial[i]) / REVOLUTION
                )
        return offsets * self.joints.angular
