"""Interval arithmetic on arrays: balls of a midpoint and a radius, rounded outward.

A ball represents all numbers within the radius of the midpoint. Each operation returns a ball that contains
the exact results for all numbers of its operands. The midpoint is computed in ordinary floating point; the
radius bounds the spread of the operands and the rounding error (Rump, Fast and parallel interval arithmetic,
BIT 39, 1999). Sine and cosine come from Taylor polynomials with a bounded remainder, because numpy states no
error bound for its own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim.numerics.arrays import Array

# unit roundoff of IEEE double precision: relative error of one rounding to nearest
ROUNDOFF = 2.0**-53
# factor that exceeds the rounding errors in the sums and products of nonnegative numbers that form a radius
OUTWARD = 1.0 + 2.0**-45
# exceeds the errors of operations that underflow, at most 2**-1074 each
UNDERFLOW = 1e-300
# pi/2 as a sum: the first two terms have 33 bits, so that products with integers below 2**20 are exact; and a
# bound of the remainder
HALF_PI = (float.fromhex("0x1.921fb544p+0"), float.fromhex("0x1.0b4611a6p-34"))
HALF_PI_REST, HALF_PI_ERROR = float.fromhex("0x1.3198a2e037073p-69"), 1e-36
# largest angle in [rad] whose sine and cosine are computed
MAX_ANGLE = 1e6
# terms of the Taylor polynomials of sine and cosine, and a bound of their error on |x| < 0.79: the term of
# x^(2k) has at most 4k + 3 roundings, so that the sum has an error of 3 + 7/3.2 + 11/61 + ... < 5.4
# roundoffs; the remainder is below 0.79^20/20! < 1e-20
TERMS, SERIES_ERROR = 10, 6.0 * ROUNDOFF
# natural logarithm of 2, rounded, and a bound of its error
LOG_2, LOG_2_ERROR = float.fromhex("0x1.62e42fefa39efp-1"), 3e-17
# largest magnitude of an exponent of e, and a bound of e to the power of less than minus that
MAX_EXPONENT, VANISHED = 680.0, 1e-295
# terms of the Taylor polynomial of the exponential on |x| < 0.35, and a bound of the remainder relative to
# the last term: the sum of 0.35^k 15!/(15 + k)!, k from 1
EXP_TERMS, EXP_REMAINDER = 15, 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Ball:
    """An array of balls.

    Attributes:
        mid: midpoints, any shape.
        rad: radii, of the same shape or broadcast to it; nonnegative. NaN and infinity mean no bound.
    """

    mid: Array
    rad: Array

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        rule = RULES.get(ufunc)
        return NotImplemented if rule is None or method != "__call__" or options else rule(*inputs)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.mid.shape

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return self.mid.ndim

    @property
    def T(self) -> "Ball":  # noqa: N802 (the name numpy uses)
        """The balls with the last two axes exchanged."""
        return Ball(self.mid.swapaxes(-1, -2), self.rad.swapaxes(-1, -2))

    def any(self, axis: None = None, out: None = None) -> bool:
        """Return whether a ball holds a number other than zero, for `np.any`."""
        return bool(np.any(self.mid) or np.any(self.rad))

    @property
    def magnitude(self) -> Array:
        """Upper bounds of the absolute values."""
        return (np.abs(self.mid) + self.rad) * OUTWARD

    @staticmethod
    def joined(balls: "list[Ball]", axis: int) -> "Ball":
        """Return matrices of balls joined along axis -1 or -2; other axes broadcast."""
        leading = np.broadcast_shapes(*(item.shape[:-2] for item in balls))
        mids, rads = (
            [np.broadcast_to(values, (*leading, *item.shape[-2:])) for item, values in columns]
            for columns in ([(p, p.mid) for p in balls], [(p, p.rad) for p in balls])
        )
        return Ball(np.concatenate(mids, axis), np.concatenate(rads, axis))

    def __getitem__(self, index: Any) -> "Ball":
        return Ball(self.mid[index], self.rad[index])

    def __neg__(self) -> "Ball":
        return Ball(-self.mid, self.rad)

    def __add__(self, other: "Ball | ArrayLike") -> "Ball":
        if isinstance(other, DualBall):
            return NotImplemented
        other = ball(other)
        mid = self.mid + other.mid
        return Ball(mid, (self.rad + other.rad + ROUNDOFF * np.abs(mid)) * OUTWARD)

    def __sub__(self, other: "Ball | ArrayLike") -> "Ball":
        return NotImplemented if isinstance(other, DualBall) else self + -ball(other)

    def __mul__(self, other: "Ball | ArrayLike") -> "Ball":
        if isinstance(other, DualBall):
            return NotImplemented
        other = ball(other)
        mid = self.mid * other.mid
        spread = np.abs(self.mid) * other.rad + self.rad * (np.abs(other.mid) + other.rad)
        return Ball(mid, (spread + ROUNDOFF * np.abs(mid)) * OUTWARD + UNDERFLOW)

    def __matmul__(self, other: "Ball | ArrayLike") -> "Ball":
        if isinstance(other, DualBall):
            return NotImplemented
        other = ball(other)
        # a sum of k products has an error of at most k roundoffs of the sum of their absolute values
        relative = (self.mid.shape[-1] + 2) * ROUNDOFF
        magnitude = np.abs(other.mid)
        spread = _product(np.abs(self.mid), other.rad + relative * magnitude)
        spread += _product(self.rad, magnitude + other.rad)
        return Ball(_product(self.mid, other.mid), spread * OUTWARD + UNDERFLOW)

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: ArrayLike) -> "Ball":
        return ball(other) - self

    def __truediv__(self, other: "Ball | ArrayLike") -> "Ball":
        return self * ball(other).reciprocal()

    def __rtruediv__(self, other: ArrayLike) -> "Ball":
        return ball(other) * self.reciprocal()

    def __pow__(self, exponent: float) -> "Ball":
        """Return the balls of a power; the exponent is a whole number or a half, not zero."""
        if exponent < 0.0:
            return (self**-exponent).reciprocal()
        if exponent % 1.0 == 0.5:
            return self.sqrt() if exponent == 0.5 else self ** (exponent - 0.5) * self.sqrt()
        if exponent != int(exponent) or exponent < 1.0:
            raise TypeError(f"balls have no bound for the power {exponent}")
        power = self
        for _ in range(int(exponent) - 1):
            power = power * self
        return power

    def reciprocal(self) -> "Ball":
        """Return the balls of 1/x; no bound for a ball that contains zero."""
        magnitude = np.abs(self.mid)
        nearest = (magnitude - self.rad) / OUTWARD
        apart = nearest > 0.0
        safe = np.where(apart, nearest, 1.0)
        mid = 1.0 / np.where(apart, self.mid, 1.0)
        # one division after another: the product may overflow
        spread = self.rad / safe / np.where(apart, magnitude, 1.0) + ROUNDOFF * np.abs(mid)
        return Ball(mid, np.where(apart, spread * OUTWARD + UNDERFLOW, np.inf))

    def sqrt(self) -> "Ball":
        """Return the balls of the square root; no bound for a ball that contains zero or less."""
        nearest = (self.mid - self.rad) / OUTWARD
        apart = nearest > 0.0
        safe = np.where(apart, nearest, 1.0)
        mid = np.sqrt(np.where(apart, self.mid, 1.0))
        spread = self.rad / np.sqrt(safe) + 2.0 * ROUNDOFF * mid
        return Ball(mid, np.where(apart, spread * OUTWARD + UNDERFLOW, np.inf))

    def sin_cos(self) -> tuple["Ball", "Ball"]:
        """Return the balls of sine and cosine; beyond `MAX_ANGLE` those of every angle."""
        bounded = np.abs(self.mid) < MAX_ANGLE
        mid = np.where(bounded, self.mid, 0.0)
        quadrant = np.rint(mid / (HALF_PI[0] + HALF_PI[1]))
        reduced = ball(mid) - quadrant * HALF_PI[0] - quadrant * HALF_PI[1]
        reduced = reduced - Ball(np.array(HALF_PI_REST), np.array(HALF_PI_ERROR)) * quadrant
        x = reduced.mid
        sine, cosine = ball(x * _series(x * x, 1)), ball(_series(x * x, 0))
        turns = quadrant.astype(np.int64) % 4
        odd = turns % 2 == 1
        sine, cosine = where(odd, cosine, sine), where(odd, sine, cosine)
        sine, cosine = where(turns >= 2, -sine, sine), where((turns == 1) | (turns == 2), -cosine, cosine)
        rad = np.where(bounded, self.rad + reduced.rad, np.inf) * OUTWARD
        return _spread(sine, cosine, rad), _spread(cosine, sine, rad)


def _product(a: Array, b: Array) -> Array:
    """Return a b; many matrices times one are one product of their joined rows, not many small ones."""
    if a.ndim > 2 and b.ndim == 2:
        return (a.reshape(-1, a.shape[-1]) @ b).reshape(*a.shape[:-1], b.shape[-1])
    if a.ndim == 2 and b.ndim > 2:
        return _product(b.swapaxes(-1, -2), a.T).swapaxes(-1, -2)
    return a @ b


@dataclass(frozen=True, slots=True, eq=False)
class DualBall:
    """An array of balls with their derivatives by d variables.

    Attributes:
        value: the balls, any shape.
        derivative: of the balls, (d, *shape) or broadcast to it.
    """

    value: Ball
    derivative: Ball

    __array_ufunc__ = None

    @property
    def T(self) -> "DualBall":  # noqa: N802
        """The balls with the last two axes exchanged."""
        return DualBall(self.value.T, self.derivative.T)

    @staticmethod
    def joined(balls: "list[DualBall | Ball]", axis: int) -> "DualBall":
        """Return matrices joined along axis -1 or -2; balls without derivatives are constants."""
        count = max(len(item.derivative.mid) for item in balls if isinstance(item, DualBall))
        derivatives = [
            item.derivative if isinstance(item, DualBall) else ball(np.zeros((count, *item.shape)))
            for item in balls
        ]
        values = [item.value if isinstance(item, DualBall) else item for item in balls]
        return DualBall(Ball.joined(values, axis), Ball.joined(derivatives, axis))

    def __getitem__(self, index: Any) -> "DualBall":
        return DualBall(self.value[index], self.derivative[index])

    def __neg__(self) -> "DualBall":
        return DualBall(-self.value, -self.derivative)

    def __add__(self, other: "DualBall | Ball | ArrayLike") -> "DualBall":
        if isinstance(other, DualBall):
            return DualBall(self.value + other.value, self.derivative + other.derivative)
        value = self.value + other
        return DualBall(value, self.derivative + np.zeros(value.shape))

    def __sub__(self, other: "DualBall | Ball | ArrayLike") -> "DualBall":
        return self + -(other if isinstance(other, DualBall) else ball(other))

    def __rsub__(self, other: "Ball | ArrayLike") -> "DualBall":
        return -self + other

    def __mul__(self, other: "DualBall | Ball | ArrayLike") -> "DualBall":
        if isinstance(other, DualBall):
            derivative = self.derivative * other.value + other.derivative * self.value
            return DualBall(self.value * other.value, derivative)
        return DualBall(self.value * other, self.derivative * other)

    __radd__, __rmul__ = __add__, __mul__

    def __matmul__(self, other: "DualBall | Ball | ArrayLike") -> "DualBall":
        if isinstance(other, DualBall):
            derivative = self.derivative @ other.value + self.value @ other.derivative
            return DualBall(self.value @ other.value, derivative)
        return DualBall(self.value @ other, self.derivative @ other)

    def __rmatmul__(self, other: "Ball | ArrayLike") -> "DualBall":
        return DualBall(ball(other) @ self.value, ball(other) @ self.derivative)

    def reciprocal(self) -> "DualBall":
        """Return 1/x; no bound for a ball that contains zero."""
        value = self.value.reciprocal()
        return DualBall(value, -(value * value) * self.derivative)

    def sin_cos(self) -> "tuple[DualBall, DualBall]":
        """Return sine and cosine."""
        sine, cosine = self.value.sin_cos()
        return DualBall(sine, cosine * self.derivative), DualBall(cosine, -sine * self.derivative)


def ball(values: "Ball | ArrayLike") -> Ball:
    """Return balls; numbers become balls of radius zero."""
    if isinstance(values, Ball):
        return values
    mid = np.asarray(values, dtype=np.float64)
    return Ball(mid, np.zeros_like(mid))


def where(condition: Any, first: Ball, second: Ball) -> Ball:
    """Return the first balls where a condition holds, else the second."""
    return Ball(np.where(condition, first.mid, second.mid), np.where(condition, first.rad, second.rad))


def _exp(exponent: Ball) -> Ball:
    """Return the balls of the exponential; no bound beyond `MAX_EXPONENT` and for radii above 1/2."""
    bounded = (np.abs(exponent.mid) < MAX_EXPONENT) & (exponent.rad < 0.5)
    vanishing = exponent.mid * (1.0 - ROUNDOFF) + exponent.rad * OUTWARD < -MAX_EXPONENT
    mid = np.where(bounded, exponent.mid, 0.0)
    power = np.rint(mid / LOG_2)
    x = ball(mid) - Ball(np.array(LOG_2), np.array(LOG_2_ERROR)) * power
    total = Ball(np.ones(mid.shape), np.full(mid.shape, EXP_REMAINDER))
    for k in range(EXP_TERMS, 0, -1):
        total = total * x * ball(float(k)).reciprocal() + 1.0
    # exp(rad) - 1 is below 2 rad for radii below 1/2
    spread = total.magnitude * 2.0 * exponent.rad
    scale = np.ldexp(1.0, power.astype(np.int64))
    rad = (total.rad + spread) * scale * OUTWARD + UNDERFLOW
    exponential = where(bounded, Ball(total.mid * scale, rad), Ball(np.zeros(mid.shape), np.array(np.inf)))
    return where(vanishing, Ball(np.zeros(mid.shape), np.array(VANISHED)), exponential)


# implementations of numpy's functions for balls; other functions raise TypeError
RULES: dict[np.ufunc, Callable[..., Any]] = {
    np.add: lambda a, b: b + a,
    np.subtract: lambda a, b: ball(a) - b,
    np.multiply: lambda a, b: b * a,
    np.true_divide: lambda a, b: ball(a) / b,
    np.matmul: lambda a, b: ball(a) @ b,
    np.negative: lambda a: -a,
    np.sqrt: Ball.sqrt,
    np.exp: _exp,
    np.sin: lambda a: a.sin_cos()[0],
    np.cos: lambda a: a.sin_cos()[1],
    np.tan: lambda a: a.sin_cos()[0] / a.sin_cos()[1],
}


def _series(square: Array, first: int) -> Array:
    """Return sum (-1)^k x^(2k) / (2k + first)!: cosine, or sine without a factor x; error `SERIES_ERROR`."""
    total = np.ones(square.shape)
    for k in reversed(range(TERMS - 1)):
        total = 1.0 - square * total / ((2.0 * k + 1.0 + first) * (2.0 * k + 2.0 + first))
    return total


def _spread(value: Ball, derivative: Ball, rad: Array) -> Ball:
    """Return a sine or cosine of balls of this radius from those of the midpoints; neither exceeds 1."""
    spread = np.minimum(rad * (np.abs(derivative.mid) + SERIES_ERROR + rad), 2.0)
    return Ball(value.mid, (SERIES_ERROR + spread) * OUTWARD)
