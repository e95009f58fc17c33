"""Jets: a quantity with its first and second time derivative, propagated through formulas.

A position formula written with + - * / **, the ufuncs of `RULES` and the functions of
`mechsim.kinematics.vector_method.vectors` gives positions on plain arrays, and the motion on jets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array

# complex step: its square is lost in rounding relative to any real part
STEP = 2.0**-80


def stepped(value: Array, change: Array) -> Array:
    """Return values with changes as imaginary parts; `change_of` reads the changes of results."""
    complex_values: Any = value + 1j * STEP * change
    return complex_values


def change_of(value: Array) -> Array:
    """Return the derivative in the imaginary parts of values; zeros for real ones."""
    return np.imag(value) / STEP


def angle_of(sine: Array, cosine: Array) -> Array:
    """Return the angle of directions in (-pi, pi] rad as arctan2, also with complex steps."""
    if not np.iscomplexobj(sine) and not np.iscomplexobj(cosine):
        return np.arctan2(sine, cosine)
    x, y = np.real(cosine), np.real(sine)
    across = x * np.imag(sine) - y * np.imag(cosine)
    return _joined(np.arctan2(y, x), across / (x**2 + y**2))


def unwrapped_angles(angle: Array) -> Array:
    """Return angles without jumps of whole revolutions; their changes are kept."""
    return _joined(np.unwrap(np.real(angle)), np.imag(angle)) if np.iscomplexobj(angle) else np.unwrap(angle)


def size_of(value: Array) -> Array:
    """Return absolute values with the corresponding changes."""
    return np.where(np.real(value) < 0.0, -value, value) if np.iscomplexobj(value) else np.abs(value)


def stepped_sizes(value: Array) -> Array:
    """Return absolute values, and as changes those of the changes: sizes of terms that may cancel."""
    return np.abs(np.ascontiguousarray(value).view(np.float64)).view(value.dtype)


def stepped_least_norm(matrix: Array, right: Array, rcond: float) -> Array:
    """Return minimum-norm solutions of consistent equations, (n, m, k) and (n, m) -> (n, k).

    Args:
        matrix: matrices of any rank, which their changes preserve.
        right: right-hand sides.
        rcond: singular values below this fraction of the largest are zero.

    Source: G. Golub and V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares
    problems, SIAM Journal on Numerical Analysis 10 (1973) 413-432, for a residual of zero.
    """
    inverse = np.linalg.pinv(np.real(matrix), rcond=rcond)
    solution = inverse @ np.real(right)[..., None]
    if not np.iscomplexobj(matrix) and not np.iscomplexobj(right):
        return solution[..., 0]
    derivative = np.imag(matrix)
    moved = inverse @ (np.imag(right)[..., None] - derivative @ solution)
    aside = np.swapaxes(derivative, -1, -2) @ (np.swapaxes(inverse, -1, -2) @ solution)
    moved = moved + aside - inverse @ (np.real(matrix) @ aside)
    return _joined(solution[..., 0], moved[..., 0])


def stepped_null_space(matrix: Array, count: int, rcond: float) -> Array:
    """Return bases of the null spaces of matrices (n, m, k) of rank k - count, (n, k, count)."""
    right = np.linalg.svd(np.real(matrix), full_matrices=True)[2]
    basis = np.swapaxes(right[:, right.shape[1] - count :], -1, -2)
    if not np.iscomplexobj(matrix):
        return basis
    return _joined(basis, -np.linalg.pinv(np.real(matrix), rcond=rcond) @ (np.imag(matrix) @ basis))


def _joined(real: Array, imaginary: Array) -> Array:
    complex_values: Any = real + 1j * imaginary
    return complex_values


class Jet:
    """A quantity and its first two derivatives: arrays, real or complex, that broadcast, or jets of them."""

    __slots__ = ("rate", "second", "value")

    def __init__(self, value: Any, rate: Any, second: Any):
        self.value, self.rate, self.second = value, rate, second

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        rule = RULES.get(ufunc)
        return NotImplemented if rule is None or method != "__call__" or options else rule(*inputs)

    def __getitem__(self, index: Any) -> Jet:
        return Jet(self.value[index], self.rate[index], self.second[index])

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.rate, -self.second)

    def __add__(self, other: Values | complex) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.rate + other.rate, self.second + other.second)
        return Jet(self.value + other, self.rate, self.second)

    def __sub__(self, other: Values | complex) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.value - other.value, self.rate - other.rate, self.second - other.second)
        return Jet(self.value - other, self.rate, self.second)

    def __rsub__(self, other: Array | complex) -> Jet:
        return Jet(other - self.value, -self.rate, -self.second)

    def __mul__(self, other: Values | complex) -> Jet:
        if isinstance(other, Jet):
            a, b, c = self.value, self.rate, self.second
            u, v, w = other.value, other.rate, other.second
            if other is self:
                return Jet(a * a, 2.0 * (a * b), 2.0 * (a * c + b * b))
            return Jet(a * u, a * v + b * u, a * w + (2.0 * b) * v + c * u)
        return Jet(self.value * other, self.rate * other, self.second * other)

    def __truediv__(self, other: Values | complex) -> Jet:
        if isinstance(other, Jet):
            value = self.value / other.value
            rate = (self.rate - value * other.rate) / other.value
            second = (self.second - (2.0 * rate) * other.rate - value * other.second) / other.value
            return Jet(value, rate, second)
        return Jet(self.value / other, self.rate / other, self.second / other)

    def __rtruediv__(self, other: Array | complex) -> Jet:
        value = other / self.value
        rate = -value * self.rate / self.value
        return Jet(value, rate, -((2.0 * rate) * self.rate + value * self.second) / self.value)

    def __pow__(self, power: Values | float) -> Jet:
        return _power(self, power)

    def __rpow__(self, base: Array | float) -> Jet:
        return _power(base, self)

    __radd__, __rmul__ = __add__, __mul__

    def __abs__(self) -> Jet:
        return np.sqrt(self.real * self.real + self.imag * self.imag)

    @property
    def real(self) -> Jet:
        """The real part of a complex jet."""
        return Jet(self.value.real, self.rate.real, self.second.real)

    @property
    def imag(self) -> Jet:
        """The imaginary part of a complex jet."""
        return Jet(self.value.imag, self.rate.imag, self.second.imag)

    def conjugate(self) -> Jet:
        """Return the complex conjugate."""
        return Jet(self.value.conjugate(), self.rate.conjugate(), self.second.conjugate())


Values = Array | Jet


def values(x: Values) -> Array:
    """Return the quantity without its derivatives."""
    return x.value if isinstance(x, Jet) else x


def jet_product(multiply: Callable[[Array, Array], Array], a: Values, b: Values) -> Any:
    """Return a bilinear product of arrays or jets, such as a scalar or vector product."""
    if not isinstance(a, Jet):
        if not isinstance(b, Jet):
            return multiply(a, b)
        return Jet(multiply(a, b.value), multiply(a, b.rate), multiply(a, b.second))
    if not isinstance(b, Jet):
        return Jet(multiply(a.value, b), multiply(a.rate, b), multiply(a.second, b))
    if a is b:
        return Jet(
            multiply(a.value, a.value),
            2.0 * multiply(a.value, a.rate),
            2.0 * (multiply(a.value, a.second) + multiply(a.rate, a.rate)),
        )
    return Jet(
        multiply(a.value, b.value),
        multiply(a.value, b.rate) + multiply(a.rate, b.value),
        multiply(a.value, b.second) + 2.0 * multiply(a.rate, b.rate) + multiply(a.second, b.value),
    )


def cos_sin(angle: Values) -> tuple[Any, Any]:
    """Return cosine and sine of angles in [rad]."""
    c, s = np.cos(values(angle)), np.sin(values(angle))
    return (composed(angle, c, -s, -c), composed(angle, s, c, -s)) if isinstance(angle, Jet) else (c, s)


def with_value(x: Values, value: Array) -> Any:
    """Return the quantity with another value, such as one without rounding, and the same derivatives."""
    return Jet(value, x.rate, x.second) if isinstance(x, Jet) else value


def jet_where(which: NDArray[np.bool_], first: Values, second: Values) -> Any:
    """Return the first quantity where a condition holds, (n,), else the second."""
    if isinstance(first, Jet) and isinstance(second, Jet):
        fields = ((getattr(x, field) for x in (first, second)) for field in ("value", "rate", "second"))
        return Jet(*(jet_where(which, a, b) for a, b in fields))
    return np.where(which, values(first), values(second))


def constant_jet(value: Array) -> Jet:
    """Return a constant as a jet."""
    return Jet(value, np.zeros_like(value), np.zeros_like(value))


def jet_root(residual: Callable[[Jet], Jet], solution: Array, derivative: Array) -> Jet:
    """Return a numerical root as a jet, by two Newton steps in jets, one per derivative.

    Args:
        residual: equation of the root, in jets.
        solution: the root, (n,).
        derivative: derivative of the residual by the root, (n,).
    """
    jet = constant_jet(solution)
    for _ in range(2):
        jet = jet - residual(jet) / derivative
    return with_value(jet, solution)


def composed(x: Jet, value: Array, derivative: Array, second_derivative: Array) -> Jet:
    """Return a function of a jet from the function's value and first two derivatives, (n,) each."""
    return Jet(value, derivative * x.rate, derivative * x.second + second_derivative * (x.rate * x.rate))


