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
