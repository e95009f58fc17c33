"""One closed curve of assemblies: poses anywhere along it, and where its coordinates turn back."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.closure.tree_motion import LinkPoses
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.maths.given import numbers
from mechsim.model.display import short_repr
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.theory.continuation.cells import CLEAR, Walked
from mechsim.theory.continuation.curve_joints import CurveJoints, JointColumn, posed, read_joints
from mechsim.theory.continuation.free_loops import FreeLoops


@dataclass(frozen=True, slots=True)
class TurningPoint:
    """A place where a coordinate turns back.

    Attributes:
        coordinate: as its column is called.
        highest: whether it is highest there, or lowest.
        value: of the coordinate, in [rad] or [m].
        arc: where on the curve.
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
        angle: of the crank, not wrapped, (n,) in [rad]; of a slide that drives, its way in [m].
        joints: column of a joint's coordinate -> (n,) in [rad] or [m], angles not wrapped.
        poses: moving link -> n poses.
        points: tracked point -> (n, 3) in [m].
        turning: whether the driver is a crank.
    """

    arc: Array
    angle: Array
    joints: Mapping[str, Array]
    poses: Mapping[str, Pose]
    points: Mapping[str, Array]
    turning: bool = True

    __repr__ = short_repr

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the columns of a table: arc, angle of a crank, J.q ..., P.x ..., in SI."""
        yield "arc", self.arc
        if self.turning:
            yield "angle", self.angle
        yield from self.joints.items()
        for name, places in self.points.items():
            for axis, column in zip("xyz", places.T, strict=True):
                yield f"{name}.{axis}", column


@dataclass(frozen=True)
class AssemblyCurve:
    """Every pose that a mechanism reaches by moving on without a jump, round to where it began.

    Arc is the length of the way: of each link velocity of its origin over the mechanism's size, and angular
    velocity, squared and summed; of a link that spins idly the velocities of its joints instead.

    Attributes:
        loops: the equations.
        walked: the curve as it was walked.
        found: how many random starts ended on it.
    """

    loops: FreeLoops
    walked: Walked
    found: int = 0

    __repr__ = short_repr

    @property
    def mechanism(self) -> Mechanism:
        """What moves."""
        return self.loops.loops.tree.original

    @property
    def length(self) -> float:
        """Arc of the whole curve."""
        return self.walked.length

    @property
    def meetings(self) -> tuple[float, ...]:
        """Arcs at which another curve, or another part of this one, crosses."""
        return self.walked.meetings

    @cached_property
    def joints(self) -> CurveJoints:
        """The coordinates of the joints as polynomials."""
        return CurveJoints(self.loops.loops.tree, self.walked)

    @cached_property
    def driver(self) -> JointColumn:
        """The coordinate that is driven."""
        return self.joints.columns[self._driver]

    @property
    def turns(self) -> int:
        """Turns of the crank in one round; 0 where it only swings."""
        return round(float(self.joints.gains[self._driver]) / TURN)

    @cached_property
    def turning_points(self) -> tuple[TurningPoint, ...]:
        """Where the coordinates of joints turn back, in the order in which they are passed.

        Accuracy: values to rounding, arcs to about 1e-9.
        """
        found = self.joints.turns()
        if not found:
            return ()
        there = self.at([arc for _, _, arc in found])
        names = [self.joints.columns[i].name for i, _, _ in found]
        return tuple(
            TurningPoint(name, highest, float(there.joints[name][k]), arc, float(there.angle[k]))
            for k, (name, (_, highest, arc)) in enumerate(zip(names, found, strict=True))
        )

    @property
    def crank_turns(self) -> tuple[TurningPoint, ...]:
        """Where the crank turns back, in the order in which it does."""
        return tuple(one for one in self.turning_points if one.coordinate == self.driver.name)

    @property
    def dead_centres(self) -> Array:
        """Crank angles at which the crank turns back, (k,) in [rad], as they are passed."""
        return np.array([one.value for one in self.crank_turns])

    def at(self, arc: ArrayLike) -> CurvePoses:
        """Return the poses at arcs (n,) from 0 to the length, the end told from the start by whole turns.

        Accuracy: loops close to rounding; within 2e-3 of where assemblies meet to 1e-11 of the size.
        """
        asked = np.atleast_1d(numbers(arc))
        of = np.array([self.walked.place(one) for one in asked.tolist()])
        tree, parts, order = self.loops.loops.tree, [], []
        for i in np.unique(of).tolist():
            cell, some = self.walked.cells[i], np.flatnonzero(of == i)
            blind = np.zeros(len(some), dtype=np.bool_)
            for meeting in self.meetings:
                blind |= np.abs(asked[some] - meeting) < CLEAR
            here = self.loops.polished(cell.solver, cell.at(cell.rows, asked[some]), blind)
            near = cell.at(self.joints.tables[i], asked[some])
            joints = read_joints(tree, here)
            joints += self.joints.angular * TURN * np.round((near - joints) / TURN)
            parts.append((joints, here.position, here.rotation))
            order.append(some)
        back = np.argsort(np.concatenate(order))
        joints = np.concatenate([part[0] for part in parts])[back] + self._laps
        position, rotation = (np.concatenate([part[k] for part in parts], -1)[..., back] for k in (1, 2))
        return self._record(asked, joints, posed(tree, LinkPoses(position, rotation, np.empty(0))))

    def samples(self, count: int) -> CurvePoses:
        """Return the poses at so many arcs, evenly spaced from the start round to the start."""
        return self.at(np.linspace(0.0, self.length, count))

    def _record(self, arc: Array, joints: Array, poses: Mapping[str, Pose]) -> CurvePoses:
        named = {column.name: joints[:, i] for i, column in enumerate(self.joints.columns)}
        moving = [(name, place) for name, place in self.mechanism.points.items() if place[0] != GROUND]
        points = {name: poses[link].point(at) for name, (link, at) in moving}
        return CurvePoses(arc, named[self.driver.name], named, poses, points, self.driver.unit == "rad")

    @cached_property
    def _driver(self) -> int:
        columns, driver = self.joints.columns, self.mechanism.drivers[0]
        return next(i for i, column in enumerate(columns) if column.coordinate == driver)

    @cached_property
    def _laps(self) -> Array:
        """Whole turns that put the start of each coordinate into (-pi, pi], the crank about its start.

        Coordinates that a coupling joins keep the turns by which it counts them.
        """
        begin, columns = self.joints.rough(0.0), self.joints.columns
        middle = np.zeros(len(begin))
        middle[self._driver] = self.mechanism.start
        laps = -TURN * np.round((begin - middle) / TURN)
        tree, first = self.loops.loops.tree, self.walked.cells[0].closed.values[:, 0]
        coupled = {name for law in self.mechanism.laws for name in law.coordinates}
        for i, column in enumerate(columns):
            if column.coordinate in coupled:
                laps[i] = TURN * np.round((first[tree.index_of[column.coordinate]] - begin[i]) / TURN)
        return laps * self.joints.angular
