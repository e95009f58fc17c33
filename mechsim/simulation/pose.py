"""Motion by solving poses: no time, no integration, every crank angle to rounding."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.mjcf import Loops

Array = NDArray[np.float64]
Path = Callable[[Array], Array]
TURN = 2.0 * np.pi

# the crank's stride in the first walk over the range; the poses between come by interpolation
STRIDE = TURN / 16
# a walk that needs strides below this stands at a dead centre
SHORTEST = 1e-7
# opening of the loops after which one more Newton step leaves the walk as closed as it need be
LOOSE, MOST_STEPS = 1e-2, 8
# a correction longer than this part of the stride may have fallen into the other assembly
SAFE = 0.25
# how far from its start a state may be after a turn to count as the same: rounding of a walk, squared up
SAME = 1e-9
# poses closed in one go: their arrays stay in the cache, and a long run needs little memory
CHUNK = 2048


def follow(loops: Loops, start: Array, angles: ArrayLike) -> Array:
    """Return the states at crank angles in the assembly of a closed start state, (n, nq).

    A walk over the range keeps the assembly; splines through its poses give the rest to within a
    Newton step or two, all solved together. Where a turn of the crank leads back to the start, one
    turn is walked however many are asked for.

    Args:
        loops: of the model.
        start: closed state, (nq,).
        angles: crank angles in any order, (n,) in [rad].

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    angles = np.asarray(angles, dtype=np.float64)
    guess = _path(loops, start, angles)
    states = np.empty((len(angles), loops.model.nq))
    for i in range(0, len(angles), CHUNK):
        states[i : i + CHUNK] = loops.close(guess(angles[i : i + CHUNK]))
    return states


def _path(loops: Loops, start: Array, angles: Array) -> Path:
    """Return the way over all crank angles asked for, as a function."""
    here = float(start[loops.crank_place])
    low, high = min(here, float(angles.min())), max(here, float(angles.max()))
    if high - low <= 1.5 * TURN:
        return _spline(loops, _knots(loops, start, low, high), len(angles))
    lap = _knots(loops, start, here, here + TURN)
    gain = _gain(loops, lap)
    if gain is None:
        return _spline(loops, _knots(loops, start, low, high), len(angles))
    one_lap = _spline(loops, lap, len(angles))

    def path(at: Array) -> Array:
        laps = np.floor((at - here) / TURN)
        states = one_lap(np.clip(at - laps * TURN, here, here + TURN)) + laps[:, None] * gain
        states[:, loops.crank_place] = at
        return states

    return path


def _gain(loops: Loops, lap: Array) -> Array | None:
    """Return what a turn of the crank adds to a state, (nq,); None where it does not lead back."""
    first, last = lap[0], lap[-1]
    gain = last - first
    for place in loops.quaternions:
        turn = slice(place, place + 4)
        gain[turn] = last[turn] - np.sign(last[turn] @ first[turn]) * first[turn]
    whole = np.where(loops.hinges, TURN * np.round(gain / TURN), 0.0)
    return whole if np.abs(gain - whole).max() < SAME else None


def _knots(loops: Loops, start: Array, low: float, high: float) -> Array:
    """Return closed states from a lowest to a highest crank angle, rising, (k, nq)."""
    here = float(start[loops.crank_place])
    before = _walk(loops, start, low) if here - low > 1e-12 else []
    after = _walk(loops, start, high) if high - here > 1e-12 else []
    return loops.close(np.stack([*before[::-1], start, *after]))


def _walk(loops: Loops, start: Array, end: float) -> list[Array]:
    """Return nearly closed states on the way from a closed state to a crank angle, the last one there."""
    here, stride = start[None], STRIDE
    angle = float(start[loops.crank_place])
    sense = 1.0 if end > angle else -1.0
    slope = loops.tangent(loops.linearise(here)[1])
    bend = np.zeros_like(slope)
    found: list[Array] = []
    while sense * (end - angle) > 1e-12:
        step = min(stride, abs(end - angle))
        target = end if step == abs(end - angle) else angle + sense * step
        guess = loops.moved(here, sense * step * slope + 0.5 * step**2 * bend)
        guess[0, loops.crank_place] = target
        there = _landed(loops, here, guess)
        if there is None:
            stride = step / 2.0
            if stride < SHORTEST:
                raise AssemblyError(
                    f"{loops.name}: the crank cannot pass {angle:.7g} rad in this assembly; "
                    "stay on this side of the dead centre or change the dimensions"
                )
            continue
        here, slope_there = there
        bend = sense * (slope_there - slope) / step
        slope, angle = slope_there, target
        found.append(here[0])
        stride = min(2.0 * step, STRIDE)
    return found


def _landed(loops: Loops, here: Array, guess: Array) -> tuple[Array, Array] | None:
    """Return the state that a guess leads to, and its slope; None if that may be another assembly."""
    there = guess
    for _ in range(MOST_STEPS):
        residual, jacobian = loops.linearise(there)
        try:
            step, slope = loops.newton(residual, jacobian)
        except (np.linalg.LinAlgError, FloatingPointError):
            return None
        there = loops.moved(there, step)
        if np.abs(there - guess).max() > SAFE * np.abs(here - guess).max():
            return None
        if loops.gap(residual)[0] < LOOSE:
            return there, slope
    return None


def _spline(loops: Loops, knots: Array, count: int) -> Path:
    """Return the way through closed states, after making them denser if many poses are asked for."""
    path = _through(loops, knots)
    finer = 6 * len(knots)
    if count > 2 * finer and len(knots) > 8:
        ends = knots[[0, -1], loops.crank_place]
        path = _through(loops, loops.close(path(np.linspace(ends[0], ends[1], finer))))
    return path


def _through(loops: Loops, knots: Array) -> Path:
    from scipy.interpolate import make_interp_spline

    if len(knots) == 1:
        path: Path = lambda at: np.repeat(knots, len(at), 0)  # noqa: E731
    else:
        degree = min(7, len(knots) - 1)
        degree -= 1 - degree % 2
        path = make_interp_spline(knots[:, loops.crank_place], _same_sign_quaternions(loops, knots), k=degree)

    def states(at: Array) -> Array:
        found = path(at)
        found[:, loops.crank_place] = at
        return found

    return states


def _same_sign_quaternions(loops: Loops, states: Array) -> Array:
    """Return states whose quaternions do not change sign from one to the next: q and -q are the same turn."""
    smooth = states.copy()
    for place in loops.quaternions:
        q = smooth[:, place : place + 4]
        flips = np.where((q[1:] * q[:-1]).sum(1) < 0.0, -1.0, 1.0)
        q[1:] *= np.cumprod(flips)[:, None]
    return smooth
