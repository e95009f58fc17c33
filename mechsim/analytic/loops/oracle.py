"""Rank of the loop equations: mobility, redundant rows, distance to a singular pose, least-norm solutions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.maximal_coordinates import Poses, equations, row_units, scaled
from mechsim.analytic.loops.record import joint_motions, point_on
from mechsim.analytic.vector_method.rotations import dot, turned_by
from mechsim.errors import AssemblyError, InputError
from mechsim.model.joint_kinds import KINDS, antiparallel_message
from mechsim.model.link_poses import rough_poses
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism, described
from mechsim.model.motion import LinkMotion, Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers
from mechsim.numerics.rank import RANK_TOLERANCE

# poses at which ranks are looked at: so many are not all special ones
SAMPLED_POSES = 5
# condition of the normal equations below which two refinements leave rounding
MAX_CONDITION = 1e10
# what is smaller than this part of the largest is nought
NEGLIGIBLE = 1e-40


def singular_values(mechanism: Mechanism, poses: Poses, *, crank_free: bool = False) -> Array:
    """Return the singular values of the loop Jacobian in units of the mechanism's size, (n, k), falling.

    With the crank held, the smallest of them that belongs to a determined coordinate is the
    distance to a singular pose (a dead centre of the crank).
    """
    angle = None if crank_free else 0.0
    rows = equations(mechanism, poses, angle)
    values = np.linalg.svd(scaled(mechanism, rows.jacobian), compute_uv=False)
    return values.astype(np.float64, copy=False)


def conditioning(mechanism: Mechanism, poses: Poses) -> Array:
    """Return the distance of each pose from a singular one with the crank held, (n,), 0 to about 1.

    The smallest singular value of the loop Jacobian in units of the mechanism's size; those that are
    nought at every pose, of redundant rows and passive freedoms, do not count.
    """
    values = singular_values(mechanism, poses)
    rank = int((values > RANK_TOLERANCE * values[:, :1]).sum(1).max())
    return values[:, rank - 1]


@dataclass(frozen=True, slots=True)
class Freedom:
    """What the rank of the loop Jacobian says, at the pose of several where it is largest.

    Attributes:
        mobility: freedoms left by all joints.
        passive: freedoms left once the crank is held, which move no tracked point by themselves.
        redundant: rows that repeat what others say.
        rank: of the loop Jacobian without the driver row.
    """

    mobility: int
    passive: int
    redundant: int
    rank: int


def freedom(mechanism: Mechanism, poses: Poses) -> Freedom:
    """Return mobility, passive freedoms and redundant rows, by `SEEN` poses or a few more, evenly spread.

    A pose at which assemblies meet says no more than that it is one.

    Source: rank of the Jacobian of the loop equations; papers.md sections 1-3 for what is expected.
    """
    count = len(next(iter(poses.values())).position)
    sample = {
        name: pose.select(slice(None, None, max(1, count // SAMPLED_POSES))) for name, pose in poses.items()
    }
    unknowns = 6 * len(mechanism.links)

    def rank(crank_free: bool) -> tuple[int, int]:
        values = singular_values(mechanism, sample, crank_free=crank_free)
        rows = equations(mechanism, sample, None if crank_free else 0.0).residual.shape[1]
        return int((values > RANK_TOLERANCE * values[:, :1]).sum(1).max()), rows

    free_rank, rows = rank(True)
    crank_locked_rank, _ = rank(False)
    return Freedom(unknowns - free_rank, unknowns - crank_locked_rank, rows - free_rank, free_rank)


def least_norm(mechanism: Mechanism, jacobian: Array, right: Array) -> Array:
    """Least-norm solution of J x = right, (n, 6 links): redundant rows, passive freedoms do no harm.

    Where the columns of J are far from dependent, by refined normal equations, to rounding too and ten
    times as fast as by singular values.
    """
    columns = np.tile([mechanism.size] * 3 + [1.0] * 3, len(mechanism.links))
    matrix = jacobian * columns
    solution = _by_normal_equations(matrix, right[..., None])
    if solution is None:
        solution = np.linalg.pinv(matrix, rcond=RANK_TOLERANCE) @ right[..., None]
    return columns * solution[..., 0]


def _by_normal_equations(matrix: Array, right: Array) -> Array | None:
    """Return the least-squares solution, (n, k, 1); None where columns are dependent or nearly so."""
    transposed = np.swapaxes(matrix, 1, 2)
    gram = transposed @ matrix
    try:
        inverse = np.linalg.inv(gram)
    except np.linalg.LinAlgError:
        return None
    with np.errstate(all="ignore"):
        condition = np.abs(gram).sum(1).max(1) * np.abs(inverse).sum(1).max(1)
    if not (condition < MAX_CONDITION).all():
        return None
    solution = inverse @ (transposed @ right)
    for _ in range(2):
        solution = solution + inverse @ (transposed @ (right - matrix @ solution))
    # products of rounding, which underflow when squared
    return np.where(np.abs(solution) < NEGLIGIBLE * np.abs(solution).max(1, keepdims=True), 0.0, solution)


# a gap this small is rounding; polishing on would chase it down to the denormal numbers
FLOOR = 4.0 * np.finfo(np.float64).eps


# the most by which a link turns in one step, in [rad]: the linear model is not true farther
MAX_ROTATION = 0.5

# how far a pose between two crank angles may stand open: near enough for the next step, which begins from it
POLISH_BELOW = 1e-6


def assemble(
    mechanism: Mechanism,
    angles: ArrayLike,
    guess: Poses | None = None,
    *,
    most_steps: int = 50,
    tolerance: float = 1e-12,
) -> dict[str, Pose]:
    """Close the loops at each crank angle by Newton's method from a guess.

    Args:
        mechanism: the mechanism.
        angles: crank angles, (n,) in [rad].
        guess: moving link -> one pose or n poses; None takes the mechanism's own guess for all angles.
        most_steps: Newton steps before giving up.
        tolerance: largest residual left, in units of the mechanism's size and in [rad]; below `ROUGH`
            the poses are polished to rounding all the same.

    Returns:
        Moving link -> n poses.

    Raises:
        AssemblyError: where the loops do not close; names the crank angle and the gap left.

    Accuracy: Newton's method to rounding: residuals of a few ulp of the longest link away from a
    dead centre.
    """
    mechanism = described(mechanism)
    angles = crank_angles(mechanism, angles)
    guess_poses = rough_poses(mechanism) if guess is None else guess
    poses = {
        link.name: Pose(
            np.broadcast_to(guess_poses[link.name].position, (len(angles), 3)),
            np.broadcast_to(guess_poses[link.name].rotation, (len(angles), 3, 3)),
        )
        for link in mechanism.links
    }
    gap, previous = np.full(len(angles), np.inf), np.inf
    for _ in range(most_steps):
        rows = equations(mechanism, poses, angles)
        gap = _gap(mechanism, rows.residual)
        worst = gap.max()
        if worst <= FLOOR or (worst <= tolerance and (tolerance >= POLISH_BELOW or worst >= 0.25 * previous)):
            break
        previous = worst
        step = -least_norm(mechanism, rows.jacobian, rows.residual)
        rotations = step.reshape(len(angles), -1, 6)[..., 3:]
        step *= MAX_ROTATION / np.maximum(MAX_ROTATION, np.sqrt((rotations**2).sum(-1)).max(-1))[:, None]
        poses = moved_poses(mechanism, poses, step)
    if not gap.max() <= tolerance:
        worst = int(np.argmax(gap))
        raise AssemblyError(
            f"{mechanism.name}: the loops do not close at crank angle {angles[worst]:.6g} rad: a gap of "
            f"{gap[worst]:.3g} of the longest link is left after {most_steps} Newton steps; "
            "change the dimensions, the crank angle or the guess"
        )
    _require_axes_aligned(mechanism, poses, angles)
    return poses


def _require_axes_aligned(mechanism: Mechanism, poses: Poses, angles: Array) -> None:
    """Refuse joints put together with axes or marks opposed: the rows say parallel, not in which sense."""
    poses_of = {GROUND: IDENTITY, **poses}
    for joint in mechanism.joints:
        for i in KINDS[joint.kind].aligned_columns:
            sides = [poses_of[end.link].rotation @ end.frame[:, i] for end in (joint.a, joint.b)]
            antiparallel = np.broadcast_to(dot(*sides) < 0.0, angles.shape)
            if antiparallel.any():
                where = f"crank angle {angles[np.argmax(antiparallel)]:.6g} rad"
                raise AssemblyError(f"{mechanism.name}: at {where} {antiparallel_message(joint.name, i)}")


def crank_angles(mechanism: Mechanism, angles: ArrayLike) -> Array:
    """Return crank angles as (n,) in [rad], or say what is wrong with them."""
    values = np.atleast_1d(numbers(angles))
    if values.ndim != 1 or not values.size or not np.isfinite(values).all():
        raise InputError(
            f"{mechanism.name}: a crank angle is no finite number, or there is none; give a list in [rad]"
        )
    return values


def _gap(mechanism: Mechanism, residual: Array) -> Array:
    return np.abs(residual * row_units(mechanism, residual.shape[1])).max(1)


def moved_poses(mechanism: Mechanism, poses: Poses, step: Array) -> dict[str, Pose]:
    """Return poses displaced by (n, 6 links): shifts in [m] and rotation vectors in [rad]."""
    moved = {}
    for i, link in enumerate(mechanism.links):
        shift, vector = step[:, 6 * i : 6 * i + 3], step[:, 6 * i + 3 : 6 * i + 6]
        pose = poses[link.name]
        moved[link.name] = Pose(pose.position + shift, turned_by(pose.rotation, vector))
    return moved


def rates(
    mechanism: Mechanism, poses: Poses, angle: ArrayLike, speed: ArrayLike, acceleration: ArrayLike = 0.0
) -> Motion:
    """Differentiate the loop equations twice: exact velocities and accelerations of everything.

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
    speed = crank_rate(mechanism, "speed", speed, n)
    acceleration = crank_rate(mechanism, "acceleration", acceleration, n)

    rows = equations(mechanism, poses, angle)
    rhs = np.zeros_like(rows.residual)
    rhs[:, -1] = speed
    twist = least_norm(mechanism, rows.jacobian, rhs).reshape(n, -1, 6)
    twists = {name: twist[:, i] for i, name in enumerate(names)}

    rows = equations(mechanism, poses, angle, twists)
    rhs[:, -1] = acceleration
    accelerations = least_norm(mechanism, rows.jacobian, rhs - rows.bias).reshape(n, -1, 6)

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
    points = {
        point: point_on(links[link], local)
        for point, (link, local) in mechanism.points.items()
        if link != GROUND
    }
    return Motion(
        source="loop equations",
        angle=angle,
        speed=speed,
        acceleration=acceleration,
        points=points,
        links=links,
        joints={
            name: motion for joint in mechanism.joints for name, motion in joint_motions(joint, links).items()
        },
    )


def crank_rate(mechanism: Mechanism, what: str, value: ArrayLike, n: int) -> Array:
    """Return a rate of the crank at n instants, (n,), or say what is wrong with it."""
    rate = numbers(value)
    if rate.shape not in ((), (1,), (n,)) or not np.isfinite(rate).all():
        raise InputError(f"{mechanism.name}: the crank's {what} is no finite number; give one, or {n}, in SI")
    return np.broadcast_to(rate, (n,))
