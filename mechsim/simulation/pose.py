"""Motion by solving poses: no time, no integration, every crank angle to rounding."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import AssemblyError
from mechsim.mjcf import Loops
from mechsim.simulation.sprint import sprint

Array = NDArray[np.float64]
TURN = 2.0 * np.pi

# the crank's stride in the first walk over the range; the poses between come by interpolation
STRIDE = TURN / 16
# a walk that needs strides below this stands at a dead centre; what lies nearer needs no walk
SHORTEST = 1e-14
# opening of the loops, in units of the stride squared, from which one Newton step leaves an opening
# far below what the next stride is judged by
LOOSE, ROUNDING, MOST_STEPS = 0.05, 1e-13, 8
# a correction longer than this part of the stride may have fallen into the other assembly
SAFE = 0.25
# how far from its start a state may be after a turn to count as the same: rounding of a walk, squared up
SAME = 1e-9
# where so many poses are asked for each knot, the way is first made this much denser: the poses between
# are then closed as they come
MANY, DENSER = 16, 6
# a correction of an interpolated pose that cannot lead into another assembly, and one that may though
# the sign of the Jacobian be the same: measured 2e-7 and 1e-2 at most
SURE, DOUBT = 1e-6, 5e-2
# knots nearer than this to each other in crank angle are too many for a spline, in [rad]
CROWDED = 1e-2
# poses closed in one go: their arrays stay in the cache, and a long run needs little memory
CHUNK = 2048


def follow(loops: Loops, start: Array, angles: ArrayLike) -> Array:
    """Return the states at crank angles in the assembly of a closed start state, (n, nq).

    A sprint over the range, or a walk where that strays, keeps the assembly; splines through its
    poses give the rest to within a Newton step or two, all solved together. Where a turn of the
    crank leads back to the start, one turn is made however many are asked for.

    Args:
        loops: of the model.
        start: closed state, (nq,).
        angles: crank angles in any order, (n,) in [rad].

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    angles = np.asarray(angles, dtype=np.float64)
    here = float(start[loops.crank_place])
    low, high = min(here, float(angles.min())), max(here, float(angles.max()))
    way = None
    if high - low > 1.5 * TURN:
        knots = _knots(loops, start, here, here + TURN)
        gain = _gain(loops, knots)
        way = None if gain is None else Way(loops, knots, gain)
    if way is None:
        way = Way(loops, _knots(loops, start, low, high), None)
    if len(angles) > MANY * len(way.knots):
        way = way.denser()
    parts = [way.at(angles[i : i + CHUNK]) for i in range(0, len(angles), CHUNK)]
    return np.concatenate(parts)


@dataclass(frozen=True)
class Way:
    """The states of an assembly as a function of the crank angle.

    Attributes:
        loops: of the model.
        knots: closed states by rising crank angle, (k, nq).
        gain: what a turn adds to a state, (nq,), where the knots span one turn that leads back; else None.
    """

    loops: Loops
    knots: Array
    gain: Array | None

    def at(self, angles: Array) -> Array:
        """Return closed states at crank angles, (n, nq)."""
        laps = np.zeros(len(angles))
        if self.gain is not None:
            laps = np.floor((angles - self.knots[0, self.loops.crank_place]) / TURN)
        guess = self._guess(angles - laps * TURN)
        if self.gain is not None:
            guess += laps[:, None] * self.gain
        guess[:, self.loops.crank_place] = angles
        try:
            states = self.loops.close(guess)
        except (AssemblyError, FloatingPointError):
            states = np.full_like(guess, np.inf)
        # what moved from where it was expected may have fallen into the other assembly
        doubtful = np.flatnonzero(~(np.abs(states - guess).max(1) < SURE))
        for i in doubtful[self._elsewhere(states[doubtful], guess[doubtful])]:
            states[i] = self._walked_to(float(angles[i]), float(laps[i]))
        return states

    def _elsewhere(self, states: Array, guess: Array) -> NDArray[np.bool_]:
        """Say of states whether they may lie in another assembly than the knots."""
        if len(states) == 0:
            return np.zeros(0, dtype=np.bool_)
        far = ~(np.abs(states - guess).max(1) < DOUBT)
        finite = np.where(np.isfinite(states), states, self.knots[0])
        side = self.loops.side(self.loops.linearise(finite)[1])
        return far | (side * self._side < 0.0)

    @cached_property
    def _side(self) -> float:
        # most of the knots: at a dead centre, where a way may begin or end, rounding settles the sign
        sides = self.loops.side(self.loops.linearise(self.knots)[1])
        return float(np.sign(sides.sum()))

    def denser(self) -> "Way":
        """Return the same way through more knots."""
        first, last = self.knots[[0, -1], self.loops.crank_place]
        if last - first <= STRIDE:
            return self
        more = Way(self.loops, self.knots, None).at(np.linspace(first, last, DENSER * len(self.knots)))
        return Way(self.loops, more, self.gain)

    def _walked_to(self, angle: float, laps: float) -> Array:
        knots = self.knots if self.gain is None else self.knots + laps * self.gain
        nearest = knots[np.argmin(np.abs(knots[:, self.loops.crank_place] - angle))].copy()
        steps = _walk(self.loops, nearest, angle)
        there = steps[-1] if steps else nearest
        there[self.loops.crank_place] = angle
        return self.loops.close(there[None])[0]

    @cached_property
    def _guess(self) -> Callable[[Array], Array]:
        from scipy.interpolate import make_interp_spline

        if len(self.knots) == 1:
            return lambda at: np.repeat(self.knots, len(at), 0)
        knots = _spread(self.knots, self.loops.crank_place)
        degree = min(7, len(knots) - 1)
        degree -= 1 - degree % 2
        at = knots[:, self.loops.crank_place]
        return make_interp_spline(at, _same_sign_quaternions(self.loops, knots), k=degree)


