"""The path of a looper's C along a curve: the dyad with C on the curve, and the deviation of a linkage."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from mechsim.analytic.vector_method.vectors import Sign
from mechsim.errors import AssemblyError, InputError
from mechsim.numerics.arrays import Array

# the catalogue's looper, whose parameters are stated in its file
Looper: TypeAlias = Any
# crank step for the speed of C, in [rad]: a central difference with an error of 1e-10
STEP = 1e-5
# largest number of Newton steps; three or four suffice unless C reverses near an end of the curve
MAX_ITERATIONS = 20


@dataclass(frozen=True, slots=True)
class Passage:
    """Crossings of the path of C with the normals of a curve.

    Attributes:
        angles: crank angles, (n,) in [rad].
        error: distances from the curve along its normals, signed, (n,) in [m].
        b: positions of B, (n, 2) in [m].
        levers: derivative of the error by |B - O2|2 - c2, (n,) in [1/m].
    """

    angles: Array
    error: Array
    b: Array
    levers: Array


def depth(y: Array, base: Looper) -> Array:
    """Return the distance of C from the plane on its cylinder at height y, the nearer solution, (n,) in [m].

    NaN where y is outside the cylinder.
    """
    with np.errstate(invalid="ignore"):
        half = np.sqrt((base.follower - (y - base.axis_y)) * (base.follower + (y - base.axis_y)))
    return base.axis_z - np.copysign(half, base.axis_z)


def dyad(curve: Array, base: Looper, branch: Sign, *, in_space: bool = False) -> tuple[Array, Array]:
    """Return crank angles, (n,) in [rad], and positions of B, (n, 2) in [m], with C on a curve.

    Args:
        curve: positions of C, (n, 2) in [m].
        base: gives crank a, coupler b, arm k and arm angle; in space also the cylinder.
        branch: side of A seen from O1 towards C, +1 for left.
        in_space: whether the curve is that of C on the cylinder, seen along Z; arm and arm angle are then
            their projections, k' and omega' of the paper.

    Raises:
        InputError: where C is out of reach.
    """
    z = depth(curve[:, 1], base) if in_space else np.zeros(len(curve))
    k, cosine, sine = _shown(z, base)
    if not np.isfinite(sine).all():
        raise InputError("the cylinder takes C farther from the plane than its arm reaches; move its axis")
    a, reach = base.crank, np.hypot(curve[:, 0], curve[:, 1])
    if not ((reach >= np.abs(k - a)) & (reach <= k + a)).all():
        raise InputError(
            f"the curve runs {reach.min():.6g} to {reach.max():.6g} m from the crank's shaft, but crank and "
            f"arm reach {abs(base.arm - a):.6g} to {base.arm + a:.6g} m; shorten or move the curve or change "
            "the arm"
        )
    inner = np.arccos(np.clip((a * a + (reach - k) * (reach + k)) / (2.0 * a * reach), -1.0, 1.0))
    angles = np.unwrap(np.arctan2(curve[:, 1], curve[:, 0]) + branch * inner)
    pin = crank_pin(angles, base)
    return angles, pin + _rod(curve - pin, k, cosine, sine, base)


def crank_pin(angles: Array, base: Looper) -> Array:
    """Return positions of A, (n, 2) in [m]."""
    return base.crank * np.column_stack([np.cos(angles), np.sin(angles)])


def passage(design: Looper, curve: Array, angles: Array, *, in_space: bool = False) -> Passage:
    """Return the crossings of a linkage's C with the normals of a curve, by Newton's method.

    Args:
        design: the whole linkage.
        curve: points in order, (n, 2) in [m].
        angles: crank angles near the crossings, (n,) in [rad].
        in_space: whether to use C of the spatial linkage, seen along Z, instead of that of the planar
            four-bar.

    Raises:
        AssemblyError: where the linkage does not close, or C reverses or never crosses a normal.

    Accuracy: the error to 1e-16 of the arm; the levers to 1e-9.
    """
    tangents = _tangents(curve)
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    angles, positions, speed = _crossings(design, curve, tangents, angles, in_space)
    rate, off = (speed * tangents).sum(1), positions[:, :2] - curve
    b, moved = _response(design, positions, angles, in_space)
    # C stays on the normal: the crank compensates its displacement along the curve
    derivative = (speed * normals).sum(1) / rate
    levers = (moved * normals).sum(1) - derivative * (moved * tangents).sum(1)
    return Passage(angles, (off * normals).sum(1), b, levers)


def levers_on(design: Looper, curve: Array, angles: Array, *, in_space: bool = False) -> Array:
    """Return the levers of a linkage with C on a curve, (n,) in [1/m].

    Args:
        design, curve, in_space: as in `passage`.
        angles: crank angles of the dyad with C on the curve, (n,) in [rad].
    """
    z = depth(curve[:, 1], design) if in_space else np.zeros(len(curve))
    tangents = _tangents(curve)
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    return (_response(design, np.column_stack([curve, z]), angles, in_space)[1] * normals).sum(1)


def _crossings(
    design: Looper, curve: Array, tangents: Array, angles: Array, in_space: bool
) -> tuple[Array, Array, Array]:
    """Return crank angles, (n,), positions of C, (n, 3), and speeds, (n, 2), at the crossings."""
    middle = len(curve) // 2
    for _ in range(MAX_ITERATIONS):
        positions, speed = _path(design, angles, in_space)
        along, rate = ((positions[:, :2] - curve) * tangents).sum(1), (speed * tangents).sum(1)
        if not np.isfinite(along + rate).all():
            break
        reversed_ = rate * rate[middle] <= 0.0
        if not reversed_.any() and np.abs(along).max() <= 1e-14 * design.arm and _monotonic(angles):
            return angles, positions, speed
        # where C has reversed, step inwards only; a longer step could lead there
        inwards = np.sign(angles - angles[middle])
        step = np.divide(along, rate, out=inwards.copy(), where=~reversed_)
        angles = angles - np.clip(step, -0.1, 0.1)
    raise AssemblyError("the linkage does not close, or C reverses, while C is on the curve")


def wedge(u: Array, v: Array) -> Array:
    """Return the cross product of vectors in the plane, (n,) for (n, 2)."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _response(design: Looper, positions: Array, angles: Array, in_space: bool) -> tuple[Array, Array]:
    """Return B, and the derivative of C by |B - O2|2 - c2 with the crank fixed, (n, 2) each.

    The coupler rotates about A until B is on its circle again.
    """
    pin = crank_pin(angles, design)
    to_b = _rod(positions[:, :2] - pin, *_shown(positions[:, 2], design), design)
    closed = 2.0 * wedge(to_b, pin + to_b - design.closed_form.pivot[:2, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = -_sweep(design, positions, pin, to_b, in_space) / closed[:, None]
    if not np.isfinite(moved).all():
        raise AssemblyError("coupler and rocker are collinear while C is on the curve")
    return pin + to_b, moved


def _monotonic(angles: Array) -> bool:
    steps = np.diff(angles)
    return bool((steps > 0.0).all() or (steps < 0.0).all()) and abs(angles[-1] - angles[0]) < 2.0 * np.pi


def _path(design: Looper, angles: Array, in_space: bool) -> tuple[Array, Array]:
    """Return positions of C, (n, 3) in [m], and their derivatives by the crank angle, (n, 2) in [m/rad]."""
    around = np.concatenate([angles, angles + STEP, angles - STEP])
    with np.errstate(invalid="ignore"):
        positions = design.positions(around)["C"] if in_space else design.closed_form.planar_point(around)
    current, ahead, behind = np.split(positions, 3)
    return current, (ahead - behind)[:, :2] / (2.0 * STEP)


def _shown(z: Array, base: Looper) -> tuple[Array, Array, Array]:
    """Return projected arm, and cosine and sine of the projected arm angle, with C at a depth, (n,) each."""
    with np.errstate(invalid="ignore"):
        k = np.sqrt((base.arm - z) * (base.arm + z))
        cosine = base.arm * np.cos(base.arm_angle) / k
        return k, cosine, np.sign(np.sin(base.arm_angle)) * np.sqrt((1.0 - cosine) * (1.0 + cosine))


def _rod(to_c: Array, k: Array, cosine: Array, sine: Array, base: Looper) -> Array:
    """Return projected AB from AC, (n, 2) each in [m]."""
    x, y = (to_c / k[:, None]).T
    return base.coupler * np.column_stack([cosine * x + sine * y, cosine * y - sine * x])


def _sweep(design: Looper, positions: Array, pin: Array, to_b: Array, in_space: bool) -> Array:
    """Return the projected derivative of C by a rotation of B about A, (n, 2) in [m/rad]."""
    to_c = positions[:, :2] - pin
    if not in_space:
        return np.column_stack([-to_c[:, 1], to_c[:, 0]])
    # AC keeps its length and its angle to AB, and C stays on the cylinder
    z = positions[:, 2]
    arm, rod = np.column_stack([to_c, z]), np.column_stack([to_b, np.zeros_like(z)])
    lever = np.column_stack([np.zeros_like(z), positions[:, 1] - design.axis_y, z - design.axis_z])
    volume = (np.cross(arm, rod) * lever).sum(1)
    return (-wedge(to_b, to_c) / volume)[:, None] * np.cross(lever, arm)[:, :2]


def _tangents(curve: Array) -> Array:
    """Return unit tangents of a curve given by points, (n, 2)."""
    along = np.gradient(curve, axis=0)
    return along / np.hypot(along[:, 0], along[:, 1])[:, None]
