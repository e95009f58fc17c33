"""The coordinates of all joints along a traced curve, cut joints included, as multi-turn polynomials."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mechsim.analytic.loops.spanning_tree import SpanningTree
from mechsim.analytic.loops.tree_motion import LinkPoses, link_poses
from mechsim.model.joint_kinds import KINDS, coordinates
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.numerics.interpolation import derivative
from mechsim.numerics.newton import root
from mechsim.theory.continuation.segments import NODES, TracedCurve

# a coordinate whose range is smaller, in radians or relative to the characteristic length, is constant
STILL = 1e-9
# arcs in a segment at which rates are checked for a change of sign
SAMPLES = 4 * NODES


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
    n = poses.position.shape[2]
    by_link = {GROUND: Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))} | posed(tree, poses)
    values: list[Array] = []
    for joint in tree.original.joints:
        kind = KINDS[joint.kind]
        if kind.units:
            a, b = by_link[joint.a.link], by_link[joint.b.link]
            offset = b.point(joint.b.point) - a.point(joint.a.point)
            frames = a.rotation @ joint.a.frame, b.rotation @ joint.b.frame
            values.append(coordinates(kind, offset, *frames, joint.cross_angle))
    return np.concatenate(values, 1)


def posed(tree: SpanningTree, poses: LinkPoses) -> dict[str, Pose]:
    """Return the poses of the moving links: name -> n poses."""
    return {
        name: Pose(poses.position[i].T, poses.rotation[i].transpose(2, 0, 1))
        for name, i in tree.index.items()
    }


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
    def tables(self) -> list[Array]:
        """Coefficients of their polynomials for each segment, (k, columns)."""
        tables: list[Array] = []
        last: Array | None = None
        angles = self.angular > 0.0
        for segment in self.traced.segments:
            values = read_joints(self.tree, link_poses(self.tree, segment.coordinates))
            values[:, angles] = np.unwrap(values[:, angles], axis=0)
            if last is not None:
                values += self.angular * TURN * np.round((last - values[0]) / TURN)
            last = values[-1]
            tables.append(segment.fitted(values))
        return tables

    def interpolated(self, arc: float) -> Array:
        """Return the interpolated coordinates at an arc, (columns,)."""
        i = self.traced.segment_index(arc)
        return self.traced.segments[i].evaluate(self.tables[i], np.array([arc]))[0]

    @cached_property
    def gains(self) -> Array:
        """Increase of each coordinate along the whole curve: whole revolutions, or zero, (columns,)."""
        return (
            self.angular
            * TURN
            * np.round((self.interpolated(self.traced.length) - self.interpolated(0.0)) / TURN)
        )

    def turns(self) -> list[tuple[int, bool, float]]:
        """Return the turning points: index of the column, whether it is a maximum, and the arc.

        Accuracy: of the arcs about 1e-9.
        """
        turns: list[tuple[int, bool, float]] = []
        grid, values, rates = self._samples()
        units = np.where(self.angular > 0.0, 1.0, self.tree.mechanism.size)
        for i in np.flatnonzero(np.ptp(values, axis=0) > STILL * units).tolist():
            rising = rates[:, i] > 0.0
            # the curve is closed: the last sample is followed by the first
            for k in np.flatnonzero(rising != np.roll(rising, -1)).tolist():
                end = float(grid[k + 1]) if k + 1 < len(grid) else self.traced.length
                turns.append((i, bool(rising[k]), self._turning_arc(i, float(grid[k]), end)))
        return sorted(turns, key=lambda turn: turn[2])

    def _samples(self) -> tuple[Array, Array, Array]:
        """Return arcs over the whole curve, and values and rates there, (n, columns)."""
        chunks: list[tuple[Array, Array, Array]] = []
        for segment, table in zip(self.traced.segments, self.tables, strict=True):
            grid = np.linspace(segment.low, segment.high, SAMPLES, endpoint=False)
            grid = grid[grid < self.traced.length]
            chunks.append((grid, segment.evaluate(table, grid), segment.evaluate(derivative(table), grid)))
        grid, values, rates = (np.concatenate(column) for column in zip(*chunks, strict=True))
        return grid, values, rates

    def _turning_arc(self, column: int, low: float, high: float) -> float:
        """Return the arc between two at which a coordinate has a turning point."""

        def rate(arc: float) -> float:
            i = self.traced.segment_index(arc)
            fit = derivative(self.tables[i][:, [column]])
            return float(self.traced.segments[i].evaluate(fit, np.array([arc]))[0, 0])

        return root(rate, low, high) if rate(low) * rate(high) < 0.0 else high
