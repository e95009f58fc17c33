"""The states of an assembly as a function of the crank angle, by interpolation between closed states."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import ChangePoint, closed_near, lagrange_weights
from mechsim.simulation.state import quaternion_addresses

# correction of an interpolated pose up to which it certainly stays in the assembly, and correction from which
# it may not although the determinant's sign is the same: measured 2e-7 and 1e-2 at most
CERTAIN_CORRECTION, MAX_CORRECTION = 1e-6, 5e-2
# (poses per knot, factor): from this number of poses per knot on, the knots are first multiplied by the
# factor, so that one Newton step closes a pose, or none
REFINED = ((32, 8), (4, 2))
# poses closed at once: their arrays fit into the cache, and a long run needs little memory
CHUNK = 2048
# minimum distance of interpolation knots in crank angle, in [rad]; and number of knots of a polynomial
MIN_KNOT_DISTANCE, INTERPOLATION_KNOTS = 1e-2, 10


@dataclass(frozen=True)
class AssemblyPath:
    """The states of an assembly as a function of the crank angle.

    Attributes:
        loops: of the model.
        knots: states by ascending crank angle, (k, nq), closed to within `max_correction`.
        determinant_sign: at the first knot, +1 or -1; 0 if unknown.
        certain_correction: a correction of a pose up to this cannot lead into another assembly.
        max_correction: a correction beyond this may, although the sign is the same.
        change_points: that the path passes smoothly.
    """

    loops: ModelLoops
    knots: Array
    determinant_sign: float
    certain_correction: float = CERTAIN_CORRECTION
    max_correction: float = MAX_CORRECTION
    change_points: tuple[ChangePoint, ...] = ()

    def states_at(
        self, angles: Array, reduced: Array, offset: Array | float = 0.0
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return closed states at crank angles, (n, nq), and which of them certainly lie on the path.

        Args:
            angles: of the crank, (n,).
            reduced: the same by whole revolutions within the range of the path, (n,).
            offset: change of the states by these revolutions, (n, nq).
        """
        guess = self._guess(reduced)
        is_near = np.zeros(len(angles), dtype=np.bool_)
        for change_point in self.change_points:
            close = change_point.contains(reduced)
            guess[close] = change_point.states_at(reduced[close])
            is_near |= close
        guess += offset
        guess[:, self.loops.crank_address] = angles
        if not is_near.any():
            return self._closed(guess, reduced)
        states, certain = guess, is_near.copy()
        states[is_near] = closed_near(self.loops, guess[is_near])
        if not is_near.all():
            states[~is_near], certain[~is_near] = self._closed(guess[~is_near], reduced[~is_near])
        return states, certain

    def sign_changes(self, angles: Array) -> Array:
        """Return +1 where the determinant has the sign of the first knot, -1 where it has changed, (n,)."""
        first = float(self.knots[0, self.loops.crank_address])
        passed = [m.multiplicity * ((angles > m.angle) & (m.angle > first)) for m in self.change_points]
        return (-1.0) ** np.sum(passed, axis=0)

    def _closed(self, guess: Array, reduced: Array) -> tuple[Array, NDArray[np.bool_]]:
        states = loop_jacobian.close_if_possible(self.loops, guess)
        if states is None:
            return guess, np.zeros(len(guess), dtype=np.bool_)
        correction = np.abs(states - guess).max(1)
        certain = correction <= self.certain_correction
        uncertain = np.flatnonzero(~certain)
        if len(uncertain):
            jacobian = self.loops.linearise(states[uncertain])[1]
            same_side = self._on_same_side(jacobian, reduced[uncertain])
            certain[uncertain] = (correction[uncertain] < self.max_correction) & same_side
        return states, certain

    def _on_same_side(self, jacobian: Array, reduced: Array) -> NDArray[np.bool_]:
        """Return whether Jacobians (n, m, nv) have the path's determinant sign at crank angles, (n,)."""
        if self.determinant_sign != 0.0:
            expected = self.determinant_sign * self.sign_changes(reduced)
            return loop_jacobian.determinant_sign(self.loops, jacobian) * expected >= 0.0
        knot_angles = self.knots[:, self.loops.crank_address]
        nearest = np.abs(reduced[:, None] - knot_angles).argmin(1)
        changed = self.sign_changes(reduced) * self.sign_changes(knot_angles[nearest]) < 0.0
        before = self.loops.linearise(self.knots[nearest])[1]
        return loop_jacobian.sign_changed(self.loops, before, jacobian) == changed

    def refined_for(self, count: int) -> "AssemblyPath":
        """Return the path with more knots for many poses; unchanged where new knots are not certain."""
        times = next((factor for poses, factor in REFINED if count > poses * len(self.knots)), 0)
        if not times:
            return self
        first, last = self.knots[[0, -1], self.loops.crank_address]
        angles = np.linspace(first, last, times * len(self.knots))
        knots, certain = self.states_at(angles, angles)
        return (
            replace(self, knots=knots, certain_correction=CERTAIN_CORRECTION, max_correction=MAX_CORRECTION)
            if certain.all()
            else self
        )

    @cached_property
    def _guess(self) -> Callable[[Array], Array]:
        knots = _spaced_knots(self.knots, self.loops.crank_address) if len(self.knots) > 1 else self.knots
        return partial(
            _interpolated, knots[:, self.loops.crank_address], _same_sign_quaternions(self.loops, knots)
        )