def _sqrt(x: Jet) -> Jet:
    value = np.sqrt(x.value)
    over = 0.5 / value
    rate = x.rate * over
    return Jet(value, rate, x.second * over - rate * rate / value)


def _exp(x: Jet) -> Jet:
    value = np.exp(x.value)
    return composed(x, value, value, value)


def _arctan2(y: Jet, x: Jet) -> Jet:
    """The derivative is (x y' - y x') / r2 with r2 = x2 + y2; the second follows from this quotient."""
    r2 = x.value * x.value + y.value * y.value
    rate = (x.value * y.rate - y.value * x.rate) / r2
    second = x.value * y.second - y.value * x.second - 2.0 * rate * (x.value * x.rate + y.value * y.rate)
    return Jet(angle_of(y.value, x.value), rate, second / r2)


def _log(x: Jet) -> Jet:
    return composed(x, np.log(x.value), 1.0 / x.value, -1.0 / x.value**2)


def _tan(x: Jet) -> Jet:
    value = np.tan(x.value)
    derivative = 1.0 + value**2
    return composed(x, value, derivative, 2.0 * value * derivative)


def _arcsin(x: Jet) -> Jet:
    derivative = 1.0 / np.sqrt(1.0 - x.value**2)
    return composed(x, np.arcsin(x.value), derivative, x.value * derivative**3)