def _spread(knots: Array, place: int) -> Array:
    """Return the knots without those that crowd at a dead centre, where a spline through all is noise."""
    kept = [0]
    for i in range(1, len(knots)):
        if knots[i, place] - knots[kept[-1], place] > CROWDED:
            kept.append(i)
    return knots[kept] if len(kept) > 1 else knots[[0, -1]]


def _gain(loops: Loops, lap: Array) -> Array | None:
    """Return what a turn of the crank adds to a state, (nq,); None where it does not lead back."""
    gain = np.where(loops.turning, 0.0, lap[-1] - lap[0])
    whole = np.where(loops.hinges, TURN * np.round(gain / TURN), 0.0)
    # a passive spin of a ball joint's link need not come back, but whatever lies on its line must
    places = loops.places(lap[[0, -1]])
    back = np.abs(places[1] - places[0]).max(initial=0.0) < SAME * loops.size
    return whole if back and np.abs(gain - whole).max() < SAME else None


def _knots(loops: Loops, start: Array, low: float, high: float) -> Array:
    """Return closed states from a lowest to a highest crank angle, rising, (k, nq)."""
    here = float(start[loops.crank_place])
    before = _way_to(loops, start, low) if here - low > SHORTEST else []
    after = _way_to(loops, start, high) if high - here > SHORTEST else []
    return loops.close(np.stack([*before[::-1], start, *after]))


def _way_to(loops: Loops, start: Array, end: float) -> Sequence[Array]:
    """Return nearly closed states on the way from a closed state to a crank angle, the last one there."""
    if abs(end - start[loops.crank_place]) > STRIDE:
        states = sprint(loops, start, end)
        if states is not None:
            return list(states)
    return _walk(loops, start, end)


def _walk(loops: Loops, start: Array, end: float) -> list[Array]:
    """Return the way by strides, each shown to stay in the assembly."""
    here, stride = start[None], STRIDE
    angle = float(start[loops.crank_place])
    sense = 1.0 if end > angle else -1.0
    jacobian = loops.linearise(here)[1]
    slope, side = loops.tangent(jacobian), loops.side(jacobian)
    bend = np.zeros_like(slope)
    found: list[Array] = []
    while sense * (end - angle) > SHORTEST:
        left = abs(end - angle)
        # no crumb is left for the end
        step = left if left < 1.1 * stride else stride
        target = end if step == left else angle + sense * step
        guess = loops.moved(here, sense * step * slope + 0.5 * step**2 * bend)
        guess[0, loops.crank_place] = target
        there = _landed(loops, here, guess, side)
        if there is None:
            # what is left open of the last pose weighs the more the shorter the stride
            here = loops.close(here)
            slope, bend = loops.tangent(loops.linearise(here)[1]), np.zeros_like(slope)
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


def _landed(loops: Loops, here: Array, guess: Array, side: Array) -> tuple[Array, Array] | None:
    """Return the state that a guess leads to, and its slope; None if that may be another assembly."""
    there = guess
    step_of_crank = float(guess[0, loops.crank_place] - here[0, loops.crank_place])
    for _ in range(MOST_STEPS):
        residual, jacobian = loops.linearise(there)
        try:
            step, slope = loops.newton(residual, jacobian)
        except (np.linalg.LinAlgError, FloatingPointError):
            return None
        there = loops.moved(there, step)
        if np.abs(there - guess).max() > SAFE * np.abs(here - guess).max():
            return None
        if loops.gap(residual)[0] < max(LOOSE * step_of_crank**2, ROUNDING):
            # the last step may have crossed over, too
            landed = loops.side(loops.linearise(there)[1])
            return None if min(loops.side(jacobian) * side, landed * side) < 0.0 else (there, slope)
    return None


def _same_sign_quaternions(loops: Loops, states: Array) -> Array:
    """Return states whose quaternions do not change sign from one to the next: q and -q are the same turn."""
    smooth = states.copy()
    for place in loops.quaternions:
        q = smooth[:, place : place + 4]
        flips = np.where((q[1:] * q[:-1]).sum(1) < 0.0, -1.0, 1.0)
        q[1:] *= np.cumprod(flips)[:, None]
    return smooth
