"""The exact closure of a user's scene, by our own loop equations in the coordinates of the file's own tree.

Its coordinates are those of MuJoCo's state, so that a recorded state is a guess as it stands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.constraints import TreeLoops, cuts_of
from mechsim.analytic.loops.kinematics import Coordinates, link_poses
from mechsim.analytic.loops.mobility import driver_determinacy
from mechsim.analytic.loops.tree import SpanningTree, TreeJoint
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import least_norm

# Newton steps taken at the most, the longest of one in [rad] or sizes, and a gap that is rounding
MOST_STEPS, LONGEST, ROUNDING = 30, 0.3, 1e-14
# a gap beyond which loops count as open, in parts of the size
CLOSED = 1e-10
# farthest that drivers go at once on their way to a start, in [rad] or sizes
STRIDE = 0.02


@dataclass(frozen=True)
class ExactClosure:
    """Loop equations whose unknowns are the coordinates of a model, those of its drivers given.

    Where drivers leave freedoms open, as in a gripper whose pads swing, the closed pose is the nearest one.

    Attributes:
        loops: the equations; coordinates in the order of the model's joints.
        places: of each joint's coordinates in qpos.
    """

    loops: TreeLoops
    places: tuple[int, ...]

    @property
    def mechanism(self) -> Mechanism:
        """Whose loops they are."""
        return self.loops.tree.mechanism

    @cached_property
    def drivers(self) -> tuple[str, ...]:
        """The coordinates at which poses are closed."""
        return tuple(self.loops.tree.branches[self._of(i)].joint.name for i in self.loops.driven)

    def _of(self, coordinate: int) -> int:
        branches = self.loops.tree.branches
        return next(i for i, one in enumerate(branches) if one.first <= coordinate < one.first + one.kind.dof)

    def coordinates(self, qpos: Array) -> Coordinates:
        """Return states of the model (n, nq) as coordinates of the equations."""
        tree = self.loops.tree
        values, turns = np.zeros((tree.count, len(qpos))), np.empty((len(tree.balls), 3, 3, len(qpos)))
        ball = 0
        for branch, place in zip(tree.branches, self.places, strict=True):
            slides = len(branch.kind.slides)
            if not branch.kind.ball:
                values[branch.first] = qpos[:, place]
                continue
            values[branch.first : branch.first + slides] = qpos[:, place : place + slides].T
            turns[ball] = _rotations(qpos[:, place + slides : place + slides + 4])
            ball += 1
        return Coordinates(values, turns)

    def states(self, at: Coordinates, like: Array) -> Array:
        """Return coordinates as states of the model, (n, nq); `like` (nq,) gives what no joint is."""
        tree, out = self.loops.tree, np.repeat(like[None], len(at), 0)
        ball = 0
        for branch, place in zip(tree.branches, self.places, strict=True):
            slides = len(branch.kind.slides)
            if not branch.kind.ball:
                out[:, place] = at.values[branch.first]
                continue
            out[:, place : place + slides] = at.values[branch.first : branch.first + slides].T
            for row, turn in zip(out, np.moveaxis(at.turns[ball], -1, 0), strict=True):
                place_of = slice(place + slides, place + slides + 4)
                mujoco.mju_mat2Quat(row[place_of], np.ascontiguousarray(turn).ravel())
            ball += 1
        return out

    def closed(self, at: Coordinates) -> tuple[Coordinates, Array]:
        """Return the nearest closed coordinates with the drivers where they are, and the gaps left, (n,).

        Gaps are in parts of the mechanism's size; those of states too far off to be closed are large.
        """
        loops, best = self.loops, np.full(len(at), np.inf)
        for _ in range(MOST_STEPS):
            residual, slope, _ = loops.linearise(at)
            gap = np.abs(residual).max(0, initial=0.0)
            going = np.isfinite(gap) & (gap > ROUNDING) & (gap < 0.5 * best)
            best = np.minimum(best, np.where(np.isfinite(gap), gap, np.inf))
            if not going.any() or not len(loops.unknown):
                return at, gap
            matrix = np.moveaxis(slope[:, loops.unknown], -1, 0)
            matrix = np.where(going[:, None, None], matrix, 0.0)
            right = np.where(going, residual, 0.0).T
            step = np.zeros((loops.tree.count, len(at)))
            step[loops.unknown] = -least_norm(matrix, right).T
            step *= LONGEST / np.maximum(LONGEST, np.abs(step).max(0))
            at = loops.displaced(at, step)
        return at, np.abs(loops.linearise(at)[0]).max(0, initial=0.0)

    def points(self, at: Coordinates) -> Array:
        """Return where coordinates put the mechanism's points, (n, k, 3) in [m]."""
        tree, here = self.loops.tree, link_poses(self.loops.tree, at)
        found: list[Array] = []
        for link, local in self.mechanism.points.values():
            if link == GROUND:
                found.append(np.repeat(np.array(local)[:, None], len(at), 1))
            else:
                i = tree.links[link]
                found.append(here.position[i] + np.tensordot(here.rotation[i], local, ((1,), (0,))))
        return np.moveaxis(np.array(found), -1, 0) if found else np.empty((len(at), 0, 3))

    def errors(self, qpos: Array, points: Array) -> Array:
        """Return the distances of tracked points from the closure at the run's own drivers, (n, k) in [m].

        Args:
            qpos: states of a run, (n, nq).
            points: where the points were at these states, (n, k, 3) in [m].

        Returns:
            Infinite where no closed pose is near.
        """
        if not self.loops.rows:
            return np.zeros(points.shape[:2])
        with np.errstate(all="ignore"):
            closed, gap = self.closed(self.coordinates(qpos))
            away = np.linalg.norm(points - self.points(closed), axis=2)
        return np.where((gap <= CLOSED)[:, None] & np.isfinite(away), away, np.inf)

    def brought(self, qpos: Array, there: Mapping[str, float]) -> Array:
        """Return the closed state, (nq,), in which drivers stand where wanted, gone there straight from qpos.

        Raises:
            AssemblyError: where the loops do not close on the way.
        """
        at = self.coordinates(qpos[None])
        places = [self.loops.tree.index_of[name] for name in there]
        here, wanted = at.values[places, 0], np.array([*there.values()])
        far = np.abs((wanted - here) / self.loops.units[places]).max(initial=0.0)
        count = max(1, int(np.ceil(far / STRIDE)))
        for i in range(1, count + 1):
            at.values[places, 0] = here + (wanted - here) * i / count
            at, gap = self.closed(at)
            if not gap[0] <= CLOSED:
                stands = ", ".join(
                    f"{name} = {value:.6g}" for name, value in zip(there, at.values[places, 0], strict=True)
                )
                raise AssemblyError(
                    f"{self.mechanism.name}: the loops do not close at {stands}, on the way to where the "
                    "programs begin; change the programs, or start from another keyframe (--key)"
                )
        return self.states(at, qpos)[0]

    def rates(self, qpos: Array, speeds: Mapping[str, float], dofs: Sequence[int], nv: int) -> Array:
        """Return the rates of all freedoms, (nv,), that keep the loops closed as the drivers move so fast.

        Args:
            qpos: closed, (nq,).
            speeds: of the drivers, in [m/s] and [rad/s].
            dofs: index of each joint's first freedom.
            nv: freedoms of the model.
        """
        loops, tree = self.loops, self.loops.tree
        at = self.coordinates(qpos[None])
        _, slope, _ = loops.linearise(at)
        rate = np.zeros(tree.count)
        for name, speed in speeds.items():
            rate[tree.index_of[name]] = speed / loops.units[tree.index_of[name]]
        matrix = slope[:, loops.unknown, 0]
        rate[loops.unknown] = -least_norm(matrix, slope[..., 0] @ rate)
        rate, out, ball = rate * loops.units, np.zeros(nv), 0
        for branch, dof in zip(tree.branches, dofs, strict=True):
            count = branch.kind.dof
            out[dof : dof + count] = rate[branch.first : branch.first + count]
            if branch.kind.ball:
                # of a ball MuJoCo counts the turning in the body's own frame
                turned = branch.joint.b.frame @ at.turns[ball][..., 0].T
                out[dof + count - 3 : dof + count] = (
                    turned @ rate[branch.first_angle : branch.first_angle + 3]
                )
                ball += 1
        return out


