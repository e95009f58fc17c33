"""Correction of rounded dimensions, so that the loops close at all configurations.

Redundant loops, as in planar and spherical linkages or of a hinge with two bearings, close only if their
dimensions agree exactly. With the rounded numbers of a file they cannot close, or lock. The positions at
which they would close with exact dimensions are solved; points and axes then get the smallest change with
which the loops close in several poses at once. Rounded angles between axes, such as 1.57 or 1.5708 for pi/2,
are made exact if joints are locked as written; other digits that are cut off (1e-6) are corrected always.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from mechsim.kinematics.loops.constraints import TreeLoops, tree_loops, with_sides
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinematics.loops.mobility import (
    CLOSED,
    DIMENSION_TOLERANCE,
    SPACING,
    generic_poses,
    nearest_consistent,
)
from mechsim.kinematics.vector_method.rotations import turned_by
from mechsim.mechanism.finding import HARMLESS, Finding
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End
from mechsim.mechanism.links import VIRTUAL_PREFIX, Vector, vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import FLOOR, RANK_TOLERANCE, null_space, pivot_columns, significant

# largest correction of a point relative to the characteristic length, and of an axis in [rad]
MAX_CORRECTION = 1e-4
# largest error of an angle of two decimals, in [rad]; the corrected angles between axes are multiples of the
# second. Loops with such errors have singular values below the third; the factor is for links with two
# rounded angles
MAX_ANGLE, USUAL_ANGLE = 0.005, float(np.deg2rad(15.0))
ANGLE_TOLERANCE = 2.0 * MAX_ANGLE
# normal part of an equation's gradient, relative to those of its loop, above which it is independent: ten
# times that of equations with rounded angles
INDEPENDENT = 0.1
# error of an angle that is rounding of its evaluation, in [rad]
EXACT = 1e-9
# sweeps over the pairs of axes of a link: each changes the angles corrected before by their product, 1e-6
SWEEPS = 4
# displacements in [rad] or characteristic lengths: at which a gap is stated, the smaller ones if a loop does
# not reach the larger; of a moving joint; and largest fraction of it that is the play of a locked joint
STATED_AT, MOVING, PLAY = (0.5, 0.25, 0.1), 0.02, 0.1
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
        changes: name of a joint, its side a or b, and the shift in [m] and rotation in [rad], in the frame of
            the side's link, that make rounded angles exact.
        finding: the rounded angle that locks the loops as written, and their gap; None for none.
        consistent: whether the dimensions are consistent as written.
    """

    mechanism: Mechanism
    moved: float = 0.0
    rotated: float = 0.0
    changes: tuple[tuple[str, str, Vector, Vector], ...] = ()
    finding: Finding | None = None
    consistent: bool = False

    @property
    def facts(self) -> list[str]:
        """Sentences on the corrections."""
        facts = [] if self.finding is None else [self.finding.one_line]
        if self.moved or self.rotated:
            facts.append(
                f"joints were moved by up to {self.moved:.2g} m and rotated by up to {self.rotated:.2g} rad: "
                "with the rounded numbers of the file the loops cannot close"
            )
        return facts