def _arctan(x: Jet) -> Jet:
    derivative = 1.0 / (1.0 + x.value**2)
    return composed(x, np.arctan(x.value), derivative, -2.0 * x.value * derivative**2)


def _power(base: Any, exponent: Any) -> Jet:
    """Return base ** exponent; with a constant exponent also for a base that is not positive."""
    if isinstance(exponent, Jet):
        return np.exp(exponent * np.log(base))  # pyright: ignore[reportReturnType, reportCallIssue, reportArgumentType]
    if np.ndim(exponent) == 0 and exponent == 2:
        return base * base
    if not isinstance(base.value, np.ndarray | np.generic):
        # jets of jets, or of balls
        nested, whole = base.value, float(exponent)
        first, second = (
            factor * nested**power if factor and power else factor + 0.0 * nested
            for factor, power in ((whole, whole - 1.0), (whole * (whole - 1.0), whole - 2.0))
        )
        return composed(base, nested**whole, first, second)
    x: Any = base.value
    n = np.asarray(exponent, dtype=np.float64)
    first = np.where(n == 0.0, 0.0, n * x ** (n - 1.0))
    second = np.where(n * (n - 1.0) == 0.0, 0.0, n * (n - 1.0) * x ** (n - 2.0))
    return composed(base, x**n, first, second)


RULES: dict[np.ufunc, Callable[..., Jet]] = {
    np.add: lambda a, b: b + a,
    np.subtract: lambda a, b: b.__rsub__(a),
    np.multiply: lambda a, b: b * a,
    np.true_divide: lambda a, b: b.__rtruediv__(a),
    np.sqrt: _sqrt,
    np.sin: lambda x: cos_sin(x)[1],
    np.cos: lambda x: cos_sin(x)[0],
    np.exp: _exp,
    np.log: _log,
    np.tan: _tan,
    np.arcsin: _arcsin,
    np.arccos: lambda x: 0.5 * np.pi - _arcsin(x),
    np.arctan: _arctan,
    np.power: _power,
    np.arctan2: _arctan2,
}
