"""The path of S of an RRSRR mechanism: intersection of torus and sphere, by arc length.

Source: the paper on the RRSRR (docs/explanation/sources.md).
"""

from dataclasses import dataclass

import numpy as np
from arc_length import Curve
from curve_equations import System, trace_curve
from numpy.typing import ArrayLike

from mechsim.analytic.catalog.rrsrr import Rrsrr
from mechsim.analytic.vector_method.trig_polynomial import reachable_arcs
from mechsim.errors import AssemblyError
from mechsim.model.motion import short_repr
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array

# the frame of the torus: its x, y, z are Y, Z, X of the mechanism (T1 of the paper)
CRANK_FRAME = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class SpherePath:
    """A closed branch of the intersection curve of torus and sphere.

    Attributes:
        curve: the path of S, its points and its length in [m].
        parameters: u1, v1, u2, v2 of the paper at its points, not wrapped, (n, 4) in [rad]; v2 of the
            first lies in [-pi/2, pi/2].
        on_torus: S from u1 and v1, (n, 3) in [m].
        on_sphere: S from u2 and v2, (n, 3) in [m]; its distance from `on_torus` is the error of the method.
    """

    curve: Curve
    parameters: Array
    on_torus: Array
    on_sphere: Array

    __repr__ = short_repr

    @property
    def turns(self) -> int:
        """Number of revolutions of the crank: 0 or +-1."""
        return round((self.parameters[-1, 0] - self.parameters[0, 0]) / REVOLUTION)


def torus(rrsrr: Rrsrr, u1: Array, v1: Array) -> Array:
    """Return M1, (3, ...) in [m]. Paper 002."""
    reach, depth = rrsrr.crank + rrsrr.coupler * np.cos(v1), rrsrr.coupler * np.sin(v1)
    return _rotated(CRANK_FRAME, np.stack([reach * np.cos(u1), reach * np.sin(u1), depth]))


def sphere(rrsrr: Rrsrr, u2: Array, v2: Array) -> Array:
    """Return M2, (3, ...) in [m]. Paper 002."""
    reach, height = rrsrr.link * np.cos(v2), rrsrr.link * np.sin(v2)
    arm = np.stack([reach * np.cos(u2), reach * np.sin(u2), height])
    return (_rotated(rrsrr.rocker_frame, arm).T + np.asarray(rrsrr.pivot)).T


def torus_sphere(rrsrr: Rrsrr) -> System:
    """Return the implicit equations of both surfaces in the position of S, with their gradients."""
    centre = np.asarray(rrsrr.pivot)

    def residual(s: Array) -> Array:
        offset = s - centre
        return np.array([_torus_residual(rrsrr, s), offset @ offset - rrsrr.link**2])

    def jacobian(s: Array) -> Array:
        radial = np.array([0.0, s[1], s[2]])
        torus_gradient = _radial_term(rrsrr, s) * s - 2.0 * rrsrr.crank**2 * radial
        return np.array([4.0 * torus_gradient, 2.0 * (s - centre)])

    return System(residual, jacobian, scale=min(rrsrr.crank, rrsrr.link), name=rrsrr.name)


def start_points(rrsrr: Rrsrr) -> list[Array]:
    """Return every (u1, v1, u2, 0) with S on the circle v2 = 0, in [rad].

    The paper solves M1(u1, v1) = M3(u2) from a guess. For a point of the circle the implicit
    equation of the torus is a trigonometric polynomial of u2 of degree 2: all its roots, up to four,
    follow without one.
    """
    arcs = reachable_arcs(lambda u2: -_torus_residual(rrsrr, sphere(rrsrr, u2, np.zeros_like(u2))), 2)
    result = []
    for u2 in () if arcs.full else [end for arc in arcs.arcs for end in arc]:
        u1, v1 = _on_torus(rrsrr, sphere(rrsrr, np.array(u2), np.zeros(())))
        result.append(np.array([u1, v1, u2, 0.0]))
    return result


