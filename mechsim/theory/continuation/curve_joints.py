"""The coordinates of all joints along a walked curve, cut joints among them: polynomials that count turns."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mechsim.analytic.closure.spanning_tree import SpanningTree
from mechsim.analytic.closure.tree_motion import LinkPoses, link_poses
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.maths.polynomials import derivative
from mechsim.maths.roots import root
from mechsim.model.joint_kinds import KINDS, coordinates
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.theory.continuation.cells import NODES, Walked

# a coordinate that moves less than this part of a radian or of the size stands still
STILL = 1e-9
# places in a cell at which rates are looked at for a change of sign
LOOKS = 4 * NODES


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
    """Return the coordinates of all joints of a mechanism; the turns of balls are none."""
    found: list[JointColumn] = []
    for joint in mechanism.joints:
        units = KINDS[joint.kind].units
        for i, (name, unit) in enumerate(zip(joint.coordinates, units, strict=True)):
            column = f"{joint.name}.q{i if len(units) > 1 else ''}"
            found.append(JointColumn(column, joint.name, name, unit))
    return tuple(found)


def read_joints(tree: SpanningTree, here: LinkPoses) -> Array:
    """Return the coordinates of all joints at n poses, (n, columns) in SI; angles in (-pi, pi]."""
    n = here.position.shape[2]
    everywhere = {GROUND: Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))} | posed(tree, here)
    found: list[Array] = []
    for joint in tree.original.joints:
        kind = KINDS[joint.kind]
        if kind.units:
            a, b = everywhere[joint.a.link], everywhere[joint.b.link]
            gap = b.point(joint.b.point) - a.point(joint.a.point)
            frames = a.rotation @ joint.a.frame, b.rotation @ joint.b.frame
            found.append(coordinates(kind, gap, *frames, joint.cross_angle))
    return np.concatenate(found, 1)


def posed(tree: SpanningTree, here: LinkPoses) -> dict[str, Pose]:
    """Return the poses of the moving links: name -> n poses."""
    return {
        name: Pose(here.position[i].T, here.rotation[i].transpose(2, 0, 1)) for name, i in tree.index.items()
    }


@dataclass(frozen=True)
class CurveJoints:
    """The joints' coordinates along a walked curve, which go on from cell to cell.

    Attributes:
        tree: of the mechanism.
        walked: the curve.
    """

    tree: SpanningTree
    walked: Walked

    @cached_property
    def columns(self) -> tuple[JointColumn, ...]:
        """What they are."""
        return joint_columns(self.tree.original)

    @cached_property
    def angular(self) -> Array:
        """Which of them are angles, (columns,), 1 or 0."""
        return np.array([column.unit == "rad" for column in self.columns], dtype=np.float64)

    @cached_property
    def tables(self) -> list[Array]:
        """Of each cell the coefficients of their polynomials, (k, columns)."""
        tables: list[Array] = []
        last: Array | None = None
        angles = self.angular > 0.0
        for cell in self.walked.cells:
            values = read_joints(self.tree, link_poses(self.tree, cell.closed))
            values[:, angles] = np.unwrap(values[:, angles], axis=0)
            if last is not None:
                values += self.angular * TURN * np.round((last - values[0]) / TURN)
            last = values[-1]
            tables.append(cell.fitted(values))
        return tables

    def rough(self, arc: float) -> Array:
        """Return them at an arc of the first round, (columns,), as the polynomials have them."""
        i = self.walked.place(arc)
        return self.walked.cells[i].at(self.tables[i], np.array([arc]))[0]

    @cached_property
    def gains(self) -> Array:
        """By how much each has grown after one round: whole turns, or nought, (columns,)."""
        return self.angular * TURN * np.round((self.rough(self.walked.length) - self.rough(0.0)) / TURN)

    def turns(self) -> list[tuple[int, bool, float]]:
        """Return where they turn back: which column, whether it is highest there, and the arc.

        Accuracy: of the arcs about 1e-9.
        """
        found: list[tuple[int, bool, float]] = []
        grid, values, rates = self._looks()
        units = np.where(self.angular > 0.0, 1.0, self.tree.mechanism.size)
        for i in np.flatnonzero(np.ptp(values, axis=0) > STILL * units).tolist():
            rising = rates[:, i] > 0.0
            # the curve is a ring: the last look is followed by the first
            for k in np.flatnonzero(rising != np.roll(rising, -1)).tolist():
                end = float(grid[k + 1]) if k + 1 < len(grid) else self.walked.length
                found.append((i, bool(rising[k]), self._turn(i, float(grid[k]), end)))
        return sorted(found, key=lambda one: one[2])

    def _looks(self) -> tuple[Array, Array, Array]:
        """Return arcs of one round, and values and rates there, (n, columns)."""
        parts: list[tuple[Array, Array, Array]] = []
        for cell, table in zip(self.walked.cells, self.tables, strict=True):
            grid = np.linspace(cell.low, cell.high, LOOKS, endpoint=False)
            grid = grid[grid < self.walked.length]
            parts.append((grid, cell.at(table, grid), cell.at(derivative(table), grid)))
        grid, values, rates = (np.concatenate(part) for part in zip(*parts, strict=True))
        return grid, values, rates

    def _turn(self, column: int, low: float, high: float) -> float:
        """Return the arc between two at which a coordinate turns back."""

        def rate(arc: float) -> float:
            i = self.walked.place(arc)
            fit = derivative(self.tables[i][:, [column]])
            return float(self.walked.cells[i].at(fit, np.array([arc]))[0, 0])

        return root(rate, low, high) if rate(low) * rate(high) < 0.0 else high
