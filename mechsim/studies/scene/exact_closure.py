"""Exact closure of a scene's loops by the loop equations, in the coordinates of MuJoCo's state.

A recorded state serves unchanged as initial guess.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from mechsim.analytic.loops.constraints import TreeLoops, cuts_of
from mechsim.analytic.loops.kinematics import Coordinates, link_poses
from mechsim.analytic.loops.mobility import driver_determinacy
from mechsim.analytic.loops.start import close_nearest
from mechsim.analytic.loops.tree import SpanningTree, TreeJoint
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import least_norm

# largest residual of assembled loops, in characteristic lengths
ASSEMBLED = 1e-10
# largest driver displacement between two solutions on the path to a start, in [rad] or characteristic lengths
DRIVER_STEP = 0.02


@dataclass(frozen=True)
class ExactClosure:
    """Loop equations whose unknowns are the coordinates of a model, with its drivers prescribed.

    If the drivers leave degrees of freedom undetermined, as in a gripper with swinging pads, the solution is
    the nearest assembled configuration.

    Attributes:
        loops: loop equations; coordinates in the order of the model's joints.
        addresses: address of each joint's coordinates in qpos.
    """

    loops: TreeLoops
    addresses: tuple[int, ...]

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism of the loops."""
        return self.loops.tree.mechanism

    @cached_property
    def drivers(self) -> tuple[str, ...]:
        """Joints whose coordinates are prescribed."""
        branches = self.loops.tree.branches
        joints = [branch.joint.name for branch in branches for _ in range(branch.kind.dof)]
        return tuple(joints[index] for index in self.loops.driven)

    @property
    def _joints(self) -> Iterator[tuple[TreeJoint, int, int]]:
        """Yield each joint, its address in qpos, and the number of ball joints before it."""
        balls = 0
        for branch, address in zip(self.loops.tree.branches, self.addresses, strict=True):
            yield branch, address, balls
            balls += branch.kind.ball

    def coordinates_of(self, qpos: Array) -> Coordinates:
        """Return states of the model (n, nq) as coordinates of the equations."""
        from scipy.spatial.transform import Rotation

        tree = self.loops.tree
        values, rotations = np.zeros((tree.count, len(qpos))), np.empty((len(tree.balls), 3, 3, len(qpos)))
        for branch, address, ball in self._joints:
            slides = len(branch.kind.slides)
            if not branch.kind.ball:
                values[branch.first] = qpos[:, address]
                continue
            values[branch.first : branch.first + slides] = qpos[:, address : address + slides].T
            w, *xyz = qpos[:, address + slides : address + slides + 4].T
            matrices = Rotation.from_quat(np.array([*xyz, w]).T).as_matrix()
            rotations[ball] = np.moveaxis(matrices, 0, -1)
        return Coordinates(values, rotations)

    def states_of(self, q: Coordinates, like: Array) -> Array:
        """Return coordinates as states of the model, (n, nq), with all other coordinates of `like`, (nq,)."""
        out = np.repeat(like[None], len(q), 0)
        for branch, address, ball in self._joints:
            slides = len(branch.kind.slides)
            if not branch.kind.ball:
                out[:, address] = q.values[branch.first]
                continue
            out[:, address : address + slides] = q.values[branch.first : branch.first + slides].T
            for row, matrix in zip(out, np.moveaxis(q.turns[ball], -1, 0), strict=True):
                quaternion = row[address + slides : address + slides + 4]
                mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(matrix).ravel())
        return out

    def closed(self, q: Coordinates) -> tuple[Coordinates, Array]:
        """Return the nearest assembled coordinates at the same drivers, and the largest residuals, (n,).

        Residuals are in characteristic lengths; they are large if no assembled configuration is near.
        """
        if not len(self.loops.unknown):
            return q, np.abs(self.loops.linearise(q)[0]).max(0, initial=0.0)
        return close_nearest(self.loops, q)

    def points(self, q: Coordinates) -> Array:
        """Return the positions of the mechanism's points, (n, k, 3) in [m]."""
        tree, poses = self.loops.tree, link_poses(self.loops.tree, q)
        points: list[Array] = []
        for link, local in self.mechanism.points.values():
            if link == GROUND:
                points.append(np.repeat(np.array(local)[:, None], len(q), 1))
            else:
                i = tree.links[link]
                points.append(poses.position[i] + np.tensordot(poses.rotation[i], local, ((1,), (0,))))
        return np.moveaxis(np.array(points), -1, 0) if points else np.empty((len(q), 0, 3))

    def errors(self, qpos: Array, points: Array) -> Array:
        """Return the distances of tracked points from the closure at the run's own drivers, (n, k) in [m].

        Args:
            qpos: states of a run, (n, nq).
            points: positions of the points at these states, (n, k, 3) in [m].

        Returns:
            The distances; infinity if no assembled configuration is near.
        """
        if not self.loops.rows:
            return np.zeros(points.shape[:2])
        with np.errstate(all="ignore"):
            closed, violation = self.closed(self.coordinates_of(qpos))
            distance = np.linalg.norm(points - self.points(closed), axis=2)
        return np.where((violation <= ASSEMBLED)[:, None] & np.isfinite(distance), distance, np.inf)

    def moved_to(self, qpos: Array, target: Mapping[str, float]) -> Array:
        """Return the assembled state, (nq,), at driver values, reached along a straight path of the drivers.

        Raises:
            AssemblyError: if the loops do not close on the path.
        """
        q = self.coordinates_of(qpos[None])
        indices = [self.loops.tree.index_of[name] for name in target]
        start, displacement = q.values[indices, 0], np.array([*target.values()]) - q.values[indices, 0]
        distance = np.abs(displacement / self.loops.units[indices]).max(initial=0.0)
        count = max(1, int(np.ceil(distance / DRIVER_STEP)))
        for i in range(1, count + 1):
            q.values[indices, 0] = start + displacement * i / count
            q, violation = self.closed(q)
            if not violation[0] <= ASSEMBLED:
                values = zip(target, q.values[indices, 0], strict=True)
                text = ", ".join(f"{name} = {value:.6g}" for name, value in values)
                raise AssemblyError(
                    f"{self.mechanism.name}: the loops do not close at {text}, on the path to the start of "
                    "the motion laws; change the motion laws, or start from another keyframe (--key)"
                )
        return self.states_of(q, qpos)[0]

    def rates(self, qpos: Array, speeds: Mapping[str, float], dofs: Sequence[int], nv: int) -> Array:
        """Return the velocities of all degrees of freedom, (nv,), that keep the loops closed.

        Args:
            qpos: assembled state, (nq,).
            speeds: speeds of the drivers, in [m/s] and [rad/s].
            dofs: index of each joint's first degree of freedom.
            nv: number of degrees of freedom of the model.
        """
        loops, tree = self.loops, self.loops.tree
        q = self.coordinates_of(qpos[None])
        jacobian = loops.linearise(q)[1][..., 0]
        rate = np.zeros(tree.count)
        for name, speed in speeds.items():
            rate[tree.index_of[name]] = speed / loops.units[tree.index_of[name]]
        rate[loops.unknown] = -least_norm(jacobian[:, loops.unknown], jacobian @ rate)
        rate, out = rate * loops.units, np.zeros(nv)
        for (branch, _, ball), dof in zip(self._joints, dofs, strict=True):
            count = branch.kind.dof
            out[dof : dof + count] = rate[branch.first : branch.first + count]
            if branch.kind.ball:
                # MuJoCo expresses the angular velocity of a ball joint in the frame of the body
                to_body = branch.joint.b.frame @ q.turns[ball][..., 0].T
                first = branch.first_angle
                out[dof + count - 3 : dof + count] = to_body @ rate[first : first + 3]
        return out


