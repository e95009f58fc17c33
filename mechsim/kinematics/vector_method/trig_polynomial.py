"""Trigonometric polynomials of the crank angle: simple and double roots."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.mechanism.motion_laws import Arcs
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.jets import Values, cos_sin, values


def polynomial_roots(coefficients: NDArray[Any]) -> NDArray[np.complex128]:
    """Return the roots of polynomials (n, k + 1), lowest power first, (n, k); NaN without a leading term."""
    degree = coefficients.shape[1] - 1
    companion = np.zeros((len(coefficients), degree, degree), coefficients.dtype)
    companion[:, 1:, :-1] = np.eye(degree - 1)
    companion[:, :, -1] = -coefficients[:, :-1] / coefficients[:, -1:]
    missing = ~np.isfinite(companion[:, :, -1]).all(1)
    companion[missing] = 0.0
    roots = np.linalg.eigvals(companion).astype(np.complex128)
    roots[missing] = np.nan
    return roots


# size relative to the largest harmonic below which a polynomial is rounding of its lengths
ZERO_POLYNOMIAL = 256.0 * np.finfo(np.float64).eps
# distance of zeros of the complex polynomial from the unit circle up to which they are tried as real: of a
# simple zero, and of a zero of the derivative
CIRCLE_DISTANCE, EXTREMUM_DISTANCE = 1e-5, 1e-3
# derivative relative to the largest harmonic below which an angle is an extremum
FLAT_DERIVATIVE = 1e-9
# relative rounding error of an angle that may be a root
ROOT_ROUNDING = 4.0 * np.finfo(np.float64).eps


@dataclass(frozen=True)
class TrigPolynomial:
    """The real sum of harmonics_k exp(i k f) over k = -n .. n.

    Attributes:
        harmonics: (2 n + 1,); those of k and -k are conjugate.
    """

    harmonics: NDArray[np.complex128]

    @cached_property
    def order(self) -> Array:
        """The numbers k, (2 n + 1,)."""
        degree = len(self.harmonics) // 2
        return np.arange(-degree, degree + 1.0)

    @cached_property
    def scale(self) -> float:
        """Its largest harmonic."""
        return float(np.abs(self.harmonics).max())

    def value(self, angle: float, derivative: int = 0) -> float:
        """Return the value or a derivative at an angle."""
        terms = (1j * self.order) ** derivative * self.harmonics * np.exp(1j * self.order * angle)
        return float(terms.sum().real)

    def over(self, angle: Values) -> Any:
        """Return the values at angles, (n,), as jets for angles as jets."""
        degree = len(self.harmonics) // 2
        total: Any = 0.0 * angle + float(self.harmonics[degree].real)
        for k in range(1, degree + 1):
            c, s = cos_sin(k * angle)
            harmonic = 2.0 * self.harmonics[degree + k]
            total = total + c * float(harmonic.real) - s * float(harmonic.imag)
        return total

    def roots(self) -> list[float]:
        """Return the simple roots, increasing, in [-pi, pi)."""
        return sorted(_wrapped(self._polished(guess, 0)) for guess in self._zeros(0, CIRCLE_DISTANCE))

    @cached_property
    def touching(self) -> tuple[float, ...]:
        """The double roots to within rounding, increasing, in [-pi, pi)."""
        roots: list[float] = []
        for guess in self._zeros(1, EXTREMUM_DISTANCE):
            root = _wrapped(self._polished(guess, 1))
            flat = (
                abs(self.value(root)) <= ZERO_POLYNOMIAL * self.scale
                and abs(self.value(root, 1)) <= FLAT_DERIVATIVE * self.scale
            )
            duplicate = any(abs(_wrapped(root - other)) < np.sqrt(FLAT_DERIVATIVE) for other in roots)
            if flat and not duplicate and abs(self.value(root, 2)) > FLAT_DERIVATIVE * self.scale:
                roots.append(root)
        return tuple(sorted(roots))

    def without(self, touching: Sequence[float]) -> "TrigPolynomial":
        """Return the quotient by sin2((f - root) / 2) of each double root, of one degree less each."""
        harmonics = self.harmonics
        for root in touching:
            z = np.exp(1j * root)
            remaining, _ = np.polydiv(harmonics[::-1], np.array([1.0, -2.0 * z, z * z]))
            remaining = -4.0 * z * remaining[::-1]
            # restore the symmetry lost to rounding
            harmonics = 0.5 * (remaining + remaining[::-1].conj())
        return TrigPolynomial(harmonics)

    def _zeros(self, derivative: int, tolerance: float) -> Array:
        """Return angles of the zeros close to the unit circle of z^n times the polynomial, z = exp(i f)."""
        coefficients = (1j * self.order) ** derivative * self.harmonics
        zeros = np.roots(coefficients[::-1])
        return np.asarray(np.angle(zeros[np.abs(np.abs(zeros) - 1.0) < tolerance]), dtype=np.float64)

    def _polished(self, guess: float, derivative: int) -> float:
        angle = float(guess)
        for _ in range(8):
            derivative_value = self.value(angle, derivative + 1)
            if abs(derivative_value) <= FLAT_DERIVATIVE * self.scale:
                break
            step = min(max(self.value(angle, derivative) / derivative_value, -1e-2), 1e-2)
            angle -= step
            if abs(step) <= ROOT_ROUNDING:
                break
        return angle


@dataclass(frozen=True)
class SignedRoot:
    """The square root of a polynomial, with a sign change at each double root.

    Attributes:
        rest: the polynomial without its double roots.
        touching: double roots in [rad].
    """

    rest: TrigPolynomial
    touching: tuple[float, ...]

    def over(self, angle: Values) -> Any:
        """Return the root at angles, not wrapped, (n,), as a jet for a jet; NaN where it is not real.

        Accuracy: relative error of a few ulp, also near a double root.
        """
        roots = np.sqrt(self.rest.over(angle))
        for angle_of_root in self.touching:
            roots = roots * np.sin(0.5 * (angle - angle_of_root))
        return roots

    def folded(self, angle: Values) -> Any:
        """Return the root's absolute value at angles as `over`; at zeros, with the rates beyond them."""
        angles = values(angle)
        beyond = angles + ROOT_ROUNDING * (1.0 + np.abs(angles))
        signs = np.sign(np.sin(0.5 * np.subtract.outer(beyond, np.array(self.touching))))
        return self.over(angle) * signs.prod(-1)

    def sign(self, angle: float) -> float:
        """Return the root's sign at an angle."""
        return float(np.prod(np.sign(np.sin(0.5 * (angle - np.array(self.touching))))))


