"""The path of a looper's C along a curve: the dyad with C on the curve, and the deviation of a linkage."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.kinematics.vector_method.vectors import Sign
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


def dyad(curve: Array, base: Looper, branch: Sign) -> tuple[Array, Array]:
    """Return crank angles, (n,) in [rad], and positions of B, (n, 2) in [m], with C on a curve.

    Args:
        curve: positions of C, (n, 2) in [m].
        base: gives crank a, coupler b, arm k and arm angle.
        branch: side of A seen from O1 towards C, +1 for left.

    Raises:
        InputError: where C is out of reach.
    """
    a, k, reach = base.crank, base.arm, np.hypot(curve[:, 0], curve[:, 1])
    if not ((reach >= abs(k - a)) & (reach <= k + a)).all():
        raise InputError(
            f"the curve runs {reach.min():.6g} to {reach.max():.6g} m from the crank's shaft, but crank and "
            f"arm reach {abs(k - a):.6g} to {k + a:.6g} m; shorten or move the curve or change the arm"
        )
    inner = np.arccos(np.clip((a * a + (reach - k) * (reach + k)) / (2.0 * a * reach), -1.0, 1.0))
    angles = np.unwrap(np.arctan2(curve[:, 1], curve[:, 0]) + branch * inner)
    pin = crank_pin(angles, base)
    return angles, pin + _rod(curve - pin, base)


def crank_pin(angles: Array, base: Looper) -> Array:
    """Return positions of A, (n, 2) in [m]."""
    return base.crank * np.column_stack([np.cos(angles), np.sin(angles)])


def passage(design: Looper, curve: Array, angles: Array) -> Passage:
    """Return the crossings of a linkage's C with the normals of a curve, by Newton's method.

    Args:
        design: the whole linkage.
        curve: points in order, (n, 2) in [m].
        angles: crank angles near the crossings, (n,) in [rad].

    Raises:
        AssemblyError: where the linkage does not close, or C reverses or never crosses a normal.

    Accuracy: the error to 1e-16 of the arm; the levers to 1e-9.
    """
    along = np.gradient(curve, axis=0)
    tangents = along / np.hypot(along[:, 0], along[:, 1])[:, None]
    normals = np.column_stack([tangents[:, 1], -tangents[:, 0]])
    angles, positions, speed = _crossings(design, curve, tangents, angles)
    rate, off = (speed * tangents).sum(1), positions - curve
    b, moved = _response(design, positions, angles)
    # C stays on the normal: the crank compensates its displacement along the curve
    derivative = (speed * normals).sum(1) / rate
    levers = (moved * normals).sum(1) - derivative * (moved * tangents).sum(1)
    return Passage(angles, (off * normals).sum(1), b, levers)


def _crossings(design: Looper, curve: Array, tangents: Array, angles: Array) -> tuple[Array, Array, Array]:
    """Return crank angles, (n,), positions of C and speeds, (n, 2) each, at the crossings."""
    middle = len(curve) // 2
    for _ in range(MAX_ITERATIONS):
        positions, speed = _path(design, angles)
        along, rate = ((positions - curve) * tangents).sum(1), (speed * tangents).sum(1)
        if not np.isfinite(along + rate).all():
            break
        reversed_, steps = rate * rate[middle] <= 0.0, np.diff(angles)
        crossed = not reversed_.any() and np.abs(along).max() <= 1e-14 * design.arm
        monotonic = abs(np.sign(steps).sum()) == len(steps)
        if crossed and monotonic and abs(angles[-1] - angles[0]) < 2.0 * np.pi:
            return angles, positions, speed
        # where C has reversed, step inwards only; a longer step could lead there
        inwards = np.sign(angles - angles[middle])
        step = np.divide(along, rate, out=inwards.copy(), where=~reversed_)
        angles = angles - np.clip(step, -0.1, 0.1)
    raise AssemblyError("the linkage does not close, or C reverses, while C is on the curve")


def wedge(u: Array, v: Array) -> Array:
    """Return the cross product of vectors in the plane, (n,) for (n, 2)."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _response(design: Looper, positions: Array, angles: Array) -> tuple[Array, Array]:
    """Return B, and the derivative of C by |B - O2|2 - c2 with the crank fixed, (n, 2) each.

    The coupler rotates about A until B is on its circle again.
    """
    pin = crank_pin(angles, design)
    to_c = positions - pin
    to_b = _rod(to_c, design)
    closed = 2.0 * wedge(to_b, pin + to_b - design.closed_form.pivot[:2, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.column_stack([to_c[:, 1], -to_c[:, 0]]) / closed[:, None]
    if not np.isfinite(moved).all():
        raise AssemblyError("coupler and rocker are collinear while C is on the curve")
    return pin + to_b, moved


def _path(design: Looper, angles: Array) -> tuple[Array, Array]:
    """Return positions of C, (n, 2) in [m], and their derivatives by the crank angle, (n, 2) in [m/rad]."""
    around = np.concatenate([angles, angles + STEP, angles - STEP])
    with np.errstate(invalid="ignore"):
        positions = design.closed_form.planar_point(around)[:, :2]
    current, ahead, behind = np.split(positions, 3)
    return current, (ahead - behind) / (2.0 * STEP)


def _rod(to_c: Array, base: Looper) -> Array:
    """Return AB from AC, (n, 2) each in [m]."""
    x, y = (to_c / base.arm).T
    cosine, sine = np.cos(base.arm_angle), np.sin(base.arm_angle)
    return base.coupler * np.column_stack([cosine * x + sine * y, cosine * y - sine * x])