def exact_closure(
    mechanism: Mechanism, model: mujoco.MjModel, points: Mapping[str, tuple[str, Vector]]
) -> ExactClosure:
    """Return the exact closure of a mechanism read from a model.

    Redundant drivers, as of two coupled fingers, are unknowns.

    Args:
        mechanism: mechanism whose first joints are the model's, in order.
        model: the model.
        points: tracked points, in place of the mechanism's.
    """
    try:
        redundant = driver_determinacy(mechanism).redundant_drivers
    except AssemblyError:
        redundant = ()
    names = [name for name in (*mechanism.drivers, *mechanism.locked) if name not in redundant]
    tree = _tree(replace(mechanism, points=dict(points)), model.njnt)
    driven = tuple(tree.index_of[name] for name in names)
    loops = TreeLoops(tree, cuts_of(tree), (0.0,) * len(mechanism.laws), driven)
    return ExactClosure(loops, tuple(int(address) for address in model.jnt_qposadr))


def _tree(mechanism: Mechanism, joints: int) -> SpanningTree:
    """Return the tree of a mechanism whose first `joints` joints are tree joints."""
    index = {link.name: i for i, link in enumerate(mechanism.links)} | {GROUND: -1}
    branches: list[TreeJoint] = []
    count = 0
    for joint in mechanism.joints[:joints]:
        branches.append(TreeJoint(joint, True, index[joint.a.link], index[joint.b.link], count))
        count += KINDS[joint.kind].dof
    return SpanningTree(mechanism, mechanism, tuple(branches), mechanism.joints[joints:])
