"""The loop equations of a mechanism at given poses, and how far they are from closed."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.loops.joint_rows import (
    CoordinateMotion,
    Rows,
    Side,
    Stack,
    add_joint,
    coordinate_motion,
    is_length,
)
from mechsim.analytic.vector_method.rotations import wrap
from mechsim.model.couplings import Coupling
from mechsim.model.joints import Joint, joint_coordinate
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

Poses = Mapping[str, Pose]
# crank angle, or driver -> value; None where drivers are free
Angles = ArrayLike | Mapping[str, ArrayLike] | None


def equations(
    mechanism: Mechanism,
    poses: Poses,
    angle: Angles,
    twists: Mapping[str, Array] | None = None,
) -> Rows:
    """Return the loop equations of a mechanism, linearised about n sets of poses.

    Args:
        mechanism: the mechanism.
        poses: moving link -> n poses.
        angle: crank angle that the driver row asks for, scalar or (n,) in [rad]; of several drivers each
            one's value, else they are taken as they stand. None leaves the rows of drivers out.
        twists: moving link -> (n, 6) velocity of the origin and angular velocity; only the bias
            depends on them. None means at rest.

    Returns:
        Rows in the order of the joints, then couplings (`Mechanism.laws`), holds, and drivers. Residuals in
        [m], [rad] or cosines of angles.
    """
    names = [link.name for link in mechanism.links]
    n = next(iter(poses.values())).position.shape[0]
    at_rest = np.zeros((n, 6))
    ground = Pose(np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3)))

    def side(joint: Joint, which: str) -> Side:
        end = getattr(joint, which)
        if end.link == GROUND:
            return Side(ground, at_rest, end.point, end.frame, None)
        twist = at_rest if twists is None else twists[end.link]
        return Side(poses[end.link], twist, end.point, end.frame, names.index(end.link))

    def pose(link: str) -> Pose:
        return ground if link == GROUND else poses[link]

    stack = Stack(len(names), n)
    for joint in mechanism.joints:
        add_joint(stack, joint, side(joint, "a"), side(joint, "b"))
    joint_of = {name: (joint, i) for joint in mechanism.joints for i, name in enumerate(joint.coordinates)}

    def value(name: str) -> Array:
        joint, i = joint_of[name]
        return joint_coordinate(joint, pose(joint.a.link), pose(joint.b.link))[..., i]

    def motion(name: str) -> CoordinateMotion:
        joint, i = joint_of[name]
        return coordinate_motion(joint, i, side(joint, "a"), side(joint, "b"))

    prescribed = _prescribed(mechanism, angle)
    for law in mechanism.laws:
        _add_law(stack, mechanism, law, value, motion, prescribed)
    for name, target in (*mechanism.locked.items(), *prescribed.items()):
        gap = np.zeros(n) if target is None else value(name) - np.asarray(target)
        stack.weighted(
            gap if mechanism.unit(name) == "m" else wrap(gap), np.zeros(n), [(np.ones(n), motion(name))]
        )
    return stack.rows()


def _prescribed(mechanism: Mechanism, angle: Angles) -> dict[str, ArrayLike | None]:
    """Return what is asked of each driver; None for one that is taken as it stands."""
    if angle is None:
        return {}
    if isinstance(angle, Mapping):
        return {name: angle[name] for name in mechanism.drivers}
    return dict.fromkeys(mechanism.drivers, angle if mechanism.has_crank else None)


def _add_law(
    stack: Stack,
    mechanism: Mechanism,
    law: Coupling,
    value: Callable[[str], Array],
    motion: Callable[[str], CoordinateMotion],
    prescribed: Mapping[str, ArrayLike | None],
) -> None:
    """Add the row of a coupling."""

    def counted(name: str) -> Array:
        """A driver's own value counts its turns, and that of a start, so that any ratio works."""
        current, target = value(name), prescribed.get(name)
        if target is None and name not in mechanism.drivers:
            target = mechanism.counted.get(name)
        if target is None or mechanism.unit(name) == "m":
            return current
        return np.asarray(target) + wrap(current - np.asarray(target))

    def total(terms: Mapping[str, float]) -> Array:
        return sum((weight * counted(name) for name, weight in terms.items()), np.zeros(stack.n))

    current, derivative, second_derivative = law.polynomial(total(law.right_terms))
    residual = total(law.left_terms) - law.zeros[0] - current
    angular = all(mechanism.unit(name) == "rad" for name in law.left_terms)
    left = [(np.full(stack.n, weight), motion(name)) for name, weight in law.left_terms.items()]
    right = [(-weight * derivative, motion(name)) for name, weight in law.right_terms.items()]
    rate = sum((weight * motion(name).rate for name, weight in law.right_terms.items()), np.zeros(stack.n))
    stack.weighted(wrap(residual) if angular else residual, -second_derivative * rate**2, [*left, *right])


def lengths(mechanism: Mechanism, count: int) -> NDArray[np.bool_]:
    """Say of each of the first `count` rows of a mechanism whether its residual is a length, (count,)."""
    is_length_row = [length for joint in mechanism.joints for length in is_length(joint)]
    firsts = [next(iter(law.left_terms)) for law in mechanism.laws]
    named = (*firsts, *mechanism.locked, *mechanism.drivers)
    return np.array(
        [*is_length_row, *(mechanism.unit(name) == "m" for name in named)][:count], dtype=np.bool_
    )


def row_units(mechanism: Mechanism, count: int) -> Array:
    """Return factors that make the first `count` rows of a mechanism free of units, (count,)."""
    return np.where(lengths(mechanism, count), 1.0 / mechanism.size, 1.0)


def scaled(mechanism: Mechanism, jacobian: Array) -> Array:
    """Make a Jacobian free of units: lengths in units of the mechanism's size."""
    size = mechanism.size
    columns = np.tile([size] * 3 + [1.0] * 3, len(mechanism.links))
    return jacobian * columns * row_units(mechanism, jacobian.shape[1])[:, None]


def residual_norms(mechanism: Mechanism, poses: Poses, angle: Angles) -> tuple[Array, Array]:
    """Return how far the loops stand open at each pose: (n,) in [m] and (n,) in [rad]."""
    rows = np.abs(equations(mechanism, poses, angle).residual)
    long = lengths(mechanism, rows.shape[1])
    return rows[:, long].max(1, initial=0.0), rows[:, ~long].max(1, initial=0.0)
