"""One closed curve of assemblies: poses anywhere along it, and where its coordinates turn back."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.tree_motion import LinkPoses
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import short_repr
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers
from mechsim.theory.continuation.curve_joints import CurveJoints, JointColumn, posed, read_joints
from mechsim.theory.continuation.free_loops import FreeLoops
from mechsim.theory.continuation.segments import MIN_DISTANCE_FROM_BRANCH_POINT, TracedCurve


@dataclass(frozen=True, slots=True)
class TurningPoint:
    """A turning point of a coordinate: a maximum or minimum along the curve.

    Attributes:
        coordinate: name of its column.
        highest: whether it is a maximum; otherwise a minimum.
        value: of the coordinate, in [rad] or [m].
        arc: position on the curve.
        angle: of the crank in [rad].
    """

    coordinate: str
    highest: bool
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
        """What moves."""
        return self.loops.loops.tree.original

    @property
    def length(self) -> float:
        """Arc of the whole curve."""
        return self.traced.length

    @property
    def branch_points(self) -> tuple[float, ...]:
        """Arcs at which another curve, or this one itself, crosses."""
        return self.traced.branch_points

    @cached_property
    def joints(self) -> CurveJoints:
        """The coordinates of the joints as polynomials."""
        return CurveJoints(self.loops.loops.tree, self.traced)

    @cached_property
    def driver(self) -> JointColumn:
        """The coordinate that is driven."""
        return self.joints.columns[self._driver]

    @property
    def turns(self) -> int:
        """Revolutions of the crank along the whole curve; 0 where it only oscillates."""
        return round(float(self.joints.gains[self._driver]) / TURN)

    @cached_property
    def turning_points(self) -> tuple[TurningPoint, ...]:
        """Turning points of the joints' coordinates, in the order of arc.

        Accuracy: values to rounding, arcs to about 1e-9.
        """
        turns = self.joints.turns()
        if not turns:
            return ()
        poses = self.poses_at([arc for _, _, arc in turns])
        names = [self.joints.columns[i].name for i, _, _ in turns]
        return tuple(
            TurningPoint(name, highest, float(poses.joints[name][k]), arc, float(poses.angle[k]))
            for k, (name, (_, highest, arc)) in enumerate(zip(names, turns, strict=True))
        )

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
        indices = np.array([self.traced.segment_index(value) for value in arcs.tolist()])
        tree, chunks, order = self.loops.loops.tree, [], []
        for i in np.unique(indices).tolist():
            segment, rows = self.traced.segments[i], np.flatnonzero(indices == i)
            singular = np.zeros(len(rows), dtype=np.bool_)
            for branch_point in self.branch_points:
                singular |= np.abs(arcs[rows] - branch_point) < MIN_DISTANCE_FROM_BRANCH_POINT
            placed = self.loops.corrected(
                segment.solver, segment.evaluate(segment.coefficients, arcs[rows]), singular
            )
            interpolated = segment.evaluate(self.joints.tables[i], arcs[rows])
            joints = read_joints(tree, placed)
            joints += self.joints.angular * TURN * np.round((interpolated - joints) / TURN)
            chunks.append((joints, placed.position, placed.rotation))
            order.append(rows)
        back = np.argsort(np.concatenate(order))
        joints = np.concatenate([chunk[0] for chunk in chunks])[back] + self._revolution_offsets
        position, rotation = (np.concatenate([chunk[k] for chunk in chunks], -1)[..., back] for k in (1, 2))
        return self._record(arcs, joints, posed(tree, LinkPoses(position, rotation, np.empty(0))))

    def samples(self, count: int) -> CurvePoses:
        """Return the poses at `count` arcs, evenly spaced over the closed curve, both ends included."""
        return self.poses_at(np.linspace(0.0, self.length, count))

    def _record(self, arc: Array, joints: Array, poses: Mapping[str, Pose]) -> CurvePoses:
        named = {column.name: joints[:, i] for i, column in enumerate(self.joints.columns)}
        moving = [(name, owner) for name, owner in self.mechanism.points.items() if owner[0] != GROUND]
        points = {name: poses[link].point(local) for name, (link, local) in moving}
        return CurvePoses(arc, named[self.driver.name], named, poses, points, self.driver.unit == "rad")

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
        offsets = -TURN * np.round((initial - middle) / TURN)
        tree, first = self.loops.loops.tree, self.traced.segments[0].coordinates.values[:, 0]
        coupled = {name for law in self.mechanism.laws for name in law.coordinates}
        for i, column in enumerate(columns):
            if column.coordinate in coupled:
                offsets[i] = TURN * np.round((first[tree.index_of[column.coordinate]] - initial[i]) / TURN)
        return offsets * self.joints.angular
