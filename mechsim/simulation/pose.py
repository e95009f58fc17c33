"""Motion by solving poses: no time, no integration, every crank angle to rounding."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.mjcf import Loops

Array = NDArray[np.float64]
TURN = 2.0 * np.pi

# the crank's stride in the first walk over the range; the poses between come by interpolation
STRIDE = TURN / 24
# a walk that needs strides below this stands at a dead centre
SHORTEST = 1e-7


def follow(loops: Loops, start: Array, angles: ArrayLike) -> Array:
    """Return the states at crank angles in the assembly of a closed start state, (n, nq).

    A walk over the range keeps the assembly; splines through its poses give the rest to within a
    Newton step or two, all solved together.

    Args:
        loops: of the model.
        start: closed state, (nq,).
        angles: crank angles in any order, (n,) in [rad].

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    angles = np.asarray(angles, dtype=np.float64)
    here = float(start[loops.crank_place])
    walked = [start[None]]
    for end in (float(angles.min()), float(angles.max())):
        if abs(end - here) > 1e-12 and (end < here) == (end == float(angles.min())):
            way = _walk(loops, start, end)
            walked = [way[::-1], *walked] if end < here else [*walked, way]
    knots, _, _ = loops.close(np.concatenate(walked))
    if len(knots) > 1:
        span = knots[-1, loops.crank_place] - knots[0, loops.crank_place]
        finer = np.linspace(knots[0, loops.crank_place], knots[-1, loops.crank_place], 4 * len(knots))
        if len(angles) > len(finer) and span > STRIDE:
            knots, _, _ = loops.close(_between(loops, knots, finer))
    closed, _, _ = loops.close(_between(loops, knots, angles))
    return closed


def _walk(loops: Loops, start: Array, end: float) -> Array:
    """Return states on the way from a closed state to a crank angle, the last one there, (k, nq)."""
    here, stride = start, STRIDE
    angle = float(start[loops.crank_place])
    sense = np.sign(end - angle)
    _, jacobian = loops.linearise(here[None])
    slope = loops.tangent(jacobian)
    found: list[Array] = []
    while sense * (end - angle) > 1e-12:
        step = min(stride, abs(end - angle))
        guess = loops.moved(here[None], sense * step * slope)
        guess[0, loops.crank_place] = angle + sense * step
        try:
            there, _, jacobian = loops.close(guess, most_steps=8)
        except (AssemblyError, np.linalg.LinAlgError):
            there = None
        # a correction as long as the stride itself may have fallen into the other assembly
        if there is None or _distance(loops, guess, there) > 0.3 * _distance(loops, here[None], guess):
            stride = step / 2.0
            if stride < SHORTEST:
                raise AssemblyError(
                    f"{loops.name}: the crank cannot pass {angle:.7g} rad in this assembly; "
                    "stay on this side of the dead centre or change the dimensions"
                )
            continue
        here, angle = there[0], angle + sense * step
        slope = loops.tangent(jacobian)
        found.append(here)
        stride = min(2.0 * stride, STRIDE)
    return np.stack(found)


def _distance(loops: Loops, a: Array, b: Array) -> float:
    return float(np.abs(a - b).max())


def _between(loops: Loops, knots: Array, angles: Array) -> Array:
    """Return states interpolated at crank angles between known ones, (n, nq)."""
    from scipy.interpolate import make_interp_spline

    if len(knots) == 1:
        states = np.repeat(knots, len(angles), 0)
    else:
        at = knots[:, loops.crank_place]
        smooth = _same_sign_quaternions(loops, knots)
        degree = min(7, len(knots) - 1)
        degree -= 1 - degree % 2
        states = make_interp_spline(at, smooth, k=degree)(angles)
    states[:, loops.crank_place] = angles
    return states


def _same_sign_quaternions(loops: Loops, states: Array) -> Array:
    """Return states whose quaternions do not change sign from one to the next: q and -q are the same turn."""
    smooth = states.copy()
    for place in loops.quaternions:
        q = smooth[:, place : place + 4]
        flips = np.where((q[1:] * q[:-1]).sum(1) < 0.0, -1.0, 1.0)
        q[1:] *= np.cumprod(flips)[:, None]
    return smooth
