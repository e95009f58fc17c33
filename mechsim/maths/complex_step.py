"""Complex steps: a tiny imaginary part carries a derivative through arithmetic, without taking a difference.

Source: W. Squire and G. Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review
40 (1998) 110-112.
"""

from typing import Any

import numpy as np

from mechsim.maths.arrays import Array

# the imaginary part of a change of one: its square is lost beside any real part
STEP = 2.0**-80


def stepped(value: Array, change: Array) -> Array:
    """Return values with changes as imaginary parts; what is reckoned from them changes by `change_of`."""
    found: Any = value + 1j * STEP * change
    return found


def change_of(value: Array) -> Array:
    """Return the derivative that values carry; zeros for real ones."""
    return np.imag(value) / STEP


def turn_of(sine: Array, cosine: Array) -> Array:
    """Return the angle of directions in (-pi, pi] rad, as arctan2 does, of complex steps too."""
    if not np.iscomplexobj(sine) and not np.iscomplexobj(cosine):
        return np.arctan2(sine, cosine)
    x, y = np.real(cosine), np.real(sine)
    across = x * np.imag(sine) - y * np.imag(cosine)
    return _joined(np.arctan2(y, x), across / (x**2 + y**2))


def unwrapped(angle: Array) -> Array:
    """Return angles without jumps of whole turns; changes as they are."""
    return _joined(np.unwrap(np.real(angle)), np.imag(angle)) if np.iscomplexobj(angle) else np.unwrap(angle)


def _joined(real: Array, imaginary: Array) -> Array:
    found: Any = real + 1j * imaginary
    return found
