"""Correction of rounded dimensions, so that the loops close at all configurations.

Redundant loops, as in planar and spherical linkages or of a hinge with two bearings, close only if their
dimensions agree exactly. With the rounded numbers of a file they cannot close, or lock. The positions at
which they would close with exact dimensions are solved; points and axes then get the smallest change with
which the loops close in several poses at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.loops.constraints import TreeLoops, tree_loops
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.mobility import (
    DIMENSION_TOLERANCE,
    generic_poses,
    nearest_consistent,
)
from mechsim.analytic.loops.tree import TreeJoint
from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import End, Joint
from mechsim.model.link_poses import guessed_poses, initial_coordinates
from mechsim.model.links import vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import null_spaces, significant

# largest correction of a point relative to the characteristic length, and of an axis in [rad]
MAX_CORRECTION = 1e-4
# number of poses at which inconsistency is tested, and at which the corrected loops must close
PROBES, POSES = 2, 8
# residual that counts as rounding, and step of differences by dimensions
ROUNDING, STEP = 1e-13, 1e-6
# smallest relevant fraction of a combination of equations
MIN_SHARE = 1e-6
# fractions of the largest singular value below which others are zero, by iteration
CUTOFFS = (1e-4, 1e-4, 1e-5, 1e-5, 1e-6)


@dataclass(frozen=True, slots=True)
class Corrected:
    """A mechanism whose loops close exactly.

    Attributes:
        mechanism: the mechanism with corrected points and axes.
        moved: largest displacement of a joint point, in [m].
        rotated: largest rotation of a joint axis, in [rad].
    """

    mechanism: Mechanism
    moved: float = 0.0
    rotated: float = 0.0


def corrected(mechanism: Mechanism) -> Corrected:
    """Return a mechanism with consistent dimensions; unchanged if they are consistent already.

    Corrections above `MAX_CORRECTION` are not made.
    """
    loops, guess = tree_loops(mechanism, guessed_poses(mechanism), initial_coordinates(mechanism))
    if not loops.rows or not _inconsistent(
        loops, poses := generic_poses(loops, guess, PROBES, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)
    ):
        return Corrected(mechanism)
    poses += generic_poses(loops, poses[-1], POSES - PROBES, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)
    change = np.zeros((len(mechanism.joints), 2, 6))
    jacobians = _jacobians(mechanism, loops, poses, _affected_joints(loops, poses))
    for cutoff in CUTOFFS:
        dependent = [
            null_spaces(loops.linearise(q)[1][..., 0], DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)[0]
            for q in poses
        ]
        violations = [
            combination.T @ loops.linearise(q)[0][:, 0]
            for combination, q in zip(dependent, poses, strict=True)
        ]
        blocks = [np.tensordot(combination.T, jacobians[:, k], 1) for k, combination in enumerate(dependent)]
        matrix = np.concatenate(blocks).reshape(-1, change.size)
        correction = np.linalg.lstsq(matrix, -np.concatenate(violations), rcond=cutoff)[0]
        change = change + correction.reshape(change.shape)
        if not np.abs(change).max() < MAX_CORRECTION:
            break
        trial = with_moved_sides(mechanism, change)
        loops = _loops(trial)
        poses = [nearest_consistent(loops, q, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE) for q in poses]
        if not _inconsistent(loops, poses):
            return Corrected(trial, *_sizes(mechanism, change))
    return Corrected(mechanism)


def _inconsistent(loops: TreeLoops, poses: Sequence[Coordinates]) -> bool:
    """Whether rounding decides: equations are nearly redundant, or violated where others are satisfied."""
    for q in poses:
        residual, jacobian, _ = loops.linearise(q)
        values = np.linalg.svd(jacobian[..., 0], compute_uv=False)
        violation = float(np.abs(residual).max(initial=0.0))
        if (
            violation > ROUNDING
            or (significant(values) & ~significant(values, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE)).any()
        ):
            return True
    return False


def _affected_joints(loops: TreeLoops, poses: Sequence[Coordinates]) -> set[str]:
    """Return the joints of inconsistent loops, and of all loops that share a joint with them."""
    tree = loops.tree
    around = [
        {
            cut.joint.name,
            *(branch.joint.name for branch in tree.branches if {*_columns(branch)} & {*cut.columns.tolist()}),
        }
        for cut in loops.cuts
    ]
    loop_of = np.repeat(np.arange(len(loops.cuts)), [cut.rows for cut in loops.cuts])
    affected: set[str] = set()
    for q in poses:
        residual, jacobian, _ = loops.linearise(q)
        u, values, _ = np.linalg.svd(jacobian[..., 0])
        values = np.pad(values, (0, loops.rows - len(values)))
        violation = np.abs(u.T @ residual[:, 0])
        inconsistent = ~significant(values, DIMENSION_TOLERANCE, DIMENSION_TOLERANCE) & (
            significant(values) | (violation > ROUNDING)
        )
        share = np.abs(u[:, inconsistent]).max(1, initial=0.0)[: len(loop_of)] > MIN_SHARE
        for cut in np.unique(loop_of[share]):
            affected |= around[cut]
    while wider := [joints for joints in around if joints & affected and not joints <= affected]:
        affected.update(*wider)
    return affected


def _columns(branch: TreeJoint) -> range:
    return range(branch.first, branch.first + branch.kind.dof)


def _jacobians(
    mechanism: Mechanism, loops: TreeLoops, poses: Sequence[Coordinates], concerned: set[str]
) -> Array:
    """Return derivatives of residuals by shifts and rotations of joint sides, (rows, poses, joints, 2, 6)."""
    q = Coordinates(
        np.concatenate([pose.values for pose in poses], 1), np.concatenate([pose.turns for pose in poses], -1)
    )
    residual = loops.linearise(q)[0]
    jacobian = np.zeros((*residual.shape, len(mechanism.joints), 2, 6))
    for index in np.ndindex(jacobian.shape[2:]):
        joint = mechanism.joints[index[0]]
        if joint.name in concerned and _enters_equations(joint, index[2]):
            step = np.zeros(jacobian.shape[2:])
            step[index] = STEP
            perturbed = _loops(with_moved_sides(mechanism, step)).linearise(q)[0]
            jacobian[(slice(None), slice(None), *index)] = (perturbed - residual) / STEP
    return jacobian


def _loops(mechanism: Mechanism) -> TreeLoops:
    return tree_loops(mechanism, guessed_poses(mechanism), initial_coordinates(mechanism))[0]


def _enters_equations(joint: Joint, component: int) -> bool:
    """Whether a shift (0 to 2) or a rotation (3 to 5) of a joint's side changes its equations."""
    kind = KINDS[joint.kind]
    return not kind.floating and (component < 3 or not kind.ball)


def with_moved_sides(mechanism: Mechanism, change: Array) -> Mechanism:
    """Return a mechanism with joint sides shifted, in characteristic lengths, and rotated, in [rad]."""
    length = mechanism.characteristic_length
    joints = tuple(
        replace(joint, a=_moved(joint.a, sides[0], length), b=_moved(joint.b, sides[1], length))
        for joint, sides in zip(mechanism.joints, change, strict=True)
    )
    return replace(mechanism, joints=joints)


def _moved(end: End, change: Array, length: float) -> End:
    if not change.any():
        return end
    rotated = turned_by(end.frame[None], change[None, 3:])[0]
    point = np.array(end.point) + length * change[:3]
    return End(end.link, vector(point), vector(rotated[:, 2]), vector(rotated[:, 0]))


def _sizes(mechanism: Mechanism, change: Array) -> tuple[float, float]:
    shift = np.linalg.norm(change[..., :3], axis=-1).max() * mechanism.characteristic_length
    return float(shift), float(np.linalg.norm(change[..., 3:], axis=-1).max())
