"""Functions of time by their Taylor coefficients, which are worked out when they are asked for.

A series that depends on its own integral, as a solution of a differential equation does, is worked out order
by order: coefficient k + 1 of a state is coefficient k of its rate over k + 1. Coefficients are Decimals,
several times as fast here as numbers of mpmath.
"""

from collections.abc import Callable, Sequence
from decimal import Decimal
from operator import mul
from typing import Any

import numpy as np
from mpmath import mp, mpf

GUARD = 5  # digits beyond the working precision


def decimal(number: Any) -> Decimal:
    """Return a number of mpmath or an integer as a Decimal."""
    return number if isinstance(number, int | Decimal) else Decimal(mp.nstr(number, mp.dps + GUARD))


class Series:
    """A function of time; `terms[k]` is its coefficient of t**k, as far as it is known."""

    def __init__(self, term: Callable[[int], Any]) -> None:
        self.terms: list[Any] = []
        self.term = term

    def coefficient(self, k: int) -> Any:
        """Return the coefficient of t**k."""
        while len(self.terms) <= k:
            self.terms.append(self.term(len(self.terms)))
        return self.terms[k]

    def value(self, t: Any, order: int) -> Any:
        """Return the value at a time."""
        total, time = Decimal(0), decimal(t)
        for k in range(order, -1, -1):
            total = total * time + self.coefficient(k)
        return mpf(str(total))

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Series):
            return Series(lambda k: self.coefficient(k) + other.coefficient(k))
        if other == 0:
            return self
        constant = decimal(other)
        return Series(lambda k: self.coefficient(k) + (constant if k == 0 else 0))

    __radd__ = __add__

    def __neg__(self) -> Any:
        return Series(lambda k: -self.coefficient(k))

    def __sub__(self, other: Any) -> Any:
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Series):
            return Series(lambda k: product(self, other, k, 0))
        if other == 0:
            return 0
        constant = decimal(other)
        return Series(lambda k: constant * self.coefficient(k))

    __rmul__ = __mul__

    def __pow__(self, power: Any) -> Any:
        """Return a power: x y' = power x' y, with y = x**power."""
        power = Decimal(power)

        def term(k: int) -> Any:
            if k == 0:
                return self.coefficient(0) ** power
            weighted = [(i * (power + 1) - k) * self.coefficient(i) for i in range(1, k + 1)]
            return sum(map(mul, weighted, (result.coefficient(k - i) for i in range(1, k + 1)))) / (
                k * self.coefficient(0)
            )

        result = Series(term)
        return result


def product(a: Series, b: Series, k: int, first: int) -> Any:
    """Return the sum of a_i b_(k - i) from i = `first` to k."""
    a.coefficient(k)
    b.coefficient(k - first)
    return sum(map(mul, a.terms[first : k + 1], b.terms[k - first :: -1]))


def integral(start: Any, rate: Callable[[], Any]) -> Series:
    """Return the series of a state; `rate` returns the series of its rate, or a number."""

    def term(k: int) -> Any:
        if k == 0:
            return decimal(start)
        rate_series = rate()
        return (
            rate_series.coefficient(k - 1) / k
            if isinstance(rate_series, Series)
            else decimal(rate_series if k == 1 else 0)
        )

    return Series(term)


def solution(matrix: Any, right: Any) -> list[Series]:
    """Return the series of x with matrix x = right, a regular matrix of series and numbers."""
    varying = [[(j, item) for j, item in enumerate(row) if isinstance(item, Series)] for row in matrix]
    factors, order_of_rows = factored([[coefficient_of(item, 0) for item in row] for row in matrix])
    solutions: list[list[Decimal]] = []

    def term(k: int) -> list[Decimal]:
        while len(solutions) <= k:
            order = len(solutions)
            left = [
                coefficient_of(item, order)
                - sum(product(entry, unknown[j], order, 1) for j, entry in row if order)
                for item, row in zip(right, varying, strict=True)
            ]
            solutions.append(substituted(factors, [left[i] for i in order_of_rows]))
        return solutions[k]

    unknown = [Series(lambda k, j=j: term(k)[j]) for j in range(len(matrix))]
    return unknown


def factored(rows: list[list[Decimal]]) -> tuple[list[list[Decimal]], list[int]]:
    """Return the triangular factors of a matrix in one, and the order of its rows; Gauss with pivots."""
    count, order = len(rows), list(range(len(rows)))
    for k in range(count):
        pivot = max(range(k, count), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot], order[k], order[pivot] = rows[pivot], rows[k], order[pivot], order[k]
        for row in rows[k + 1 :]:
            if row[k]:
                row[k] /= rows[k][k]
                row[k + 1 :] = [a - row[k] * b for a, b in zip(row[k + 1 :], rows[k][k + 1 :], strict=True)]
    return rows, order


def substituted(factors: list[list[Decimal]], right: Sequence[Any]) -> list[Decimal]:
    """Return the solution by triangular factors."""
    answer = list(right)
    for i, row in enumerate(factors):
        answer[i] -= sum(map(mul, row[:i], answer[:i]))
    for i in reversed(range(len(answer))):
        answer[i] = (answer[i] - sum(map(mul, factors[i][i + 1 :], answer[i + 1 :]))) / factors[i][i]
    return answer


def coefficient_of(item: Any, k: int) -> Decimal:
    """Return the coefficient of t**k of a series or a number."""
    if isinstance(item, Series):
        return item.coefficient(k)
    return Decimal(decimal(item)) if k == 0 else Decimal(0)


def values(items: Sequence[Any], t: Any, order: int) -> Any:
    """Return an array of numbers, from one of series and numbers, at a time."""
    array = np.asarray(items, dtype=object)
    flat = [item.value(t, order) if isinstance(item, Series) else mpf(item) for item in array.ravel()]
    return np.array(flat, dtype=object).reshape(array.shape)
