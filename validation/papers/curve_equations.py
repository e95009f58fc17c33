"""A smooth system F(x) = 0 with one free direction, as a curve that `arc_length.trace` traces."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from arc_length import SINGULAR, Curve, Frame, extrema, trace
from numpy.typing import ArrayLike

from mechsim.errors import AssemblyError, InputError
from mechsim.numerics.arrays import Array

EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class System:
    """Equations F(x) = 0 in n unknowns whose solutions form a curve.

    Attributes:
        residual: F, (n,) -> (m,); m >= n - 1, of which n - 1 are independent.
        jacobian: dF/dx, (n,) -> (m, n); None takes central differences over
            6e-6 of the size, accurate to about 1e-10 for functions that vary over the size.
        scale: typical size of the curve, in the unit of the coordinates.
        periods: of each coordinate, 0 if it has none; whole periods count as zero distance.
        name: for messages.
    """

    residual: Callable[[Array], Array]
    jacobian: Callable[[Array], Array] | None = None
    scale: float = 1.0
    periods: tuple[float, ...] = ()
    name: str = "curve"

    def frame(self, y: Array, along: Array | None) -> Frame:
        """Linearise at y, the unit tangent making an acute angle with `along`."""
        rows = self._rows(y)[1]
        u, values, vt = np.linalg.svd(rows)
        rank = len(y) - 1
        if not values[rank - 1] > SINGULAR * values[0]:
            raise AssemblyError(f"{self.name}: more than one direction is free at {y.tolist()}")
        tangent = vt[-1]
        if along is None:
            along = np.eye(len(y))[np.argmax(np.abs(tangent))]
        tangent = tangent if tangent @ along >= 0.0 else -tangent
        return Frame(tangent, rows, tangent, u[:, :rank], np.eye(len(y)), tangent)

    def corrected(self, y: Array) -> tuple[Array, int]:
        """Return the nearest point of the curve by Newton's method with least steps, and the iterations."""
        before = np.inf
        for count in range(1, 31):
            residual, rows = self._rows(y)
            u, values, vt = np.linalg.svd(rows, full_matrices=False)
            rank = len(y) - 1
            inverse = np.where(values[:rank] > SINGULAR * values[0], values[:rank], np.inf)
            step = vt[:rank].T @ ((u[:, :rank].T @ residual) / inverse)
            y = y - step
            step_length = float(np.linalg.norm(step))
            converged = step_length <= 1e-9 * self.scale and step_length >= 0.25 * before
            if converged or step_length <= 4.0 * EPS * max(self.scale, float(np.abs(y).max())):
                return y, count
            before = step_length
        raise AssemblyError(f"{self.name}: Newton's method does not converge near {y.tolist()}")

    def gap(self, y: Array, other: Array) -> Array:
        """Return y - other, reduced by whole periods."""
        difference = y - other
        if self.periods:
            periods = np.asarray(self.periods)
            nonzero = np.where(periods > 0.0, periods, 1.0)
            difference = difference - periods * np.round(difference / nonzero)
        return difference

    def _rows(self, y: Array) -> tuple[Array, Array]:
        """Return residual and Jacobian, each row scaled so that its gradient is a unit vector."""
        residual = np.atleast_1d(np.asarray(self.residual(y), dtype=np.float64))
        jacobian = np.atleast_2d(self.jacobian(y) if self.jacobian else self._differences(y))
        if jacobian.shape != (len(residual), len(y)) or len(residual) < len(y) - 1:
            raise InputError(
                f"{self.name}: {len(residual)} equations with a Jacobian of shape {jacobian.shape} for "
                f"{len(y)} unknowns; a curve takes at least {len(y) - 1} equations and a column an unknown"
            )
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            raise AssemblyError(f"{self.name}: the equations give no finite number at {y.tolist()}")
        gradient_norm = np.sqrt((jacobian**2).sum(1))
        gradient_norm = np.where(gradient_norm > 0.0, gradient_norm, 1.0)
        return residual / gradient_norm, jacobian / gradient_norm[:, None]

    def _differences(self, y: Array) -> Array:
        steps = np.eye(len(y)) * EPS ** (1 / 3) * np.maximum(self.scale, np.abs(y))
        forward, backward = (
            [np.atleast_1d(self.residual(y + sign * step)) for step in steps] for sign in (1, -1)
        )
        return (np.array(forward) - np.array(backward)).T / (2.0 * np.diag(steps))


def trace_curve(
    system: System,
    start: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    length: float | None = None,
    tolerance: float = 1e-10,
    longest: float | None = None,
    most_steps: int = 10_000,
) -> Curve:
    """Trace the curve F(x) = 0 from a point of it until it closes or reaches a length.

    Args:
        system: the equations.
        start: a point of the curve to within 1e-6 of its size, (n,).
        direction: selects the tangent with an acute angle to it, (n,); None lets the fastest coordinate
            increase.
        length: of an open curve; None requires a closed curve.
        tolerance: of the integration, in units of the size: it determines the steps and the error of the
            arc length; the points are on the curve to rounding at any tolerance.
        longest: longest step; None is a quarter of the size.
        most_steps: steps before giving up.

    Raises:
        InputError: if the start is not on the curve, or more than one direction is free there.
        AssemblyError: where branches cross, or if the curve has not closed after `most_steps`.
    """
    y = np.atleast_1d(np.asarray(start, dtype=np.float64))
    return trace(
        system,
        y,
        direction=direction,
        length=length,
        tolerance=tolerance,
        longest=longest,
        most_steps=most_steps,
    )


def turning_points(system: System, curve: Curve, coordinate: int) -> Array:
    """Return the points of a traced curve at extrema of a coordinate, (k, n), exact to rounding."""
    return extrema(system, curve, lambda frame: float(frame.tangent[coordinate]))
