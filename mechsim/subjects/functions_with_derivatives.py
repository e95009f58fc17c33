"""Elementary functions of jets and numbers: values with exact first and second derivatives."""

import math

import numpy as np

from mechsim.analytic.vector_method.jets import Jet, Values, composed
from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.subjects.expressions import require_exponent


def power(base: Values, exponent: Values) -> Values:
    """Return base ** exponent; of a constant exponent also where the base is not above zero."""
    if isinstance(exponent, Jet):
        return np.exp(exponent * log(base))  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]
    n = float(exponent)
    require_exponent(n)
    if not isinstance(base, Jet):
        return math.pow(float(base), n)  # pyright: ignore[reportReturnType]
    x = base.value
    first = n * x ** (n - 1.0) if n else np.zeros_like(x)
    second = n * (n - 1.0) * x ** (n - 2.0) if n * (n - 1.0) else np.zeros_like(x)
    return composed(base, x**n, first, second)


def log(x: Values) -> Values:
    """Return the natural logarithm."""
    if not isinstance(x, Jet):
        return np.log(x)
    return composed(x, np.log(x.value), 1.0 / x.value, -1.0 / x.value**2)


def tan(x: Values) -> Values:
    """Return the tangent of angles in [rad]."""
    if not isinstance(x, Jet):
        return np.tan(x)
    value = np.tan(x.value)
    derivative = 1.0 + value**2
    return composed(x, value, derivative, 2.0 * value * derivative)


def asin(x: Values) -> Values:
    """Return the angle of a sine in [rad]."""
    if not isinstance(x, Jet):
        return np.arcsin(x)
    derivative = 1.0 / np.sqrt(1.0 - x.value**2)
    return composed(x, np.arcsin(x.value), derivative, x.value * derivative**3)


def acos(x: Values) -> Values:
    """Return the angle of a cosine in [rad]."""
    return 0.5 * np.pi - asin(x)  # pyright: ignore[reportOperatorIssue]


def atan(x: Values) -> Values:
    """Return the angle of a tangent in [rad]."""
    if not isinstance(x, Jet):
        return np.arctan(x)
    derivative = 1.0 / (1.0 + x.value**2)
    return composed(x, np.arctan(x.value), derivative, -2.0 * x.value * derivative**2)


def atan2(y: Values, x: Values) -> Values:
    """Return the angle of a direction in [rad]."""
    if not isinstance(y, Jet) and not isinstance(x, Jet):
        return np.arctan2(y, x)
    return np.arctan2(_jet(y, x), _jet(x, y))  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]


def absolute(x: Values) -> Values:
    """Return the value without its sign."""
    return x * np.sign(x.value) if isinstance(x, Jet) else np.abs(x)


def minimum(values: list[Values], sign: float = 1.0) -> Values:
    """Return the least of some values at each instant; with sense -1 the largest."""
    result = values[0]
    for other in values[1:]:
        if not isinstance(result, Jet) and not isinstance(other, Jet):
            result = np.minimum(result, other) if sign > 0.0 else np.maximum(result, other)
            continue
        current, candidate = _jet(result, other), _jet(other, result)
        first = sign * (current.value - candidate.value) <= 0.0
        fields = [
            np.where(first, getattr(current, field), getattr(candidate, field)) for field in Jet.__slots__
        ]
        result = Jet(**dict(zip(Jet.__slots__, fields, strict=True)))
    return result


def _jet(x: Values, like: Values) -> Jet:
    """Return a jet, of what is none one that does not change."""
    if isinstance(x, Jet):
        return x
    if not isinstance(like, Jet):
        raise InputError("holds no t; write an expression of t in s")
    still: Array = np.zeros_like(like.value)
    return Jet(still + x, still, still)