def traced_path(loops: ModelLoops, knots: Array, change_points: Sequence[ChangePoint]) -> AssemblyPath:
    """Return the path through traced, nearly closed states by ascending crank angle, (k, nq)."""
    path = AssemblyPath(loops, loop_jacobian.close(loops, knots), 1.0, change_points=tuple(change_points))
    # the majority of the knots: at a dead centre, where a path may start or end, the sign is rounding
    signs = loop_jacobian.determinant_sign(loops, loops.linearise(path.knots)[1]) * path.sign_changes(
        path.knots[:, loops.crank_address]
    )
    return replace(path, determinant_sign=float(np.sign(signs.sum())))


def _interpolated(knot_angles: Array, states: Array, angles: Array) -> Array:
    """Return the polynomial interpolation through the nearest knots, (n, nq).

    Args:
        knot_angles: in ascending order, (k,).
        states: at the knots, (k, nq).
        angles: (n,).
    """
    count = min(INTERPOLATION_KNOTS, len(knot_angles))
    first = np.clip(np.searchsorted(knot_angles, angles) - count // 2, 0, len(knot_angles) - count)
    nearest = first[:, None] + np.arange(count)
    weights = lagrange_weights(knot_angles[nearest], angles)
    return (weights[:, None] @ states[nearest])[:, 0]


def _spaced_knots(knots: Array, address: int) -> Array:
    """Return the knots without those too close together, between which interpolation amplifies rounding."""
    kept = [0]
    for i in range(1, len(knots)):
        if knots[i, address] - knots[kept[-1], address] > MIN_KNOT_DISTANCE:
            kept.append(i)
    return knots[kept] if len(kept) > 1 else knots[[0, -1]]


def _same_sign_quaternions(loops: ModelLoops, states: Array) -> Array:
    """Return states with continuous quaternion signs; q and -q are the same rotation."""
    smooth = states.copy()
    for address in quaternion_addresses(loops.model):
        q = smooth[:, address : address + 4]
        flips = np.where((q[1:] * q[:-1]).sum(1) < 0.0, -1.0, 1.0)
        q[1:] *= np.cumprod(flips)[:, None]
    return smooth


# accuracy of a change point's angle, in [rad], measured 1.5e-11: rates within it are those of the path beyond
CHANGE_POINT_TOLERANCE = 1e-10


@dataclass(frozen=True)
class PosePath:
    """The states over a range of crank angles: smooth paths, each in one assembly, one after the other.

    Attributes:
        pieces: by ascending crank angle; each extends smoothly a little beyond the branch points at its ends.
        change_points: that the path passes, smoothly or from one piece to the next.
        cuts: crank angles between the pieces, ascending, in [rad].
        gain: change of a state by a revolution, (nq,), where the pieces span a closed revolution; else None.
    """

    pieces: tuple[AssemblyPath, ...]
    change_points: tuple[ChangePoint, ...] = ()
    cuts: tuple[float, ...] = ()
    gain: Array | None = None

    def states_at(self, angles: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return closed states at crank angles, (n, nq), and which of them certainly lie on the path."""
        states = np.empty((len(angles), self.pieces[0].knots.shape[1]))
        certain = np.empty(len(angles), dtype=np.bool_)
        for piece, rows, reduced in self.split(angles):
            finer = piece.refined_for(len(rows))
            for first in range(0, len(rows), CHUNK):
                chunk = rows[first : first + CHUNK]
                states[chunk], certain[chunk] = finer.states_at(
                    angles[chunk], reduced[first : first + CHUNK], self._offset(angles[chunk])
                )
        return states, certain

    def nearest_knot(self, angle: Array) -> Array:
        """Return the knot nearest to a crank angle, (1,), by whole revolutions on its side, (nq,)."""
        ((piece, _, _),) = self.split(angle)
        knots = piece.knots + self._offset(angle)
        return knots[np.argmin(np.abs(knots[:, piece.loops.crank_address] - angle))]

    def _offset(self, angles: Array) -> Array | float:
        return 0.0 if self.gain is None else self.revolutions(angles)[:, None] * self.gain

    def split(self, angles: Array) -> Iterator[tuple[AssemblyPath, NDArray[np.intp], Array]]:
        """Yield paths, the indices of the crank angles on each, and these reduced by whole revolutions.

        An angle at a change point belongs to the path beyond it.
        """
        reduced = angles - self.revolutions(angles) * REVOLUTION
        cuts = np.array(self.cuts) - CHANGE_POINT_TOLERANCE
        piece_index = np.searchsorted(cuts, reduced, side="right")
        for i, piece in enumerate(self.pieces):
            rows = np.flatnonzero(piece_index == i)
            if len(rows):
                yield piece, rows, reduced[rows]

    def revolutions(self, angles: Array) -> Array:
        """Return the whole revolutions between crank angles and the range of the pieces, (n,)."""
        if self.gain is None:
            return np.zeros(len(angles))
        first = self.pieces[0]
        return np.floor((angles - first.knots[0, first.loops.crank_address]) / REVOLUTION)

    def near_change_points(self, angles: Array) -> Iterator[tuple[ChangePoint, NDArray[np.intp], Array]]:
        """Yield change points, the indices of crank angles near them, and these reduced as in `split`."""
        for piece, rows, reduced in self.split(angles):
            for change_point in piece.change_points:
                close = np.flatnonzero(change_point.contains(reduced))
                if len(close):
                    yield change_point, rows[close], reduced[close]