def trace_path(rrsrr: Rrsrr, start: ArrayLike | None = None, *, tolerance: float = 1e-12) -> SpherePath:
    """Trace the closed branch of the torus-sphere curve of a mechanism, by arc length.

    The path passes turning points of a swinging crank; its branch contains both assembly modes.

    Args:
        rrsrr: the mechanism.
        start: a position of S on the curve, (3,) in [m]; None is the first point with v2 = 0 in the assembly
            mode and crank interval of the mechanism.
        tolerance: of the arc length, in units of the crank or the link, whichever is shorter.

    Returns:
        The closed path from the start.

    Raises:
        AssemblyError: if the curve intersects itself, as at a change point of the crank; or without a point
            with v2 = 0.
        InputError: if the start is not on both surfaces.

    Accuracy: every point lies on both surfaces to rounding.

    Source: the paper on the RRSRR (docs/explanation/sources.md), Dragilev's method.
    """
    curve = trace_curve(
        torus_sphere(rrsrr), _start_of_assembly(rrsrr) if start is None else start, tolerance=tolerance
    )
    s = curve.points.T
    x, y, z = _rotated(rrsrr.rocker_frame.T, s - np.asarray(rrsrr.pivot)[:, None])
    angles = *_on_torus(rrsrr, s), np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    u1, v1, u2, v2 = (np.unwrap(angle) for angle in angles)
    return SpherePath(curve, np.stack([u1, v1, u2, v2], 1), torus(rrsrr, u1, v1).T, sphere(rrsrr, u2, v2).T)


def _start_of_assembly(rrsrr: Rrsrr) -> Array:
    arcs, start_angle = rrsrr.crank_range(), rrsrr.crank_range().start()
    starts = (start_angle, start_angle + REVOLUTION)
    reachable = [arc for arc in arcs.arcs if any(arc[0] <= angle <= arc[1] for angle in starts)]
    for u in start_points(rrsrr):
        s = torus(rrsrr, u[0], u[1])
        c = rrsrr.crank * _rotated(CRANK_FRAME, np.array([np.cos(u[0]), np.sin(u[0]), 0.0]))
        side = rrsrr.assembly_sign({"C": c[None], "S": s[None]})[0]
        # a swinging crank connects both assembly modes, but has a separate curve for each interval
        if (
            side > 0.0
            if arcs.full
            else any(low <= u[0] + period <= high for low, high in reachable for period in (0.0, REVOLUTION))
        ):
            return s
    raise AssemblyError(
        f"{rrsrr.name}: S never crosses the circle v2 = 0 in this assembly mode; give a start on the curve"
    )


def _radial_term(rrsrr: Rrsrr, s: Array) -> Array:
    """Return |S|2 + R12 - r12, (...) in [m2]: 2 R1 times the reach of S along the crank."""
    return (s * s).sum(0) + (rrsrr.crank - rrsrr.coupler) * (rrsrr.crank + rrsrr.coupler)


def _torus_residual(rrsrr: Rrsrr, s: Array) -> Array:
    """Return (|S|2 + R12 - r12)2 - 4 R12 (y2 + z2), (...) in [m4]: zero on the torus, above it outside."""
    return _radial_term(rrsrr, s) ** 2 - 4.0 * rrsrr.crank**2 * (s[1] ** 2 + s[2] ** 2)


def _on_torus(rrsrr: Rrsrr, s: Array) -> tuple[Array, Array]:
    """Return u1 and v1 of a point on the torus, (...) in [rad]."""
    # S can lie opposite to the crank if the coupler is longer than the crank
    sign = np.where(_radial_term(rrsrr, s) >= 0.0, 1.0, -1.0)
    reach = sign * np.hypot(s[1], s[2])
    return np.arctan2(sign * s[2], sign * s[1]), np.arctan2(s[0], reach - rrsrr.crank)


def _rotated(frame: Array, v: Array) -> Array:
    return np.tensordot(frame, v, 1)