def sampled_polynomial(polynomial: Callable[[Array], Array], degree: int) -> TrigPolynomial:
    """Return a trigonometric polynomial from its function of angles (n,) in [rad]."""
    count = 2 * degree + 1
    harmonics = np.fft.fft(polynomial(REVOLUTION * np.arange(count) / count)) / count
    return TrigPolynomial(np.concatenate([harmonics[-degree:], harmonics[: degree + 1]]))


def signed_root(polynomial: TrigPolynomial) -> SignedRoot:
    """Return the square root that is smooth at double roots."""
    touching = polynomial.touching
    rest = polynomial.without(touching)
    kept = tuple(root for root in touching if rest.value(root) > 0.0)
    return SignedRoot(rest if kept == touching else polynomial.without(kept), kept)


def _wrapped(angle: float) -> float:
    return (angle + np.pi) % REVOLUTION - np.pi


def reachable_arcs(polynomial: TrigPolynomial) -> Arcs:
    """Return the intervals in which a trigonometric polynomial of the crank angle is positive.

    Accuracy: simple roots to a few ulp (refined by Newton's method on the polynomial itself); a double root,
        a change point, counts as no root.
    """
    rest = polynomial.without(polynomial.touching)
    ends = rest.roots()
    if not ends:
        full = rest.value(0.0) > 0.0
        return Arcs(full, ((-np.pi, np.pi),) if full else ())
    gaps = list(zip(ends, [*ends[1:], ends[0] + REVOLUTION], strict=True))
    return _joined(gaps, [rest.value((low + high) / 2.0) / rest.scale for low, high in gaps])


def _joined(gaps: list[tuple[float, float]], heights: list[float]) -> Arcs:
    """Return the intervals made of neighbouring gaps between roots, from the value of the polynomial in each.

    A double root appears as two with a gap of rounding in between, which gets the sign of its neighbours.
    """
    noise = [
        abs(height) <= ZERO_POLYNOMIAL and high - low < 1e-3
        for (low, high), height in zip(gaps, heights, strict=True)
    ]
    first = noise.index(False)
    order = [*range(first, len(gaps)), *range(first)]
    arcs: list[tuple[float, float]] = []
    inside = False
    for i in order:
        low, high = gaps[i]
        if i < first:
            low, high = low + REVOLUTION, high + REVOLUTION
        was, inside = inside, inside if noise[i] else heights[i] > 0.0
        if inside:
            low = arcs.pop()[0] if was else low
            arcs.append((low, high))
    if len(arcs) > 1 and arcs[-1][1] >= arcs[0][0] + REVOLUTION:
        arcs = [(arcs[-1][0], arcs[0][1] + REVOLUTION), *arcs[1:-1]]
    if len(arcs) == 1 and arcs[0][1] >= arcs[0][0] + REVOLUTION:
        return Arcs(True, ((-np.pi, np.pi),))
    wrapped = [(low - REVOLUTION, high - REVOLUTION) if low >= np.pi else (low, high) for low, high in arcs]
    return Arcs(False, tuple(sorted(wrapped)))