def corrected(mechanism: Mechanism, most: float = MAX_CORRECTION) -> Corrected:
    """Return a mechanism with consistent dimensions; unchanged if they are consistent already.

    If joints are locked for angles between axes that are less than `MAX_ANGLE` off a usual one, these angles
    are corrected, too.

    Args:
        mechanism: the mechanism.
        most: largest correction of a point, relative to the characteristic length; axes are corrected by
            `MAX_CORRECTION`.
    """
    loops, guess = _loops_and_guess(mechanism)
    if not loops.rows:
        return Corrected(mechanism, consistent=True)
    poses = generic_poses(loops, guess, PROBES, RANK_TOLERANCE)
    # loops that lock return to the pose in which they can be assembled
    moved = np.abs(poses[-1].values - poses[0].values)[:, 0] / loops.units
    if moved.max(initial=0.0) > MOVING and all(_is_exact(loops, q) for q in poses):
        return Corrected(mechanism, consistent=True)
    nearly = generic_poses(loops, guess, PROBES, ANGLE_TOLERANCE, ANGLE_TOLERANCE)
    if not _inconsistent(loops, _joined(nearly), ANGLE_TOLERANCE):
        return Corrected(mechanism, consistent=True)
    change, cause, error = _rotations_to_usual_angles(mechanism)
    if not (cause and _is_locked(mechanism)):
        return _with_consistent_dimensions(mechanism, most)
    exact, closing = with_moved_sides(mechanism, change), {cut.joint.name for cut in loops.cuts}
    # points of closing joints can move in MuJoCo's model, too
    offsets = _offsets(exact, MAX_ANGLE, ANGLE_TOLERANCE, closing)
    if offsets is None:
        offsets = _offsets(exact, MAX_ANGLE, ANGLE_TOLERANCE)
    if offsets is None:
        offsets = np.zeros_like(change)
    moving, exactly = with_moved_sides(exact, offsets), change + offsets
    if _is_locked(moving):
        return _with_consistent_dimensions(mechanism, most)
    changes = tuple(
        (joint.name, "ab"[side], vector(exactly[i, side, :3] * mechanism.characteristic_length), rotation)
        for i, joint in enumerate(mechanism.joints)
        for side, rotation in enumerate(map(vector, change[i, :, 3:]))
        if exactly[i, side].any()
    )
    finding = Finding(
        kind="redundant",
        object="loops",
        value=1.0,
        message=f"as written the loops lock, for {cause}{_least_gap(mechanism)}; mechsim moves them with the "
        "exact angle",
        # MuJoCo's soft constraints move loops with smaller errors
        remedy="write angles with 8 digits, such as 1.5707963 for pi/2"
        if error > DIMENSION_TOLERANCE
        else HARMLESS,
    )
    return Corrected(moving, changes=changes, finding=finding)


def _with_consistent_dimensions(mechanism: Mechanism, most: float) -> Corrected:
    """Return a mechanism whose sides are moved as far as its loops need, with its angles as they are."""
    change = _offsets(mechanism, most, DIMENSION_TOLERANCE)
    if change is None:
        return Corrected(mechanism)
    shift = np.linalg.norm(change[..., :3], axis=-1).max() * mechanism.characteristic_length
    rotation = np.linalg.norm(change[..., 3:], axis=-1).max()
    return Corrected(with_moved_sides(mechanism, change), float(shift), float(rotation))


def _offsets(
    mechanism: Mechanism, most: float, tolerance: float, joints: set[str] | None = None
) -> Array | None:
    """Return changes of joint sides with which the loops close at several poses, as `with_moved_sides`.

    None stands for no such changes, or consistent loops.

    Args:
        mechanism: the mechanism.
        most: largest correction of a point, relative to the characteristic length.
        tolerance: fraction of the largest singular value below which another is rounding.
        joints: the joints whose sides may change; None for all of inconsistent loops.
    """
    loops, guess = _loops_and_guess(mechanism)
    if not loops.rows:
        return None
    poses = generic_poses(loops, guess, PROBES, tolerance, tolerance)
    if not _inconsistent(loops, _joined(poses), tolerance):
        return None
    poses += generic_poses(loops, poses[-1], POSES - PROBES, tolerance, tolerance)
    limits, change = np.repeat([most, MAX_CORRECTION], 3), np.zeros((len(mechanism.joints), 2, 6))
    concerned = _affected_joints(loops, poses, tolerance) if joints is None else joints
    q = _joined(poses)
    jacobians = _jacobians(mechanism, loops, q, concerned) * limits
    for cutoff in CUTOFFS:
        residual, jacobian, _ = loops.linearise(q)
        dependent = [null_space(jacobian[..., k].T, tolerance, tolerance).T for k in range(len(q))]
        violations = [combination.T @ residual[:, k] for k, combination in enumerate(dependent)]
        blocks = [np.tensordot(combination.T, jacobians[:, k], 1) for k, combination in enumerate(dependent)]
        matrix = np.concatenate(blocks).reshape(-1, change.size)
        correction = np.linalg.lstsq(matrix, -np.concatenate(violations), rcond=cutoff)[0]
        change = change + correction.reshape(change.shape) * limits
        if not (np.abs(change) < limits).all():
            return None
        loops = _loops_and_guess(with_moved_sides(mechanism, change))[0]
        q = nearest_consistent(loops, q, tolerance, tolerance)
        if not _inconsistent(loops, q, tolerance):
            return change
    return None


