"""A closed curve of assemblies: poses anywhere along it, and turning points of its coordinates."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from operator import attrgetter
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.kinematics.continuation.free_loops import FreeLoops
from mechsim.kinematics.continuation.segments import MIN_DISTANCE_FROM_BRANCH_POINT, NODES, TracedCurve
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses, link_poses
from mechsim.kinematics.loops.tree import SpanningTree
from mechsim.mechanism.joint_kinds import KINDS, Kind, KindName, coordinates
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import REVOLUTION, ROUNDING, Array, numbers, wrapped
from mechsim.numerics.collocation import Interpolant, Piecewise
from mechsim.numerics.newton import roots

Extremum = Literal["highest", "lowest"]
# arcs in a segment at which rates are checked for a change of sign
SAMPLES = 4 * NODES
# largest product of the numbers of coordinates and poses that are corrected together
TOGETHER = 50_000
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


@dataclass(frozen=True, slots=True)
class LikeJoints:
    """Joints of a kind and a cross angle.

    Attributes:
        kind: their kind.
        cross_angle: angle between crossed axes, in [rad].
        columns: their coordinates among those of all joints, (k, coordinates).
        links: index of the link of either side, the ground's is -1, (2, k).
        points: points of both sides in their links, (2, k, 3) in [m].
        frames: joint frames of both sides in their links, (2, k, 3, 3).
    """

    kind: Kind
    cross_angle: float
    columns: NDArray[np.intp]
    links: NDArray[np.intp]
    points: Array
    frames: Array

    def coordinates(self, position: Array, rotation: Array) -> Array:
        """Return their coordinates at n poses of all links, (k, n, coordinates) in SI."""
        points, frames = list[Array](), list[Array]()
        for links, point, frame in zip(self.links, self.points, self.frames, strict=True):
            own = rotation[links]
            points.append(position[links] + (own @ point[:, None, :, None])[..., 0])
            frames.append(own @ frame[:, None])
        return coordinates(self.kind, points[1] - points[0], frames[0], frames[1], self.cross_angle)


def like_joints(tree: SpanningTree) -> list[LikeJoints]:
    """Return the joints with coordinates that close loops, those of a kind together."""
    groups, columns = dict[tuple[KindName, float], list[tuple[Joint, range]]](), 0
    for joint in tree.original.joints:
        own = range(columns, columns + len(KINDS[joint.kind].units))
        if own and not tree.index_of.keys() >= {*joint.coordinates}:
            groups.setdefault((joint.kind, joint.cross_angle), []).append((joint, own))
        columns = own.stop
    index = {GROUND: -1, **tree.index}
    like: list[LikeJoints] = []
    for (kind, cross_angle), pairs in groups.items():
        sides = [[joint.a for joint, _ in pairs], [joint.b for joint, _ in pairs]]
        links, points, frames = (
            np.array([[read(end) for end in ends] for ends in sides])
            for read in (lambda end: index[end.link], lambda end: end.point, lambda end: end.frame)
        )
        own_columns = np.array([own for _, own in pairs], dtype=np.intp)
        like.append(LikeJoints(KINDS[kind], cross_angle, own_columns, links, points, frames))
    return like


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
    def _like(self) -> list[LikeJoints]:
        return like_joints(self.tree)

    @cached_property
    def _in_tree(self) -> NDArray[np.intp]:
        """Columns of the tree's joints, and their indices among its coordinates, (2, k)."""
        indices = np.array([self.tree.index_of.get(column.coordinate, -1) for column in self.columns])
        return np.stack([np.flatnonzero(indices >= 0), indices[indices >= 0]])

    def read(self, q: Coordinates, poses: LinkPoses) -> Array:
        """Return the coordinates at n sets of those of the tree and poses, (n, columns) in SI."""
        n = len(q)
        position = np.concatenate([poses.position.transpose(0, 2, 1), np.zeros((1, n, 3))])
        ground = np.broadcast_to(np.eye(3), (1, n, 3, 3))
        rotation = np.concatenate([poses.rotation.transpose(0, 3, 1, 2), ground])
        values, (columns, indices) = np.empty((n, len(self.columns))), self._in_tree
        values[:, columns] = q.values[indices].T
        for like in self._like:
            values[:, like.columns] = like.coordinates(position, rotation).swapaxes(0, 1)
        return values

    @cached_property
    def tables(self) -> Piecewise[Interpolant]:
        """Their polynomials."""
        tables: list[Interpolant] = []
        last: Array | None = None
        angles = self.angular > 0.0
        for segment in self.traced.segments:
            values = self.read(segment.coordinates, link_poses(self.tree, segment.coordinates))
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
        # arcs over the whole curve, where the coordinates rise, (n, columns), and their bounds
        grids, signs = list[Array](), list[NDArray[np.bool_]]()
        lowest, highest = np.full((2, len(self.columns)), [[np.inf], [-np.inf]])
        for table, rate in zip(self.tables.segments, self.rates.segments, strict=True):
            grid = np.linspace(table.low, table.high, SAMPLES, endpoint=False)
            grid = grid[grid < self.traced.length]
            values = table.evaluate(grid)
            lowest, highest = np.minimum(lowest, values.min(0)), np.maximum(highest, values.max(0))
            grids.append(grid)
            signs.append(rate.evaluate(grid) > 0.0)
        grid, rising = np.concatenate(grids), np.concatenate(signs)
        units = np.where(self.angular > 0.0, 1.0, self.tree.mechanism.characteristic_length)
        moving = np.flatnonzero(highest - lowest > ROUNDING * units)
        # the curve is closed: the last sample is followed by the first
        own, sample = np.nonzero((rising != np.roll(rising, -1, axis=0))[:, moving].T)
        columns, low, arcs = moving[own], grid[sample], np.append(grid[1:], self.traced.length)[sample]
        between = self.rates.components(low, columns) * self.rates.components(arcs, columns) < 0.0
        arcs[between] = roots(self.rates.components, low[between], arcs[between], columns[between])
        return [
            (i, "highest" if rising[k, i] else "lowest", arc)
            for i, k, arc in zip(columns.tolist(), sample.tolist(), arcs.tolist(), strict=True)
        ]


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
        arcs, names = np.array([arc for _, _, arc in turns]), self._names
        joints = np.empty((len(arcs), len(names)))
        for rows, own, _ in self._corrected(arcs):
            joints[rows] = own
        angles = joints[:, self._driver].tolist()
        return [
            TurningPoint(names[i], which, float(joints[k, i]), arc, angles[k])
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
        tree, chunks = self.loops.loops.tree, [*self._corrected(arcs)]
        back = np.argsort(np.concatenate([rows for rows, _, _ in chunks]))
        joints = np.concatenate([own for _, own, _ in chunks])[back]
        position, rotation = (
            np.concatenate([component(placed) for _, _, placed in chunks], -1)[..., back]
            for component in (attrgetter("position"), attrgetter("rotation"))
        )
        poses = LinkPoses(position, rotation, np.empty(0)).by_link(tree.index)
        named = {column.name: joints[:, i] for i, column in enumerate(self.joints.columns)}
        moving = [(name, owner) for name, owner in self.mechanism.points.items() if owner[0] != GROUND]
        points = {name: poses[link].point(local) for name, (link, local) in moving}
        return CurvePoses(arcs, named[self.driver.name], named, poses, points, self.driver.unit == "rad")

    def _corrected(self, arcs: Array) -> Iterator[tuple[NDArray[np.intp], Array, LinkPoses]]:
        """Yield indices of arcs, the joints' coordinates there, (n, columns), and the poses."""
        # at a dead centre all coordinates may turn, in one segment
        together = max(1, TOGETHER // self.loops.loops.tree.count)
        chunks = (
            (segment, every[first : first + together])
            for segment, every in self.traced.groups(arcs)
            for first in range(0, len(every), together)
        )
        for segment, rows in chunks:
            singular = np.zeros(len(rows), dtype=np.bool_)
            for branch_point in self.branch_points:
                singular |= np.abs(arcs[rows] - branch_point) < MIN_DISTANCE_FROM_BRANCH_POINT
            q, placed = self.loops.corrected(segment.solver, segment.evaluate(arcs[rows]), singular)
            interpolated = self.joints.tables.evaluate(arcs[rows])
            joints = self.joints.read(q, placed)
            joints += self.joints.angular * REVOLUTION * np.round((interpolated - joints) / REVOLUTION)
            yield rows, joints + self._revolution_offsets, placed

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
