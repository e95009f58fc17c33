"""The path of S of an RRSRR drive as paper 002 traces it: where torus and sphere meet, by arc length."""

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
    """One closed branch of the curve in which torus and sphere meet.

    Attributes:
        curve: the path of S, its points and its length in [m].
        parameters: u1, v1, u2, v2 of paper 002 at its points, not wrapped, (n, 4) in [rad]; v2 of the
            first lies in [-pi/2, pi/2].
        on_torus: S from u1 and v1, (n, 3) in [m].
        on_sphere: S from u2 and v2, (n, 3) in [m]; how far it is from `on_torus` is the error of the method.
    """

    curve: Curve
    parameters: Array
    on_torus: Array
    on_sphere: Array

    __repr__ = short_repr

    @property
    def turns(self) -> int:
        """How often the crank went round: 0 or +-1."""
        return round((self.parameters[-1, 0] - self.parameters[0, 0]) / REVOLUTION)


def torus(drive: Rrsrr, u1: Array, v1: Array) -> Array:
    """Return M1, (3, ...) in [m]. Paper 002."""
    reach, sink = drive.crank + drive.coupler * np.cos(v1), drive.coupler * np.sin(v1)
    return _turned(CRANK_FRAME, np.stack([reach * np.cos(u1), reach * np.sin(u1), sink]))


def sphere(drive: Rrsrr, u2: Array, v2: Array) -> Array:
    """Return M2, (3, ...) in [m]. Paper 002."""
    reach, height = drive.link * np.cos(v2), drive.link * np.sin(v2)
    arm = np.stack([reach * np.cos(u2), reach * np.sin(u2), height])
    return (_turned(drive.rocker_frame, arm).T + np.asarray(drive.pivot)).T


def torus_sphere(drive: Rrsrr) -> System:
    """Return the implicit equations of both surfaces in the place of S, with their gradients."""
    centre = np.asarray(drive.pivot)

    def residual(s: Array) -> Array:
        off = s - centre
        return np.array([_torus_gap(drive, s), off @ off - drive.link**2])

    def jacobian(s: Array) -> Array:
        across = np.array([0.0, s[1], s[2]])
        return np.array([_facing(drive, s) * s - 2.0 * drive.crank**2 * across, s - centre]) * [[4.0], [2.0]]

    return System(residual, jacobian, size=min(drive.crank, drive.link), name=drive.name)


def start_points(drive: Rrsrr) -> list[Array]:
    """Return every (u1, v1, u2, 0) at which S stands on the circle v2 = 0, in [rad].

    The paper solves M1(u1, v1) = M3(u2) from a guess. For a point of the circle the implicit
    equation of the torus is a trigonometric polynomial of u2 of degree 2: all its roots, up to four,
    are found without one.
    """
    arcs = reachable_arcs(lambda u2: -_torus_gap(drive, sphere(drive, u2, np.zeros_like(u2))), 2)
    result = []
    for u2 in () if arcs.full else [end for arc in arcs.arcs for end in arc]:
        u1, v1 = _on_torus(drive, sphere(drive, np.array(u2), np.zeros(())))
        result.append(np.array([u1, v1, u2, 0.0]))
    return result


def trace_path(drive: Rrsrr, start: ArrayLike | None = None, *, tolerance: float = 1e-12) -> SpherePath:
    """Trace the closed branch of the torus-sphere curve that belongs to a drive, by arc length.

    Turning points of the crank are passed: where it only swings, the branch holds both assemblies.

    Args:
        drive: the drive.
        start: a place of S on the curve, (3,) in [m]; None takes the first point with v2 = 0 in the
            drive's own assembly and arc of crank angle.
        tolerance: of the arc length, in units of the crank or the link, whichever is shorter.

    Returns:
        The path from the start round to the start.

    Raises:
        AssemblyError: where the curve touches itself, which happens where the crank barely turns fully;
            or if it has no point with v2 = 0 to start from.
        InputError: if the start given is not on both surfaces.

    Accuracy: every point lies on both surfaces to rounding.

    Source: paper 002, Dragilev's method.
    """
    curve = trace_curve(
        torus_sphere(drive), _own_start(drive) if start is None else start, tolerance=tolerance
    )
    s = curve.points.T
    x, y, z = _turned(drive.rocker_frame.T, s - np.asarray(drive.pivot)[:, None])
    angles = *_on_torus(drive, s), np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    u1, v1, u2, v2 = (np.unwrap(angle) for angle in angles)
    return SpherePath(curve, np.stack([u1, v1, u2, v2], 1), torus(drive, u1, v1).T, sphere(drive, u2, v2).T)


def _own_start(drive: Rrsrr) -> Array:
    arcs, begin = drive.crank_range(), drive.crank_range().start()
    own = [arc for arc in arcs.arcs if any(arc[0] <= begin + turn <= arc[1] for turn in (0.0, REVOLUTION))]
    for u in start_points(drive):
        s = torus(drive, u[0], u[1])
        c = drive.crank * _turned(CRANK_FRAME, np.array([np.cos(u[0]), np.sin(u[0]), 0.0]))
        side = drive.assembly_sign({"C": c[None], "S": s[None]})[0]
        # a swinging crank joins both assemblies, but has another curve for each of its arcs
        if (
            side > 0.0
            if arcs.full
            else any(low <= u[0] + turn <= high for low, high in own for turn in (0.0, REVOLUTION))
        ):
            return s
    raise AssemblyError(
        f"{drive.name}: S never crosses the circle v2 = 0 in this assembly; give a start from the closed form"
    )


def _facing(drive: Rrsrr, s: Array) -> Array:
    """Return |S|2 + R12 - r12, (...) in [m2]: 2 R1 times the reach of S along the crank."""
    return (s * s).sum(0) + (drive.crank - drive.coupler) * (drive.crank + drive.coupler)


def _torus_gap(drive: Rrsrr, s: Array) -> Array:
    """Return (|S|2 + R12 - r12)2 - 4 R12 (y2 + z2), (...) in [m4]: zero on the torus, above it outside."""
    return _facing(drive, s) ** 2 - 4.0 * drive.crank**2 * (s[1] ** 2 + s[2] ** 2)


def _on_torus(drive: Rrsrr, s: Array) -> tuple[Array, Array]:
    """Return u1 and v1 of a place on the torus, (...) in [rad]."""
    # a coupler longer than the crank can reach across the shaft: then S stands opposite the crank
    facing = np.where(_facing(drive, s) >= 0.0, 1.0, -1.0)
    reach = facing * np.hypot(s[1], s[2])
    return np.arctan2(facing * s[2], facing * s[1]), np.arctan2(s[0], reach - drive.crank)


def _turned(frame: Array, v: Array) -> Array:
    return np.tensordot(frame, v, 1)
