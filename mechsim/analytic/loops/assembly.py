"""Assembly by Newton's method: closing the loops at crank angles, from a guess or from a neighbour."""

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.loop_equations import Poses, equations, row_units
from mechsim.analytic.loops.rank import least_norm
from mechsim.analytic.vector_method.rotations import dot, turned_by
from mechsim.errors import AssemblyError, InputError
from mechsim.model.joint_kinds import KINDS, opposed
from mechsim.model.link_poses import rough_poses
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism, described
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers

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
        for i in KINDS[joint.kind].alike:
            sides = [poses_of[end.link].rotation @ end.frame[:, i] for end in (joint.a, joint.b)]
            antiparallel = np.broadcast_to(dot(*sides) < 0.0, angles.shape)
            if antiparallel.any():
                where = f"crank angle {angles[np.argmax(antiparallel)]:.6g} rad"
                raise AssemblyError(f"{mechanism.name}: at {where} {opposed(joint.name, i)}")


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