def _is_locked(mechanism: Mechanism) -> bool:
    """Whether a joint moves by no more than a play, although the loops nearly close where it moves."""
    loops, guess = _loops_and_guess(mechanism)
    if not loops.rows:
        return False
    nearly = generic_poses(loops, guess, PROBES, ANGLE_TOLERANCE, ANGLE_TOLERANCE)
    exactly = [
        q
        for q in generic_poses(loops, guess, PROBES, RANK_TOLERANCE)
        if np.abs(loops.linearise(q)[0]).max() < CLOSED
    ]
    free = _participation(loops, nearly[-1:], ANGLE_TOLERANCE, ANGLE_TOLERANCE)
    possible = _participation(loops, exactly[-1:], RANK_TOLERANCE, FLOOR)
    displaced = [np.abs(q.values - guess.values)[:, 0] / loops.units for q in exactly]
    locked = (possible < PLAY * free) | (
        np.max([np.zeros(loops.count), *displaced], 0) < PLAY * SPACING * free
    )
    return bool((locked & (free > MOVING)).any())


def _participation(loops: TreeLoops, poses: Sequence[Coordinates], tolerance: float, floor: float) -> Array:
    """Return how much each coordinate moves in the degrees of freedom of a pose, (count,); 0 without one."""
    bases = [null_space(loops.linearise(q)[1][..., 0], tolerance, floor) for q in poses]
    return np.linalg.norm(np.concatenate([np.zeros((1, loops.count)), *bases]), axis=0)


def _rotations_to_usual_angles(mechanism: Mechanism) -> tuple[Array, str, float]:
    """Return the changes of sides that make rounded angles between axes exact, and the largest error.

    The error is a clause, empty for none, and its value in [rad].

    The second axis of each pair is rotated; that of a side a, whose link is the parent, if there is one.
    """
    loops, guess = _loops_and_guess(mechanism)
    poses = generic_poses(loops, guess, PROBES, ANGLE_TOLERANCE, ANGLE_TOLERANCE)
    affected, tree_joints = _affected_joints(loops, poses, ANGLE_TOLERANCE), len(mechanism.links)
    sides = [
        (i, side, end)
        for i, joint in enumerate(mechanism.joints)
        for side, end in enumerate((joint.a, joint.b))
        if joint.name in affected and not end.link.startswith(VIRTUAL_PREFIX)
        if KINDS[joint.kind].aligned and KINDS[joint.kind].dof
    ]
    sides.sort(key=lambda each: (each[0] < tree_joints, each[1] == 0))
    pairs = [
        (reference, rotated)
        for reference, rotated in combinations(sides, 2)
        if reference[2].link == rotated[2].link and rotated[0] < tree_joints
    ]
    change, largest, cause = np.zeros((len(mechanism.joints), 2, 6)), 0.0, ""
    directions = {(i, side): _rotated_axis(end, np.zeros(3)) for i, side, end in sides}
    for number, (reference, rotated) in enumerate(pairs * SWEEPS):
        if number == len(pairs) and not change.any():
            break  # other sweeps would find the same exact angles
        first, second = directions[reference[:2]], directions[rotated[:2]]
        if (first == second).all():
            continue
        normal = np.cross(first, second)
        angle = float(np.arctan2(np.linalg.norm(normal), first @ second))
        usual = USUAL_ANGLE * round(angle / USUAL_ANGLE)
        off = usual - angle
        if normal.any() and abs(off) < MAX_ANGLE:
            change[rotated[0], rotated[1], 3:] += off * normal / np.linalg.norm(normal)
            directions[rotated[:2]] = _rotated_axis(rotated[2], change[rotated[0], rotated[1], 3:])
        if max(largest, EXACT) < abs(off) < MAX_ANGLE:
            right = "parallel" if usual in (0.0, np.pi) else f"{np.rad2deg(usual):.0f} deg"
            names, largest = sorted(mechanism.joints[i].name for i in (reference[0], rotated[0])), abs(off)
            axes = f"the axes of {' and '.join(names)} on {reference[2].link}"
            cause = f"{axes} are {np.rad2deg(largest):.3g} deg off {right}"
    return change, cause, largest


