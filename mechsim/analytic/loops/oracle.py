"""Independent check of solved motions: the loop equations in maximal coordinates, six for each link.

No spanning tree is used for assembly from a guess, for rates, or for the distance from a singular pose.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.maximal_coordinates import Poses, equations, row_units, scaled
from mechsim.analytic.loops.record import joint_motions, tracked_points
from mechsim.analytic.path_instants import crank_angles, crank_rate
from mechsim.analytic.vector_method.rotations import dot, turned_by
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS, antiparallel_message
from mechsim.model.link_poses import guessed_poses
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism, described
from mechsim.model.motion import LinkMotion, Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import LinearEquations, NewtonSettings, newton
from mechsim.numerics.rank import least_norm, significant

# residual of rounding, in characteristic lengths and [rad]
ROUNDING = 4.0 * float(np.finfo(np.float64).eps)
# largest residual of closed loops, in characteristic lengths and [rad]
CLOSED = 1e-12
# largest rotation of a link in a Newton step, in [rad]: beyond it the linear model is invalid
MAX_ROTATION = 0.5


@dataclass(frozen=True)
class PoseSystem:
    """The loop equations in maximal coordinates, for `numerics.newton`.

    Attributes:
        mechanism: the mechanism.
        angle: crank angle, (n,) in [rad].
    """

    mechanism: Mechanism
    angle: Array

    def linearise(self, poses: Poses) -> LinearEquations:
        """Return the equations linearised about n sets of poses."""
        rows = equations(self.mechanism, poses, self.angle)
        matrix = scaled(self.mechanism, rows.jacobian)
        return LinearEquations(rows.residual * row_units(self.mechanism, rows.residual.shape[1]), matrix)

    def retract(self, poses: Poses, step: Array) -> Poses:
        """Return poses displaced by shifts in characteristic lengths and rotation vectors, (n, 6 links)."""
        moved = dict(poses)
        names = [link.name for link in self.mechanism.links]
        for name, twist in zip(names, step.reshape(len(step), -1, 6).swapaxes(0, 1), strict=True):
            pose = poses[name]
            position = pose.position + self.mechanism.characteristic_length * twist[:, :3]
            moved[name] = Pose(position, turned_by(pose.rotation, twist[:, 3:]))
        return moved


def assemble(
    mechanism: Mechanism,
    angles: ArrayLike,
    guess: Poses | None = None,
    *,
    most_steps: int = 50,
) -> Mapping[str, Pose]:
    """Close the loops at each crank angle by Newton's method from a guess.

    Args:
        mechanism: the mechanism.
        angles: crank angles, (n,) in [rad].
        guess: moving link -> one pose or n poses; the default is the mechanism's own guess.
        most_steps: limit on the number of Newton steps.

    Returns:
        Moving link -> n poses.

    Raises:
        AssemblyError: where the loops do not close; names the crank angle and the loop-closure error.

    Accuracy: residuals of a few ulp of the longest link away from a dead centre.
    """
    mechanism = described(mechanism)
    angles = crank_angles(mechanism.name, angles)
    guess_poses = guessed_poses(mechanism) if guess is None else guess
    poses = {
        link.name: Pose(
            np.broadcast_to(guess_poses[link.name].position, (len(angles), 3)),
            np.broadcast_to(guess_poses[link.name].rotation, (len(angles), 3, 3)),
        )
        for link in mechanism.links
    }
    settings = NewtonSettings(
        max_iterations=most_steps, tolerance=ROUNDING, rounding=CLOSED, max_step=MAX_ROTATION
    )
    result = newton(PoseSystem(mechanism, angles), poses, settings, least_norm)
    if not result.residual.max() <= CLOSED:
        index = int(np.argmax(result.residual))
        raise AssemblyError(
            f"{mechanism.name}: the loops do not close at crank angle {angles[index]:.6g} rad: after "
            f"{most_steps} Newton steps a gap of {result.residual[index]:.3g} of the longest link remains; "
            "change the dimensions, the crank angle or the guess"
        )
    _require_axes_aligned(mechanism, result.q, angles)
    return result.q


def _require_axes_aligned(mechanism: Mechanism, poses: Poses, angles: Array) -> None:
    """Raise AssemblyError for antiparallel axes or references: the equations only require parallel ones."""
    poses_of = {GROUND: IDENTITY, **poses}
    for joint in mechanism.joints:
        for i in KINDS[joint.kind].aligned_columns:
            sides = [poses_of[end.link].rotation @ end.frame[:, i] for end in (joint.a, joint.b)]
            antiparallel = np.broadcast_to(dot(*sides) < 0.0, angles.shape)
            if antiparallel.any():
                where = f"crank angle {angles[np.argmax(antiparallel)]:.6g} rad"
                raise AssemblyError(f"{mechanism.name}: at {where} {antiparallel_message(joint.name, i)}")


def singular_values(mechanism: Mechanism, poses: Poses) -> Array:
    """Return the singular values of the loop Jacobian in characteristic lengths, (n, k), decreasing.

    With the crank fixed, the smallest singular value of a determined coordinate is the distance from a
    singular pose (a dead centre of the crank).
    """
    rows = equations(mechanism, poses, 0.0)
    values = np.linalg.svd(scaled(mechanism, rows.jacobian), compute_uv=False)
    return values.astype(np.float64, copy=False)


def conditioning(mechanism: Mechanism, poses: Poses) -> Array:
    """Return the distance of each pose from a singular one with the crank fixed, (n,), 0 to about 1.

    It is the smallest singular value of the loop Jacobian in characteristic lengths, without those that are
    zero at every pose, of redundant equations and passive degrees of freedom.
    """
    values = singular_values(mechanism, poses)
    rank = int(significant(values).sum(1).max())
    return values[:, rank - 1]


def conditioning_of(mechanism: Mechanism, motion: Motion) -> Array:
    """Return the distance of each configuration of a motion from a singular one, (n,)."""
    if motion.conditioning is not None:
        return motion.conditioning
    poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
    return conditioning(mechanism, poses)


def rates(
    mechanism: Mechanism, poses: Poses, angle: ArrayLike, speed: ArrayLike, acceleration: ArrayLike = 0.0
) -> Motion:
    """Return the motion from the loop equations differentiated twice: exact velocities and accelerations.

    Args:
        mechanism: the mechanism.
        poses: moving link -> n poses that close the loops.
        angle: crank angle, (n,) in [rad].
        speed: crank speed, scalar or (n,) in [rad/s].
        acceleration: crank acceleration, scalar or (n,) in [rad/s2].

    Returns:
        The motion. Passive freedoms (the spin of an unguided coupler) get the least rates that agree.

    Accuracy: relative error about 1e-15 times the condition of the loop Jacobian.
    """
    names = [link.name for link in mechanism.links]
    angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
    n = len(angle)
    speed = crank_rate(mechanism.name, "speed", speed, n)
    acceleration = crank_rate(mechanism.name, "acceleration", acceleration, n)

    rows = equations(mechanism, poses, angle)
    rhs = np.zeros_like(rows.residual)
    rhs[:, -1] = speed
    twist = _twists(mechanism, rows.jacobian, rhs).reshape(n, -1, 6)
    twists = {name: twist[:, i] for i, name in enumerate(names)}

    rows = equations(mechanism, poses, angle, twists)
    rhs[:, -1] = acceleration
    accelerations = _twists(mechanism, rows.jacobian, rhs - rows.bias).reshape(n, -1, 6)

    links = {
        name: LinkMotion(
            poses[name].position,
            poses[name].rotation,
            twist[:, i, :3],
            twist[:, i, 3:],
            accelerations[:, i, :3],
            accelerations[:, i, 3:],
        )
        for i, name in enumerate(names)
    }
    return Motion(
        source="loop equations",
        angle=angle,
        speed=speed,
        acceleration=acceleration,
        points=tracked_points(mechanism, links),
        links=links,
        joints={
            name: motion for joint in mechanism.joints for name, motion in joint_motions(joint, links).items()
        },
    )


def _twists(mechanism: Mechanism, jacobian: Array, right: Array) -> Array:
    """Return the least-norm solution of J x = right, (n, 6 links), lengths in units of the size."""
    columns = np.tile([mechanism.characteristic_length] * 3 + [1.0] * 3, len(mechanism.links))
    return columns * least_norm(jacobian * columns, right)
