"""The loops of a mechanism in coordinates of its tree: how far they stand open, and closing them.

Unknown are the coordinates that no driver prescribes. Where the rows repeat each other, as in a flat
linkage, as many are kept as are independent; where they leave a link's spin open, a gauge keeps it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.coupled_rows import CoupledRow, coupled_rows
from mechsim.analytic.closure.cut_rows import Cut, cuts_of
from mechsim.analytic.closure.spanning_tree import SpanningTree, spanning_tree
from mechsim.analytic.closure.tree_motion import Coordinates, Placed, cross, placed, product
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import coordinates
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.split_joints import with_stand_ins


@dataclass(frozen=True)
class TreeLoops:
    """The loop equations of a mechanism in the coordinates of a spanning tree.

    Attributes:
        tree: the tree.
        cuts: the joints that close its loops.
        winds: of each coupling, the whole turns between its sides as put together, in [rad].
        driven: indices of the coordinates that are prescribed.
    """

    tree: SpanningTree
    cuts: tuple[Cut, ...]
    winds: tuple[float, ...]
    driven: tuple[int, ...]

    @cached_property
    def unknown(self) -> NDArray[np.intp]:
        """Indices of the coordinates that the loops determine."""
        return np.delete(np.arange(self.tree.count), self.driven)

    @cached_property
    def units(self) -> Array:
        """Of the tree: what one unit of each coordinate is in the equations."""
        return self.tree.units

    @cached_property
    def couplings(self) -> tuple[CoupledRow, ...]:
        """The rows of the couplings."""
        return coupled_rows(self.tree)

    @cached_property
    def rows(self) -> int:
        """How many equations there are."""
        return sum(cut.rows for cut in self.cuts) + len(self.winds)

    def linearise(self, at: Coordinates) -> tuple[Array, Array, Placed]:
        """Return residuals (rows, n), slopes by coordinates in units (rows, count, n), and the links."""
        here = placed(self.tree, at)
        n = len(at)
        number = at.values.dtype
        residual = np.empty((self.rows, n), number)
        slope = np.zeros((self.rows, self.tree.count, n), number)
        k = 0
        for cut in self.cuts:
            part = slice(k, k + cut.rows)
            residual[part], slope[part, cut.span] = cut.residual_and_slope(here)
            k += cut.rows
        for coupling, wind in zip(self.couplings, self.winds, strict=True):
            opened, by_value, _ = coupling.look(at.values)
            slope[k] = by_value * self.units[:, None]
            residual[k] = opened - wind / coupling.unit
            k += 1
        return residual, slope, here

    def bias(self, at: Coordinates, here: Placed, rates: Array, twist: Array, drift: Array) -> Array:
        """Return the residuals' second rate at coordinate rates (count, n) that do not change, (rows, n)."""
        parts = [cut.bias(here, twist, drift) for cut in self.cuts]
        bent = [coupling.bias(at.values, rates)[None] for coupling in self.couplings]
        return np.concatenate([np.empty((0, len(at))), *parts, *bent])

    def moved(self, at: Coordinates, step: Array) -> Coordinates:
        """Return coordinates moved by a step (count, n) in their units."""
        values, turns = at.values + step * self.units[:, None], at.turns
        if len(turns):
            values[self.tree.ball_places] = 0.0
            turns = np.stack(
                [
                    _turned(turn, step[ball.turning : ball.turning + 3])
                    for turn, ball in zip(turns, self.tree.balls, strict=True)
                ]
            )
        return Coordinates(values, turns)

    def read(self, poses: Mapping[str, Pose], angles: Mapping[str, float]) -> Coordinates:
        """Return the coordinates of one pose of every moving link; given angles as they are counted."""
        everywhere = {GROUND: IDENTITY, **with_stand_ins(self.tree.mechanism, poses)}
        values, turns = np.zeros((self.tree.count, 1)), np.empty((len(self.tree.balls), 3, 3, 1))
        ball = 0
        for branch in self.tree.branches:
            joint = branch.joint
            a, b = ((everywhere[end.link], end) for end in (joint.a, joint.b))
            (place_a, turn_a), (place_b, turn_b) = (
                (_first(pose.point(end.point), 1), _first(pose.rotation, 2) @ end.frame)
                for pose, end in (a, b)
            )
            if branch.kind.ball:
                turns[ball, ..., 0] = turn_a.T @ turn_b
                ball += 1
            found = coordinates(branch.kind, place_b - place_a, turn_a, turn_b, joint.cross_angle)
            values[branch.first : branch.first + len(found), 0] = found
            for i, name in enumerate(joint.coordinates):
                if name in angles:
                    values[branch.first + i, 0] = angles[name]
        return Coordinates(values, turns)


def tree_loops(
    mechanism: Mechanism, poses: Mapping[str, Pose], counted: Mapping[str, float]
) -> tuple[TreeLoops, Coordinates]:
    """Return the loops of a mechanism and the coordinates of its poses.

    Args:
        mechanism: the mechanism.
        poses: of every moving link, closed or nearly so.
        counted: coordinate -> value, of those that the poses do not tell exactly: of angles the turns, of
            drivers and holds where they stand.
    """
    tree = spanning_tree(mechanism)
    prescribed = {*mechanism.drivers, *mechanism.locked}
    driven = tuple(tree.places[name] for name in (*mechanism.drivers, *mechanism.locked))
    loops = TreeLoops(tree, cuts_of(tree), (), driven)
    at = loops.read(poses, {})
    for name, value in counted.items():
        place = tree.places.get(name)
        if place is None:
            continue
        lap = 0.0 if tree.slides[place] else TURN * float(np.round((value - at.values[place, 0]) / TURN))
        at.values[place, 0] = value if name in prescribed else at.values[place, 0] + lap
    winds = [
        TURN * float(np.round(row.look(at.values)[0][0] * row.unit / TURN)) if row.turns else 0.0
        for row in loops.couplings
    ]
    return replace(loops, winds=tuple(winds)), at


def _first(value: Array, axes: int) -> Array:
    return value[0] if value.ndim > axes else value


def _turned(turn: Array, vector: Array) -> Array:
    """Return exp(vector) @ turn, (3, 3, n), made orthogonal again to rounding."""
    angle = np.sqrt((vector**2).sum(0))
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    once = cross(vector[:, None], turn)
    moved = turn + a * once + b * cross(vector[:, None], once)
    return orthogonal(moved)


def orthogonal(turn: Array) -> Array:
    """Return nearly orthogonal matrices (3, 3, n) a Newton step nearer to the nearest rotations."""
    return 1.5 * turn - 0.5 * product(turn, product(turn.transpose(1, 0, 2), turn))
