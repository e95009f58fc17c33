"""Dimensions known to a few digits, moved as little as lets the loops close wherever they mean to.

Loops with more equations than independent ones, as of flat and spherical linkages or of a hinge held at two
points, close in all poses only if their dimensions agree exactly. Rounded to the digits of a file they close
in none, or lock. What is read here is where they would close but for their digits; points and axes are then
moved by the least that makes them close there, in several poses at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.closure.generic_pose import generic_poses, idle_and_free, settled
from mechsim.analytic.closure.telling import telling
from mechsim.analytic.closure.tree_joints import TreeJoint
from mechsim.analytic.closure.tree_loops import TreeLoops, tree_loops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import End, Joint
from mechsim.model.links import Vector
from mechsim.model.mechanism import Mechanism
from mechsim.model.rough_poses import rough_poses, starts

# dimensions are taken to be known to this part of the size, and axes to as many radians: files with six
# digits are off by 1e-6, and no linkage that was meant to be rigid moves for so little. Rows below it at all,
# of a ball at the point through which all axes of its loop pass, are such digits and nothing else
DIGITS = 1e-5
# no point is moved and no axis turned by more, in parts of the size and in [rad]
FARTHEST = 1e-4
# poses in which it is seen whether digits disagree, and in which the loops are to close
PROBES, POSES = 2, 8
# a residual that is rounding, and the step of differences by dimensions
ROUNDING, STEP = 1e-13, 1e-6
# part of a sum of rows that counts
SHARE = 1e-6
# round by round, what tells less of the dimensions than this part of the most is left to the next
TOLD = (1e-4, 1e-4, 1e-5, 1e-5, 1e-6)


@dataclass(frozen=True, slots=True)
class Corrected:
    """A mechanism whose loops close exactly.

    Attributes:
        mechanism: with its points and axes where they let the loops close.
        moved: the farthest that a point of a joint was moved, in [m].
        turned: the most that an axis was turned, in [rad].
    """

    mechanism: Mechanism
    moved: float = 0.0
    turned: float = 0.0


def corrected(mechanism: Mechanism) -> Corrected:
    """Return a mechanism with the digits of its dimensions made to agree; as it is where they do.

    What would have to be moved by more than `FARTHEST` is left as it is.
    """
    loops, rough = tree_loops(mechanism, rough_poses(mechanism), starts(mechanism))
    if not loops.rows or not _disagree(loops, poses := generic_poses(loops, rough, PROBES, DIGITS, DIGITS)):
        return Corrected(mechanism)
    poses += generic_poses(loops, poses[-1], POSES - PROBES, DIGITS, DIGITS)
    change = np.zeros((len(mechanism.joints), 2, 6))
    slopes = _slopes(mechanism, loops, poses, _concerned(loops, poses))
    for told in TOLD:
        idle = [idle_and_free(loops, at, DIGITS, DIGITS)[0] for at in poses]
        opened = [part.T @ loops.linearise(at)[0][:, 0] for part, at in zip(idle, poses, strict=True)]
        slope = [np.tensordot(part.T, slopes[:, k], 1) for k, part in enumerate(idle)]
        matrix = np.concatenate(slope).reshape(-1, change.size)
        least = np.linalg.lstsq(matrix, -np.concatenate(opened), rcond=told)[0]
        change = change + least.reshape(change.shape)
        if not np.abs(change).max() < FARTHEST:
            break
        trial = _changed(mechanism, change)
        loops = _loops(trial)
        poses = [settled(loops, at, DIGITS, DIGITS) for at in poses]
        if not _disagree(loops, poses):
            return Corrected(trial, *_sizes(mechanism, change))
    return Corrected(mechanism)


def _disagree(loops: TreeLoops, poses: Sequence[Coordinates]) -> bool:
    """Whether digits tell: rows that nearly repeat others, or stand open where these are closed."""
    for at in poses:
        residual, slope, _ = loops.linearise(at)
        values = np.linalg.svd(slope[..., 0], compute_uv=False)
        opened = float(np.abs(residual).max(initial=0.0))
        if opened > ROUNDING or (telling(values) & ~telling(values, DIGITS, DIGITS)).any():
            return True
    return False


def _concerned(loops: TreeLoops, poses: Sequence[Coordinates]) -> set[str]:
    """Return the joints of the loops whose digits disagree, and of all loops that share one with them."""
    tree = loops.tree
    around = [
        {
            cut.joint.name,
            *(branch.joint.name for branch in tree.branches if {*_columns(branch)} & {*cut.columns.tolist()}),
        }
        for cut in loops.cuts
    ]
    of = np.repeat(np.arange(len(loops.cuts)), [cut.rows for cut in loops.cuts])
    found: set[str] = set()
    for at in poses:
        residual, slope, _ = loops.linearise(at)
        left, values, _ = np.linalg.svd(slope[..., 0])
        values = np.pad(values, (0, loops.rows - len(values)))
        open_by = np.abs(left.T @ residual[:, 0])
        off = ~telling(values, DIGITS, DIGITS) & (telling(values) | (open_by > ROUNDING))
        share = np.abs(left[:, off]).max(1, initial=0.0)[: len(of)] > SHARE
        for cut in np.unique(of[share]):
            found |= around[cut]
    while more := [one for one in around if one & found and not one <= found]:
        found.update(*more)
    return found


def _columns(branch: TreeJoint) -> range:
    return range(branch.first, branch.first + branch.kind.freedoms)


def _slopes(
    mechanism: Mechanism, loops: TreeLoops, poses: Sequence[Coordinates], concerned: set[str]
) -> Array:
    """Return slopes of residuals by shifts and turns of the sides of joints, (rows, poses, joints, 2, 6)."""
    at = Coordinates(
        np.concatenate([one.values for one in poses], 1), np.concatenate([one.turns for one in poses], -1)
    )
    here = loops.linearise(at)[0]
    slope = np.zeros((*here.shape, len(mechanism.joints), 2, 6))
    for place in np.ndindex(slope.shape[2:]):
        joint = mechanism.joints[place[0]]
        if joint.name in concerned and _counts(joint, place[2]):
            step = np.zeros(slope.shape[2:])
            step[place] = STEP
            there = _loops(_changed(mechanism, step)).linearise(at)[0]
            slope[(slice(None), slice(None), *place)] = (there - here) / STEP
    return slope


def _loops(mechanism: Mechanism) -> TreeLoops:
    return tree_loops(mechanism, rough_poses(mechanism), starts(mechanism))[0]


def _counts(joint: Joint, part: int) -> bool:
    """Whether a shift (0 to 2) or a turn (3 to 5) of a joint's side changes its equations."""
    kind = KINDS[joint.kind]
    return not kind.floats and (part < 3 or not kind.ball)


def _changed(mechanism: Mechanism, change: Array) -> Mechanism:
    """Return a mechanism whose joint sides are shifted, in parts of the size, and turned, in [rad]."""
    size = mechanism.size
    joints = tuple(
        replace(joint, a=_moved(joint.a, of[0], size), b=_moved(joint.b, of[1], size))
        for joint, of in zip(mechanism.joints, change, strict=True)
    )
    return replace(mechanism, joints=joints)


def _moved(end: End, change: Array, size: float) -> End:
    if not change.any():
        return end
    turned = turned_by(end.frame[None], change[None, 3:])[0]
    point = np.array(end.point) + size * change[:3]
    return End(end.link, _vector(point), _vector(turned[:, 2]), _vector(turned[:, 0]))


def _vector(values: Array) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])


def _sizes(mechanism: Mechanism, change: Array) -> tuple[float, float]:
    moved = np.linalg.norm(change[..., :3], axis=-1).max() * mechanism.size
    return float(moved), float(np.linalg.norm(change[..., 3:], axis=-1).max())
