"""The path of S of an RRSRR drive as paper 002 traces it: torus and sphere by arc length."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from mechsim.analytic.catalog.rrsrr import Rrsrr
from mechsim.analytic.vector_method.trig_arcs import reachable_arcs
from mechsim.analytic.vector_method.vectors import dot, norm
from mechsim.errors import AssemblyError, InputError

Array = NDArray[np.float64]
TURN = 2.0 * np.pi

# the frame of the torus: its x, y, z are Y, Z, X of the mechanism (T1 of the paper)
CRANK_FRAME = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True)
class SpherePath:
    """One closed branch of the curve in which torus and sphere meet.

    Attributes:
        arc: length along the path of S from the start, (n,) in [m].
        parameters: u1, v1, u2, v2 of paper 002, not wrapped, (n, 4) in [rad].
        on_torus: S from u1 and v1, (n, 3) in [m].
        on_sphere: S from u2 and v2, (n, 3) in [m]; how far it is from `on_torus` is the error of the road.
        gap: distance from the end of the path to its start, in [m].
        turns: how often the crank went round: 0 or +-1.
        evaluations: of the right-hand side.
    """

    arc: Array
    parameters: Array
    on_torus: Array
    on_sphere: Array
    gap: float
    turns: int
    evaluations: int


def torus(drive: Rrsrr, u1: Array, v1: Array) -> tuple[Array, Array, Array]:
    """Return M1 and its derivatives by u1 and v1, (3, ...) in [m]. Paper 002."""
    reach, sink = drive.crank + drive.coupler * np.cos(v1), drive.coupler * np.sin(v1)
    zero, c, s = np.zeros_like(sink), np.cos(u1), np.sin(u1)
    place = np.stack([reach * c, reach * s, sink])
    by_u = np.stack([-reach * s, reach * c, zero])
    by_v = np.stack([-sink * c, -sink * s, drive.coupler * np.cos(v1)])
    return _turned(CRANK_FRAME, place), _turned(CRANK_FRAME, by_u), _turned(CRANK_FRAME, by_v)


def sphere(drive: Rrsrr, u2: Array, v2: Array) -> tuple[Array, Array, Array]:
    """Return M2 and its derivatives by u2 and v2, (3, ...) in [m]. Paper 002."""
    reach, height = drive.link * np.cos(v2), drive.link * np.sin(v2)
    zero, c, s = np.zeros_like(height), np.cos(u2), np.sin(u2)
    frame, pivot = drive.rocker_frame, np.asarray(drive.pivot)
    place = _turned(frame, np.stack([reach * c, reach * s, height]))
    by_u = _turned(frame, np.stack([-reach * s, reach * c, zero]))
    by_v = _turned(frame, np.stack([-height * c, -height * s, reach]))
    return (place.T + pivot).T, by_u, by_v


def start_points(drive: Rrsrr) -> list[Array]:
    """Return every (u1, v1, u2, 0) at which S stands on the circle v2 = 0, in [rad].

    The paper solves M1(u1, v1) = M3(u2) from a guess. For a point of the circle the implicit
    equation of the torus, (|M|2 + R12 - r12)2 = 4 R12 (y2 + z2), is a trigonometric polynomial of
    u2 of degree 2: all its roots, up to four, are found without one.
    """
    r1, across = drive.crank, drive.coupler

    def sides(u2: Array) -> tuple[Array, Array]:
        m = sphere(drive, u2, np.zeros_like(u2))[0]
        return m, dot(m, m) + (r1 - across) * (r1 + across)

    def inside(u2: Array) -> Array:
        m, square = sides(u2)
        return 4.0 * r1**2 * (m[1] ** 2 + m[2] ** 2) - square**2

    arcs = reachable_arcs(inside, 2)
    found = []
    for u2 in () if arcs.full else [end for arc in arcs.arcs for end in arc]:
        m, square = sides(np.array(u2))
        # a coupler longer than the crank can reach across the shaft: then S stands opposite the crank
        facing = 1.0 if square >= 0.0 else -1.0
        reach = facing * np.hypot(m[1], m[2])
        u1, v1 = np.arctan2(facing * m[2], facing * m[1]), np.arctan2(m[0], reach - r1)
        found.append(np.array([u1, v1, u2, 0.0]))
    return found


def path_slopes(drive: Rrsrr, parameters: Array) -> Array:
    """Return du1/ds, dv1/ds, du2/ds, dv2/ds along the curve, (4,) in [rad/m]. Paper 002.

    The unit tangent is n ~ (M1u x M1v) x (M2u x M2v); M1u u1' + M1v v1' = n, multiplied by M1u and by
    M1v, is a 2 x 2 system, and likewise on the sphere.
    """
    u1, v1, u2, v2 = parameters
    _, *first = torus(drive, u1, v1)
    _, *second = sphere(drive, u2, v2)
    n = np.cross(np.cross(first[0], first[1]), np.cross(second[0], second[1]))
    n = n / norm(n)
    return np.concatenate([_along(first[0], first[1], n), _along(second[0], second[1], n)])


def trace_path(drive: Rrsrr, start: Array | None = None, *, tolerance: float = 1e-12) -> SpherePath:
    """Trace the closed branch of the torus-sphere curve that belongs to a drive, by arc length.

    Turning points of the crank are passed: where it only swings, the branch holds both assemblies.

    Args:
        drive: the drive.
        start: (u1, v1, u2, v2) in [rad] of a point of the curve; None takes the first point with
            v2 = 0 in the drive's own assembly and arc of crank angle.
        tolerance: of the integration, relative.

    Returns:
        The path from the start round to the start, at the integrator's own steps.

    Raises:
        AssemblyError: if the path does not close, or has no point with v2 = 0 to start from.
        InputError: if the start given is not on both surfaces.

    Accuracy: at tolerance 1e-12 the two surfaces stay together to about 1e-11 of the link's length.

    Source: paper 002, Dragilev's method.
    """
    u = np.asarray(_own_start(drive) if start is None else start, dtype=np.float64)
    origin = torus(drive, u[0], u[1])[0]
    apart = float(np.linalg.norm(origin - sphere(drive, u[2], u[3])[0]))
    if not apart <= 1e-9 * drive.link:
        raise InputError(f"{drive.name}: start {u} is {apart:.3g} m off the curve; take one of start_points")
    normal = _space_slope(drive, u)

    def ahead(_: float, parameters: Array) -> float:
        return float(normal @ (torus(drive, parameters[0], parameters[1])[0] - origin))

    ahead.terminal, ahead.direction = True, 1.0  # pyright: ignore[reportFunctionMemberAccess]
    pieces, arc, evaluations = [u[:, None]], [np.zeros(1)], 0
    # the longest curve on the sphere of degree four is shorter than this
    longest = 16.0 * TURN * drive.link
    hop = 1e-3 * min(drive.link, drive.coupler, drive.crank)
    while arc[-1][-1] < longest:
        # a hop off the start first, where the plane that ends the path would be met at once
        for span, events in ((hop, None), (longest, ahead)):
            s = float(arc[-1][-1])
            part = solve_ivp(
                lambda _, y: path_slopes(drive, y),
                (s, s + span),
                pieces[-1][:, -1],
                method="DOP853",
                rtol=tolerance,
                atol=tolerance,
                events=events,
            )
            evaluations += part.nfev
            pieces.append(part.y[:, 1:])
            arc.append(part.t[1:])
        end = pieces[-1][:, -1]
        gap = float(np.linalg.norm(torus(drive, end[0], end[1])[0] - origin))
        if gap <= 1e-6 * drive.link and normal @ _space_slope(drive, end) > 0.0:
            path = np.concatenate(pieces, 1)
            turns = round((end[0] - u[0]) / TURN)
            places = torus(drive, path[0], path[1])[0].T, sphere(drive, path[2], path[3])[0].T
            return SpherePath(np.concatenate(arc), path.T, *places, gap, turns, evaluations)
    raise AssemblyError(
        f"{drive.name}: the path of S does not close within {longest:.3g} m; it may touch itself, "
        "which happens where the crank barely turns fully; change the dimensions a little"
    )


def _own_start(drive: Rrsrr) -> Array:
    arcs, begin = drive.crank_range(), drive.crank_range().start()
    own = [arc for arc in arcs.arcs if any(arc[0] <= begin + turn <= arc[1] for turn in (0.0, TURN))]
    for u in start_points(drive):
        c = drive.crank * _turned(CRANK_FRAME, np.array([np.cos(u[0]), np.sin(u[0]), 0.0]))
        side = drive.assembly_sign({"C": c[None], "S": torus(drive, u[0], u[1])[0][None]})[0]
        # a swinging crank joins both assemblies, but has another curve for each of its arcs
        if (
            side > 0.0
            if arcs.full
            else any(low <= u[0] + turn <= high for low, high in own for turn in (0.0, TURN))
        ):
            return u
    raise AssemblyError(
        f"{drive.name}: S never crosses the circle v2 = 0 in this assembly; give a start from the closed form"
    )


def _space_slope(drive: Rrsrr, parameters: Array) -> Array:
    """Return the unit tangent of the path of S, (3,)."""
    _, by_u, by_v = torus(drive, parameters[0], parameters[1])
    slopes = path_slopes(drive, parameters)
    return by_u * slopes[0] + by_v * slopes[1]


def _along(by_u: Array, by_v: Array, n: Array) -> Array:
    """Solve by_u u' + by_v v' = n for u' and v'."""
    e, f, g = by_u @ by_u, by_u @ by_v, by_v @ by_v
    p, q = by_u @ n, by_v @ n
    return np.array([g * p - f * q, e * q - f * p]) / (e * g - f * f)


def _turned(frame: Array, v: Array) -> Array:
    return np.tensordot(frame, v, 1)