def _rotated_axis(end: End, rotation: Array) -> Array:
    return turned_by(end.frame[None], rotation[None])[0, :, 2]


def _least_gap(mechanism: Mechanism) -> str:
    """Return the least gap of the loops as written at a displaced driver, as a clause; empty if unknown."""
    loops, guess = _loops_and_guess(mechanism)
    for name, by in product([*mechanism.drivers, *loops.tree.index_of], STATED_AT):
        index = loops.tree.index_of[name]
        driven, step = replace(loops, driven=(index,)), np.zeros((loops.count, 1))
        step[index] = by
        q = nearest_consistent(driven, loops.displaced(guess, step), ANGLE_TOLERANCE, ANGLE_TOLERANCE)
        residual = loops.linearise(q)[0][:, 0]
        if not np.abs(residual).max() < MAX_ANGLE:
            continue
        gap = max(
            (cut.length * float(np.linalg.norm(residual[rows])) for cut, rows in loops.gap_rows), default=0.0
        )
        return f"; least gap {gap:.2g} m at {name} = {q.values[index, 0]:.3g} {mechanism.unit(name)}"
    return ""


def _joined(coordinates: Sequence[Coordinates]) -> Coordinates:
    """Return the coordinates of all instants of several sets."""
    return Coordinates(
        np.concatenate([q.values for q in coordinates], 1), np.concatenate([q.turns for q in coordinates], -1)
    )


def _inconsistent(loops: TreeLoops, q: Coordinates, tolerance: float) -> bool:
    """Whether rounding decides: equations are nearly redundant, or violated where others are satisfied."""
    residual, jacobian, _ = loops.linearise(q)
    values = np.linalg.svd(jacobian.transpose(2, 0, 1), compute_uv=False)
    nearly_redundant = significant(values) & ~significant(values, tolerance, tolerance)
    return bool((np.abs(residual) > ROUNDING).any() or nearly_redundant.any())


def _is_exact(loops: TreeLoops, q: Coordinates) -> bool:
    """Whether loops close, and each equation is independent of those of earlier loops, or depends on them.

    In a row of n loops the smallest singular value falls as 1/n. The part of an equation's gradient that is
    normal to those before it does not; it is compared with the longest of its loop, of lengths or angles.
    """
    residual, jacobian, _ = loops.linearise(q)
    if not np.abs(residual).max() <= ROUNDING:
        return False
    basis, first = np.zeros((0, loops.count)), 0
    groups = [(len(cut.lengths), cut.rows) for cut in loops.cuts] + [(1, 1)] * len(loops.couplings)
    for lengths, rows in groups:
        block = jacobian[first : first + rows, :, 0]
        norms, first = np.linalg.norm(block, axis=1), first + rows
        longest = np.repeat(
            [norms[:lengths].max(initial=FLOOR), norms.max(initial=FLOOR)], [lengths, rows - lengths]
        )
        rest = block / longest[:, None]
        # the second projection removes the rounding of the first
        for _ in range(2):
            rest = rest - rest @ basis.T @ basis
        order, sizes = pivot_columns(rest.T)
        if ((sizes > RANK_TOLERANCE) & (sizes < INDEPENDENT)).any():
            return False
        new = rest[order[: int((sizes >= INDEPENDENT).sum())]]
        basis = np.concatenate([basis, np.linalg.qr(new.T)[0].T])
    return True