def exact_closure(
    mechanism: Mechanism, model: mujoco.MjModel, points: Mapping[str, tuple[str, Vector]]
) -> ExactClosure:
    """Return the exact closure of a mechanism read from a model.

    Drivers that others settle already, as of two fingers that a coupling ties, are left to the loops.

    Args:
        mechanism: its first joints are the model's, in order.
        model: the model.
        points: to track, in place of the mechanism's.
    """
    try:
        superfluous = driver_determinacy(mechanism).redundant_drivers
    except AssemblyError:
        superfluous = ()
    names = [name for name in (*mechanism.drivers, *mechanism.locked) if name not in superfluous]
    tree = _tree(replace(mechanism, points=dict(points)), model.njnt)
    driven = tuple(tree.index_of[name] for name in names)
    loops = TreeLoops(tree, cuts_of(tree), (0.0,) * len(mechanism.laws), driven)
    return ExactClosure(loops, tuple(int(place) for place in model.jnt_qposadr))


def _tree(mechanism: Mechanism, joints: int) -> SpanningTree:
    """Return the tree of a mechanism whose first so many joints place its links."""
    index = {link.name: i for i, link in enumerate(mechanism.links)} | {GROUND: -1}
    branches: list[TreeJoint] = []
    count = 0
    for joint in mechanism.joints[:joints]:
        branches.append(TreeJoint(joint, True, index[joint.a.link], index[joint.b.link], count))
        count += KINDS[joint.kind].dof
    return SpanningTree(mechanism, mechanism, tuple(branches), mechanism.joints[joints:])


def _rotations(quaternions: Array) -> NDArray[np.float64]:
    """Return the rotation matrices of quaternions (n, 4), (3, 3, n)."""
    w, x, y, z = (quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)).T
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )
