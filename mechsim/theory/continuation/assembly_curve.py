"""The assemblies of a whole mechanism as one curve: its loop equations with the crank left free."""

from dataclasses import dataclass

import numpy as np

from mechsim.analytic import closure
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import AssemblyError, InputError
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.display import short_repr
from mechsim.model.mechanism import GROUND, IDENTITY, Mechanism, Pose, joint_coordinate
from mechsim.theory.continuation.arc_length import SINGULAR, Curve, Frame, turns, walk


@dataclass(frozen=True, slots=True)
class AssemblyCurve:
    """Every pose a mechanism can be moved to from its guess, in the order they are passed.

    Attributes:
        crank: crank angle, not wrapped, (n,) in [rad].
        poses: moving link -> n poses.
        points: tracked point -> (n, 3) in [m].
        dead_centres: crank angles at which the crank turns back, in the order passed, (k,) in [rad];
            empty where it turns fully.
        curve: the walk; its length is the integral of sqrt(sum of v2/size2 + w2) over the links, with
            velocity v of a link's origin and angular velocity w, without passive freedoms.
    """

    crank: Array
    poses: dict[str, Pose]
    points: dict[str, Array]
    dead_centres: Array
    curve: Curve

    __repr__ = short_repr


class _LoopEquations:
    """A mechanism as a road. Coordinates: of each link its origin / size and its rotation / sqrt 2.

    So the length of a tangent is that of the twist. Passive freedoms, which move no tracked point,
    are left at rest.
    """

    def __init__(self, mechanism: Mechanism, poses: closure.Poses):
        self.mechanism, self.name, self.size = mechanism, mechanism.name, 1.0
        self.scale = mechanism.size
        self.links = [link.name for link in mechanism.links]
        self.driver = mechanism.crank
        values = np.linalg.svd(self._rows(poses)[1], compute_uv=False)
        self.rank = int((values > SINGULAR * values[0]).sum())

    def packed(self, poses: closure.Poses) -> Array:
        """Return the coordinates of one set of poses, (12 links,)."""
        parts = [
            (poses[n].position.ravel() / self.scale, poses[n].rotation.ravel() / np.sqrt(2.0))
            for n in self.links
        ]
        return np.concatenate([part for pair in parts for part in pair])

    def poses(self, y: Array) -> dict[str, Pose]:
        """Return the poses at coordinates (n, 12 links)."""
        parts = y.reshape(len(y), len(self.links), 12)
        return {
            name: Pose(self.scale * parts[:, i, :3], np.sqrt(2.0) * parts[:, i, 3:].reshape(-1, 3, 3))
            for i, name in enumerate(self.links)
        }

    def crank(self, poses: closure.Poses) -> Array:
        """Return the crank angle, (n,) in [rad]."""
        n = len(next(iter(poses.values())).position)
        ground = Pose(np.zeros((n, 3)), np.broadcast_to(IDENTITY.rotation, (n, 3, 3)))
        ends = [ground if e.link == GROUND else poses[e.link] for e in (self.driver.a, self.driver.b)]
        return joint_coordinate(self.driver, *ends)[:, 0]

    def frame(self, y: Array, along: Array | None) -> Frame:
        poses = self.poses(y[None])
        rows = self._rows(poses)[1]
        u, values, vt = np.linalg.svd(rows)
        if not values[self.rank - 1] > SINGULAR * values[0]:
            raise AssemblyError(f"{self.name}: branches cross at crank angle {self.crank(poses)[0]:.6g} rad")
        idle = vt[self.rank :].T
        marks = self._mark_rates(poses)
        _, seen, turned = np.linalg.svd(marks @ idle)
        if not (seen[0] > SINGULAR and (seen[1:] <= 1e-6 * seen[0]).all()):
            raise InputError(
                f"{self.name}: {idle.shape[1]} directions are free and move tracked points; "
                "couple the cranks by a gear"
            )
        local = idle @ turned[0]
        tangent = self._moved_by(poses, local)
        sign = float(tangent @ along if along is not None else marks[-1] @ local)
        if sign < 0.0:
            local, tangent = -local, -tangent
        free = np.column_stack([vt[: self.rank].T, local])
        return Frame(tangent, rows, local, u[:, : self.rank], free, marks @ local)

    def corrected(self, y: Array) -> tuple[Array, int]:
        before = np.inf
        # what interpolates rotations is none: the nearest one first, or links would change their length
        poses = {
            name: Pose(at.position, _nearest_rotation(at.rotation))
            for name, at in self.poses(y[None]).items()
        }
        for count in range(1, 31):
            gap, rows = self._rows(poses)
            u, values, vt = np.linalg.svd(rows, full_matrices=False)
            kept = slice(self.rank)
            step = vt[kept].T @ ((u[:, kept].T @ gap) / np.maximum(values[kept], SINGULAR * values[0]))
            poses = self._stepped(poses, -step)
            moved = float(np.linalg.norm(step))
            if moved <= 1e-15 or (moved <= 1e-9 and moved >= 0.25 * before):
                return self.packed(poses), count
            before = moved
        raise AssemblyError(
            f"{self.name}: the loops do not close near crank angle {self.crank(poses)[0]:.6g} rad"
        )

    def gap(self, y: Array, other: Array) -> Array:
        first, second = (self._marks(self.poses(at[None])) for at in (y, other))
        gap = first - second
        gap[-1] -= TURN * np.round(gap[-1] / TURN)
        return gap

    def _marks(self, poses: closure.Poses) -> Array:
        """Return what tells places apart: tracked points / size and the crank angle, (3 points + 1,)."""
        points = [poses[link].point(at)[0] / self.scale for link, at in self._moving_points()]
        return np.concatenate([*points, self.crank(poses)])

    def _mark_rates(self, poses: closure.Poses) -> Array:
        """Return the rates of the marks by the twists, (3 points + 1, 6 links)."""
        marks = np.zeros((3 * len(self._moving_points()) + 1, 6 * len(self.links)))
        for i, (link, at) in enumerate(self._moving_points()):
            column = 6 * self.links.index(link)
            arm = (poses[link].rotation[0] @ np.asarray(at)) / self.scale
            marks[3 * i : 3 * i + 3, column : column + 3] = np.eye(3)
            marks[3 * i : 3 * i + 3, column + 3 : column + 6] = np.cross(np.eye(3), arm)
        for sign, end in ((-1.0, self.driver.a), (1.0, self.driver.b)):
            if end.link != GROUND:
                column = 6 * self.links.index(end.link) + 3
                marks[-1, column : column + 3] += sign * self._driver_axis(poses)
        return marks

    def _driver_axis(self, poses: closure.Poses) -> Array:
        end = self.driver.b
        rotation = np.eye(3) if end.link == GROUND else poses[end.link].rotation[0]
        return rotation @ end.frame[:, 2]

    def _moving_points(self) -> list[tuple[str, tuple[float, float, float]]]:
        return [place for place in self.mechanism.points.values() if place[0] != GROUND]

    def _rows(self, poses: closure.Poses) -> tuple[Array, Array]:
        """Return residual and Jacobian by twists with lengths in units of the size, rows scaled to one."""
        rows = closure.equations(self.mechanism, poses, None)
        jacobian = rows.jacobian[0] * np.tile([self.scale] * 3 + [1.0] * 3, len(self.links))
        steepness = np.sqrt((jacobian**2).sum(1))
        steepness = np.where(steepness > 1e-12 * steepness.max(), steepness, steepness.max())
        return rows.residual[0] / steepness, jacobian / steepness[:, None]

    def _moved_by(self, poses: closure.Poses, twist: Array) -> Array:
        parts = twist.reshape(-1, 6)
        turned = [np.cross(parts[i, 3:], poses[n].rotation[0].T).T.ravel() for i, n in enumerate(self.links)]
        return np.concatenate([x for i, r in enumerate(turned) for x in (parts[i, :3], r / np.sqrt(2.0))])

    def _stepped(self, poses: closure.Poses, twist: Array) -> dict[str, Pose]:
        parts = twist.reshape(-1, 6)
        return {
            name: Pose(
                poses[name].position + self.scale * parts[i, :3],
                closure.turned_by(poses[name].rotation, parts[i : i + 1, 3:]),
            )
            for i, name in enumerate(self.links)
        }


def _nearest_rotation(matrix: Array) -> Array:
    u, _, vt = np.linalg.svd(matrix)
    return u @ vt


def trace_mechanism(
    mechanism: Mechanism | ClosedForm,
    *,
    direction: int = 1,
    tolerance: float = 1e-9,
    length: float | None = None,
    most_steps: int = 10_000,
) -> AssemblyCurve:
    """Trace all poses a mechanism can be moved to, through turning points of the crank.

    Where the crank can only swing, the curve passes both dead centres and both assemblies and closes;
    where it turns fully, the curve is one assembly over one turn (or the number of turns after
    which gears repeat). Gears need a whole ratio: with the crank free nothing counts its turns.

    Args:
        mechanism: the mechanism or catalogue drive; assembled from its guess.
        direction: +1 starts with the crank rising, -1 falling.
        tolerance: of the integration; poses close the loops to rounding whatever it is.
        length: where to stop if the curve has not closed; None asks for a closed curve.
        most_steps: steps before giving up.

    Raises:
        AssemblyError: if the mechanism cannot be assembled, where branches cross, or if the curve
            does not close.
        InputError: if more than one direction is free, apart from passive freedoms.
    """
    mechanism = mechanism.mechanism if isinstance(mechanism, ClosedForm) else mechanism
    start = closure.assemble(mechanism, [mechanism.start])
    road = _LoopEquations(mechanism, start)
    y = road.packed(start)
    along = direction * road.frame(y, None).tangent
    curve = walk(road, y, direction=along, tolerance=tolerance, length=length, most_steps=most_steps)
    poses = road.poses(curve.points)
    turned = turns(road, curve, lambda frame: float(frame.mark_rate[-1]))
    crank = np.unwrap(road.crank(poses)) + TURN * np.round((mechanism.start - road.crank(poses)[0]) / TURN)
    dead = road.crank(road.poses(turned)) if len(turned) else np.empty(0)
    dead = dead + TURN * np.round((crank.mean() - dead) / TURN)
    points = {name: poses[link].point(at) for name, (link, at) in mechanism.points.items() if link != GROUND}
    return AssemblyCurve(crank, poses, points, dead, curve)