def _affected_joints(loops: TreeLoops, poses: Sequence[Coordinates], tolerance: float) -> set[str]:
    """Return the joints of inconsistent loops, and of all loops that share a joint with them."""
    joint_of = [branch.joint.name for branch in loops.tree.branches for _ in range(branch.kind.dof)]
    around = [{cut.joint.name, *(joint_of[i] for i in cut.columns)} for cut in loops.cuts]
    loop_of = np.repeat(np.arange(len(loops.cuts)), [cut.rows for cut in loops.cuts])
    affected: set[str] = set()
    for q in poses:
        residual, jacobian, _ = loops.linearise(q)
        u, values, _ = np.linalg.svd(jacobian[..., 0])
        values = np.pad(values, (0, loops.rows - len(values)))
        violation = np.abs(u.T @ residual[:, 0])
        inconsistent = ~significant(values, tolerance, tolerance) & (
            significant(values) | (violation > ROUNDING)
        )
        share = np.abs(u[:, inconsistent]).max(1, initial=0.0)[: len(loop_of)] > MIN_SHARE
        for cut in np.unique(loop_of[share]):
            affected |= around[cut]
    while wider := [joints for joints in around if joints & affected and not joints <= affected]:
        affected.update(*wider)
    return affected


def _jacobians(mechanism: Mechanism, loops: TreeLoops, q: Coordinates, concerned: set[str]) -> Array:
    """Return derivatives of residuals by shifts and rotations of joint sides, (rows, poses, joints, 2, 6).

    They are differences. The changes of one joint are evaluated together, as designs with its other sides.
    """
    residual, length = loops.linearise(q)[0], mechanism.characteristic_length
    jacobian = np.zeros((*residual.shape, len(mechanism.joints), 2, 6))
    joints = {joint.name: joint for joint in loops.tree.mechanism.joints}
    for index, (name, kind) in enumerate((joint.name, KINDS[joint.kind]) for joint in mechanism.joints):
        if name not in concerned or kind.floating:
            continue
        # rotations of the sides of a ball do not enter its equations
        entering = 3 if kind.ball else 6
        steps = STEP * np.eye(12).reshape(2, 6, 2, 6)[:, :entering].reshape(-1, 2, 6)
        repeated, joint = steps.repeat(len(q), 0), joints[name]
        a, b = _changed_side(joint.a, repeated[:, 0], length), _changed_side(joint.b, repeated[:, 1], length)
        changed = with_sides(loops, {name: (*a, *b)})
        perturbed = changed.linearise(q.repeated(len(steps)))[0].reshape(len(residual), len(steps), len(q))
        derivatives = ((perturbed - residual[:, None]) / STEP).swapaxes(1, 2)
        jacobian[:, :, index, :, :entering] = derivatives.reshape(*residual.shape, 2, entering)
    return jacobian


def _changed_side(end: End, changes: Array, length: float) -> tuple[Array, Array]:
    """Return points (3, n) and frames (3, 3, n) of a side after changes (n, 6) as `with_moved_sides`."""
    point = np.array(end.point)[:, None] + length * changes[:, :3].T
    return point, np.moveaxis(turned_by(end.frame[None], changes[:, 3:]), 0, -1)


def _loops_and_guess(mechanism: Mechanism) -> tuple[TreeLoops, Coordinates]:
    """Return the loop equations with all coordinates free, and the stated configuration."""
    loops, guess = tree_loops(mechanism)
    return replace(loops, driven=()), guess


def with_moved_sides(mechanism: Mechanism, change: Array) -> Mechanism:
    """Return a mechanism with joint sides shifted, in characteristic lengths, and rotated, in [rad]."""
    length = mechanism.characteristic_length
    joints = (
        replace(joint, a=_moved(joint.a, a, length), b=_moved(joint.b, b, length))
        for joint, (a, b) in zip(mechanism.joints, change, strict=True)
    )
    return replace(mechanism, joints=tuple(joints))


def _moved(end: End, change: Array, length: float) -> End:
    if not change.any():
        return end
    point, frame = (array[..., 0] for array in _changed_side(end, change[None], length))
    return End(end.link, vector(point), vector(frame[:, 2]), vector(frame[:, 0]))
