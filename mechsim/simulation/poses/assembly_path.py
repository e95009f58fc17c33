"""The states of an assembly as a function of the crank angle, by polynomials through some of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import Meeting, settled

# a correction of a pose interpolated between closed ones that cannot lead into another assembly, and one
# that may though the side be the same: measured 2e-7 and 1e-2 at most
SURE, DOUBT = 1e-6, 5e-2
# knots nearer than this to each other in crank angle are too many for a polynomial, in [rad]; and knots in a
# row that tell the states between them
CROWDED, TELLING = 1e-2, 10


@dataclass(frozen=True)
class AssemblyPath:
    """The states of an assembly as a function of the crank angle.

    Attributes:
        loops: of the model.
        knots: states by rising crank angle, (k, nq), closed to within `far`.
        gain: what a turn adds to a state, (nq,), where the knots span one turn that leads back; else None.
        side: on which side of the dead centres its first knot lies, +1 or -1; 0 where that is not known.
        near: a correction of a pose up to this cannot lead into another assembly.
        far: a correction beyond this may, though the side be the same.
        meetings: of assemblies, which the path passes smoothly.
    """

    loops: ModelLoops
    knots: Array
    gain: Array | None
    side: float
    near: float = SURE
    far: float = DOUBT
    meetings: tuple[Meeting, ...] = ()

    def at(self, angles: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return closed states at crank angles, (n, nq), and which lie on the path for sure."""
        laps = self.laps(angles)
        turned = angles - laps * TURN
        guess = self._guess(turned)
        near = np.zeros(len(angles), dtype=np.bool_)
        for meeting in self.meetings:
            close = meeting.near(turned)
            guess[close] = meeting.at(turned[close])
            near |= close
        if self.gain is not None:
            guess += laps[:, None] * self.gain
        guess[:, self.loops.crank_address] = angles
        if near.any():
            states, sure = guess, near.copy()
            states[near] = settled(self.loops, guess[near])
            if not near.all():
                states[~near], sure[~near] = self._closed(guess[~near], turned[~near])
            return states, sure
        return self._closed(guess, turned)

    def blind(self, angles: Array) -> Iterator[tuple[Meeting, NDArray[np.intp], Array]]:
        """Yield meetings, which of some crank angles are so near that the loops say nothing, and these.

        The angles without the laps, as the meeting's is counted.
        """
        turned = angles - self.laps(angles) * TURN
        for meeting in self.meetings:
            close = np.flatnonzero(meeting.near(turned))
            if len(close):
                yield meeting, close, turned[close]

    def changes(self, angles: Array) -> Array:
        """Return +1 where the path lies on its first knot's side, -1 where it has changed it, (n,)."""
        first = float(self.knots[0, self.loops.crank_address])
        passed = [m.pairs * ((angles > m.angle) & (m.angle > first)) for m in self.meetings]
        return (-1.0) ** np.sum(passed, axis=0)

    def _closed(self, guess: Array, turned: Array) -> tuple[Array, NDArray[np.bool_]]:
        try:
            states, jacobian = self.loops.close_with_jacobian(guess)
        except (AssemblyError, FloatingPointError):
            return guess, np.zeros(len(guess), dtype=np.bool_)
        moved = np.abs(states - guess).max(1)
        sure = moved <= self.near
        doubtful = np.flatnonzero(~sure)
        if len(doubtful):
            if jacobian is None:
                jacobian = self.loops.linearise(states)[1]
            sure[doubtful] = (moved[doubtful] < self.far) & self._kept(jacobian[doubtful], turned[doubtful])
        return states, sure

    def _kept(self, jacobian: Array, turned: Array) -> NDArray[np.bool_]:
        """Return whether states with Jacobians (n, m, nv) lie on the path's side at crank angles, (n,)."""
        if self.side != 0.0:
            return self.loops.determinant_sign(jacobian) * self.side * self.changes(turned) >= 0.0
        places = self.knots[:, self.loops.crank_address]
        nearest = np.abs(turned[:, None] - places).argmin(1)
        changed = self.changes(turned) * self.changes(places[nearest]) < 0.0
        before = self.loops.linearise(self.knots[nearest])[1]
        return self.loops.sign_changed(before, jacobian) == changed

    def laps(self, angles: Array) -> Array:
        """Return the whole turns to take off crank angles so that they lie between the knots, (n,)."""
        if self.gain is None:
            return np.zeros(len(angles))
        return np.floor((angles - self.knots[0, self.loops.crank_address]) / TURN)

    def refined(self, times: int) -> "AssemblyPath":
        """Return the same path through so many times its knots, closed; the same where that is not sure."""
        first, last = self.knots[[0, -1], self.loops.crank_address]
        knots, sure = self.at(np.linspace(first, last, times * len(self.knots)))
        return replace(self, knots=knots, near=SURE, far=DOUBT) if sure.all() else self

    @cached_property
    def _guess(self) -> Callable[[Array], Array]:
        knots = _spread(self.knots, self.loops.crank_address) if len(self.knots) > 1 else self.knots
        return partial(
            _between, knots[:, self.loops.crank_address], _same_sign_quaternions(self.loops, knots)
        )


def walked_path(
    loops: ModelLoops, knots: Array, meetings: Sequence[Meeting], gain: Array | None = None
) -> AssemblyPath:
    """Return the path through nearly closed states by rising crank angle, (k, nq), that were walked."""
    path = AssemblyPath(loops, loops.close(knots), gain, 1.0, meetings=tuple(meetings))
    # most of the knots: at a dead centre, where a path may begin or end, rounding settles the sign
    sides = loops.determinant_sign(loops.linearise(path.knots)[1]) * path.changes(
        path.knots[:, loops.crank_address]
    )
    return replace(path, side=float(np.sign(sides.sum())))


def _between(places: Array, states: Array, at: Array) -> Array:
    """Return what the polynomials through the nearest knots tell between them, (n, nq).

    Args:
        places: of the knots, rising, (k,).
        states: there, (k, nq).
        at: places, (n,).
    """
    count = min(TELLING, len(places))
    first = np.clip(np.searchsorted(places, at) - count // 2, 0, len(places) - count)
    found = np.zeros((len(at), states.shape[1]))
    for i in range(count):
        others = np.delete(np.arange(count), i)
        near = places[first[:, None] + others]
        weight = ((at[:, None] - near) / (places[first + i][:, None] - near)).prod(1)
        found += weight[:, None] * states[first + i]
    return found


def _spread(knots: Array, place: int) -> Array:
    """Return the knots without those that crowd at a dead centre, where a polynomial through all is noise."""
    kept = [0]
    for i in range(1, len(knots)):
        if knots[i, place] - knots[kept[-1], place] > CROWDED:
            kept.append(i)
    return knots[kept] if len(kept) > 1 else knots[[0, -1]]


def _same_sign_quaternions(loops: ModelLoops, states: Array) -> Array:
    """Return states whose quaternions do not change sign from one to the next: q and -q are the same turn."""
    smooth = states.copy()
    for place in loops.quaternions:
        q = smooth[:, place : place + 4]
        flips = np.where((q[1:] * q[:-1]).sum(1) < 0.0, -1.0, 1.0)
        q[1:] *= np.cumprod(flips)[:, None]
    return smooth
