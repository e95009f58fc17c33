"""Where two assemblies of a model meet, and how a path that runs smoothly goes through there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops

# crank angles about a meeting at which the path is closed and between which it is interpolated, in [rad],
# their number, and the degree by which rates are
WINDOW, POINTS, DEGREE = 0.25, 48, 22
# nearer than this the loops hardly hold the pose
BLIND = 1.5e-2
# singular values below this part of the largest belong to directions in which they do not hold it there
HELD = 0.05
# what a polynomial may miss the path by, in [rad] or [m], to be it
SMOOTH = 1e-12
# distances at which it is looked whether the determinant passes zero in a straight line, near last, and
# by what part of its slope it may bend there
SPREADS, BENT = (1e-2, 1e-4, 3e-7), 0.2
# pairs of assemblies that may meet at once, with the side changed and without
ODD, EVEN = (1, 3, 5), (2, 4)
# by how much a path is known farther each time where it bends too sharply to be foretold at once
WIDER = 3.0


@dataclass(frozen=True)
class Meeting:
    """Where two assemblies meet, and the path through it.

    Attributes:
        angle: of the crank, in [rad].
        nodes: crank angles on both sides, (k,).
        states: closed there, (k, nq).
        pairs: of assemblies that meet at once; an odd number of them changes the side.
    """

    angle: float
    nodes: Array
    states: Array
    pairs: int = 1

    @property
    def reach(self) -> float:
        """How far the path is known on both sides, in [rad]."""
        return float(np.abs(self.nodes - self.angle).max())

    def near(self, angles: Array) -> NDArray[np.bool_]:
        """Return which crank angles are so near that poses are read off the path, (n,)."""
        return np.abs(angles - self.angle) < BLIND

    def at(self, angles: Array) -> Array:
        """Return states at crank angles near by, (n, nq)."""
        return fitted(self.nodes, self.angle, angles) @ self.states


def weights(nodes: Array, at: Array) -> Array:
    """Return Lagrange's weights of values at nodes (k,) for angles in between, (n, k)."""
    found = np.ones((len(at), len(nodes)))
    for k, node in enumerate(nodes):
        others = np.delete(nodes, k)
        found[:, k] = np.prod((at[:, None] - others) / (node - others), axis=1)
    return found


def fitted(nodes: Array, about: float, at: Array) -> Array:
    """Return weights of values at nodes (k,) for angles close to a meeting, (n, k): a polynomial's fit.

    The nearest nodes count least: rates there are lost to rounding as the inverse cube of the distance.
    """
    reach = float(np.abs(nodes - about).max())
    basis = np.polynomial.chebyshev.chebvander((nodes - about) / reach, DEGREE)
    trust = np.abs((nodes - about) / reach) ** 3
    asked = np.polynomial.chebyshev.chebvander((at - about) / reach, DEGREE)
    return asked @ (np.linalg.pinv(trust[:, None] * basis, rcond=1e-12) * trust)


def settled(loops: ModelLoops, states: Array) -> Array:
    """Return states close to a meeting moved by what closes the loops in all directions that they hold."""
    for _ in range(2):
        residual, jacobian = loops.linearise(states)
        step = np.zeros((len(states), loops.model.nv))
        step[:, loops.free] = -(
            np.linalg.pinv(loops.constrained_jacobian(jacobian), rcond=HELD) @ residual[..., None]
        )[..., 0]
        states = loops.displaced(states, step)
    return states


def determinant(loops: ModelLoops, states: Array) -> Array:
    """Return the determinant of the loops with the crank held, to some scale of its own, (n,)."""
    return loops.determinant(loops.linearise(states)[1])


def meeting_between(loops: ModelLoops, before: Array, beyond: Array) -> Meeting | None:
    """Return where two assemblies, or several pairs of them, meet between two closed states of a smooth path.

    States are (nq,). None where assemblies only come near each other: there the determinant bends away from
    zero. Where several pairs meet at once, its root of their number passes zero in a straight line.
    """
    place = loops.crank_address
    low, high = before[place], beyond[place]
    chord = _Chord(loops, np.stack([before, beyond]))
    first = chord.closed(low + (high - low) * np.array([0.0, 0.21, 0.83, 1.0]))
    if first is None:
        return None
    heights = determinant(loops, first)
    kept = bool(heights[0] * heights[-1] > 0.0)
    for pairs in EVEN if kept else ODD:
        found = _met(loops, _Chord(loops, first), heights, pairs)
        if found is not None:
            return found
    return None


