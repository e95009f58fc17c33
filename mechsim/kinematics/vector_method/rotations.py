"""Products of vectors, stored as (..., 3), and rotation matrices, (..., 3, 3), and small rotations."""

from __future__ import annotations

from typing import Any

import numpy as np

from mechsim.numerics.arrays import Array

# elements of a rotation below this count as zero; their squares would underflow later
ZERO = 1e-40


def skew(v: Array) -> Array:
    """Return the matrices of v x, (..., 3) -> (..., 3, 3)."""
    out = np.zeros((*v.shape, 3), v.dtype)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def dot(a: Array, b: Array) -> Array:
    """Return scalar products, (..., 3) and (..., 3) -> (...)."""
    return (a * b).sum(-1)


def from_quaternion(w: Any, x: Any, y: Any, z: Any) -> Array:
    """Return the rotation matrices, (3, 3, ...), of unit quaternions with components (...), also symbols."""
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


# least 1 + trace of a rotation: at half a revolution, where the rotation vector jumps, it is zero
LEAST_TRACE = 1e-12
# squared tangent of a half angle below which a series is exact to rounding
SMALL = 1e-3


def rotation_vector(rotation: Array) -> tuple[Array, Array]:
    """Return rotation vectors v, (n, 3), and c, (n,), of J^-1 = 1 - [v]/2 + c [v]^2, with exp[v] = rotation.

    With p = v tan(|v|/2)/|v| (Gibbs' vector) and h = (1 - atan|p|/|p|)/p^2, v = 2 (1 - h p^2) p,
    |v| < pi. Complex steps are propagated.
    """
    total = 1.0 + np.trace(rotation, axis1=-2, axis2=-1)
    total = np.where(np.real(total) > LEAST_TRACE, total, LEAST_TRACE)
    axial = rotation[..., (2, 0, 1), (1, 2, 0)] - rotation[..., (1, 2, 0), (2, 0, 1)]
    p = axial / total[..., None]
    square = dot(p, p)
    small = np.real(square) < SMALL
    tangent = np.sqrt(np.where(small, 1.0, square))
    series = sum((-square) ** k / (2 * k + 3) for k in range(6))
    h = np.where(small, series, (1.0 - np.arctan(tangent) / tangent) / tangent**2)
    k = 1.0 - h * square
    return 2.0 * k[..., None] * p, 0.25 * h / k**2


def turned_by(rotation: Array, vector: Array) -> Array:
    """Return exp(vector) @ rotation, (n, 3, 3), orthonormal to rounding."""
    angle = np.sqrt(dot(vector, vector))[:, None, None]
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    k = skew(vector)
    a = np.where(small, 1.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, (1.0 - np.cos(safe)) / safe**2)
    rotated = (np.eye(3) + a * k + b * (k @ k)) @ rotation
    # a Newton step towards the nearest rotation keeps the columns orthonormal to an ulp
    rotated = rotated @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(rotated, -1, -2) @ rotated)
    return np.where(np.abs(rotated) < ZERO, 0.0, rotated)