def _met(loops: ModelLoops, chord: "_Chord", heights: Array, pairs: int) -> Meeting | None:
    """Return the meeting of so many pairs of assemblies between four closed states, or None."""
    angles = chord.states[:, loops.crank_address]
    low, high = angles[[0, -1]]
    ends = np.abs(heights[[0, -1]]) ** (1.0 / pairs)
    at = float(low + (high - low) * ends[0] / ends.sum()) if pairs > 1 else _zero(angles, heights)
    slope, wide = 0.0, chord
    for spread in (*_widening(abs(high - low)), *SPREADS):
        around = at + spread * np.array([-2.0, -1.0, 1.0, 2.0])
        states = chord.closed(around)
        if states is None:
            return None
        found = _root(determinant(loops, states), pairs, around < at)
        if not (np.sign(found[[0, 1]]) == -np.sign(found[[2, 3]])).all():
            return None
        steep = float(found[3] - found[0]) / (4.0 * spread)
        if spread == SPREADS[-1]:
            straight = np.abs(found - slope * (around - at)).max() < BENT * abs(slope) * spread
            return _passed(loops, at, wide, pairs) if straight else None
        at, chord = _zero(around, found), _Chord(loops, states)
        if spread == SPREADS[0]:
            slope, wide = steep, chord
    return None


def _root(heights: Array, pairs: int, before: NDArray[np.bool_]) -> Array:
    """Return the root that passes zero in a straight line where so many pairs of assemblies meet, (n,)."""
    if pairs % 2:
        return np.sign(heights) * np.abs(heights) ** (1.0 / pairs)
    return np.where(before, 1.0, -1.0) * np.abs(heights) ** (1.0 / pairs)


def _widening(known: float) -> list[float]:
    """Return distances by which a path that is known over a short way is known over the first of SPREADS."""
    spreads: list[float] = []
    while known < SPREADS[0]:
        known *= WIDER
        spreads.append(known / 2.0)
    return spreads


@dataclass(frozen=True)
class _Chord:
    """Closed states in a row, by which others are guessed."""

    loops: ModelLoops
    states: Array

    def closed(self, angles: Array, far: float = 0.2) -> Array | None:
        """Return closed states at crank angles, (n, nq); None where they are not sure."""
        known = self.states[:, self.loops.crank_address]
        guess = weights(known, angles) @ self.states
        guess[:, self.loops.crank_address] = angles
        try:
            states = self.loops.close(guess)
        except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
            return None
        moved = np.abs(states - guess).max()
        reach = np.abs(self.states - self.states.mean(0)).max()
        return states if moved < far * max(reach, np.abs(angles - known.mean()).max()) else None


def _zero(at: Array, heights: Array) -> float:
    """Return where the polynomial through four heights is zero, the nearest to the line's."""
    middle, reach = float(at.mean()), float(np.ptp(at))
    line = -heights[0] * (at[-1] - at[0]) / (heights[-1] - heights[0]) + at[0]
    roots = np.polynomial.Polynomial.fit(at, heights, 3).roots()
    real = roots[np.abs(roots.imag) < 1e-9 * reach].real
    return float(real[np.argmin(np.abs(real - line))]) if len(real) else middle


def _passed(
    loops: ModelLoops, angle: float, chord: _Chord, pairs: int, window: float = WINDOW
) -> Meeting | None:
    """Return the path through a meeting, closed at angles ever farther from it.

    The window is halved until a polynomial is the path.
    """
    near = np.cos(np.pi * (np.arange(POINTS) + 0.5) / POINTS) * window
    half = np.sort(near[near > 0.0])
    known = chord
    offsets: list[float] = []
    states: list[Array] = []
    for offset in half:
        pair = known.closed(angle + np.array([-offset, offset]))
        if pair is None:
            return None
        offsets += [-offset, offset]
        states += list(pair)
        if offset > 2.5 * SPREADS[0]:
            # the farthest foretell the next best
            known = _Chord(loops, np.concatenate([known.states, pair])[-6:])
    order = np.argsort(offsets)
    rows = np.stack(states)[order]
    # the loops hold a pose the less the nearer it lies: a last step, to rounding
    rows = loops.displaced(rows, loops.newton_step(*loops.linearise(rows))[0])
    nodes = angle + np.array(offsets)[order]
    smooth = np.abs(fitted(nodes, angle, nodes) @ rows - rows)[np.abs(nodes - angle) > 0.3 * window].max()
    if smooth > SMOOTH and window > 4.0 * BLIND:
        return _passed(loops, angle, chord, pairs, 0.5 * window)
    return Meeting(angle, nodes, rows, pairs)
