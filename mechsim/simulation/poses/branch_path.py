"""The states of a mechanism that goes on in the other assembly wherever two meet."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.assembly_path import AssemblyPath, walked_path
from mechsim.simulation.poses.change_points import BLIND, Meeting, determinant
from mechsim.simulation.poses.trace import SHORTEST, walk

# turn by which it is seen how the loops bend at a meeting; what of that must be left if the other assembly
# is to be left by turning the crank; how far from where it is foretold that may be found, as a part of its
# distance; and how often the stretch is halved for that
APART, BENT, BESIDE, HALVINGS = 1e-4, 1e-6, 0.3, 6
# to this a meeting is known, in [rad], measured 1.5e-11: rates there are those beyond it
JOINT = 1e-10


@dataclass(frozen=True)
class FoldedPath:
    """Smooth paths, each of one assembly, from each meeting to the next.

    Attributes:
        pieces: by rising crank angle; each goes on smoothly a little beyond the meetings at its ends.
        meetings: between them.
        gain: what a turn adds to a state, (nq,), where the pieces span one turn that leads back; else None.
    """

    pieces: tuple[AssemblyPath, ...]
    meetings: tuple[Meeting, ...]
    gain: Array | None = None

    def parts(self, angles: Array) -> Iterator[tuple[AssemblyPath, NDArray[np.intp], Array]]:
        """Yield paths, which of some crank angles lie on each, and these without the laps.

        At a meeting they are of the path beyond.
        """
        turned = angles - self.laps(angles) * TURN
        of = np.searchsorted(self._cuts - JOINT, turned, side="right")
        for i, piece in enumerate(self.pieces):
            rows = np.flatnonzero(of == i)
            if len(rows):
                yield piece, rows, turned[rows]

    def laps(self, angles: Array) -> Array:
        """Return the whole turns to take off crank angles so that they lie between the ends, (n,)."""
        if self.gain is None:
            return np.zeros(len(angles))
        first = self.pieces[0]
        return np.floor((angles - first.knots[0, first.loops.crank_address]) / TURN)

    def blind(self, angles: Array) -> Iterator[tuple[Meeting, NDArray[np.intp], Array]]:
        """Yield meetings, which of some crank angles are so near that the loops say nothing, and these."""
        for piece, rows, turned in self.parts(angles):
            for meeting, close, near in piece.blind(turned):
                yield meeting, rows[close], near

    @cached_property
    def _cuts(self) -> Array:
        return np.array([meeting.angle for meeting in self.meetings])


@dataclass(frozen=True)
class _Leg:
    """States from one meeting to the next, as walked, and the meetings near its ends."""

    states: list[Array]
    meetings: list[Meeting]


def folded(loops: ModelLoops, start: Array, low: float, high: float) -> FoldedPath:
    """Return the path from a closed state (nq,) that folds at each meeting between two crank angles.

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close, or the path cannot fold.
    """
    back, before = _legs(loops, start, low)
    ahead, after = _legs(loops, start, high)
    first = _Leg([*back[0].states[::-1], start, *ahead[0].states], back[0].meetings + ahead[0].meetings)
    backward = [_Leg(leg.states[::-1], leg.meetings) for leg in back[:0:-1]]
    pieces = [
        walked_path(loops, np.stack(leg.states), leg.meetings) for leg in [*backward, first, *ahead[1:]]
    ]
    return FoldedPath(tuple(pieces), (*before[::-1], *after))


def _legs(loops: ModelLoops, start: Array, end: float) -> tuple[list[_Leg], list[Meeting]]:
    """Return the legs from a closed state to a crank angle, by the distance from it, and what they passed."""
    place = loops.crank_address
    sense = 1.0 if end > start[place] else -1.0
    legs, passed = [_Leg([], [])], list[Meeting]()
    here = start
    while sense * (end - here[place]) > SHORTEST:
        ahead = walk(loops, here, end, through=False)
        last = legs[-1]
        legs[-1] = _Leg(last.states + ahead.states, last.meetings + ahead.meetings)
        met = [one for one in ahead.meetings if sense * (end - one.angle) >= 0.0]
        if not met:
            break
        passed += met
        here = _beside(loops, met[0], sense)
        # what lies between the meeting and there, and a little of what lies before it
        back = walk(loops, here, met[0].angle - sense * BLIND, through=False)
        legs.append(_Leg([*back.states[::-1], here], back.meetings))
    return legs, passed


def _beside(loops: ModelLoops, meeting: Meeting, sense: float) -> Array:
    """Return the closed state (nq,) a little beyond a meeting in the assembly that is met there.

    The loops' determinant is a x on this assembly's path at x beyond the meeting, and 2 b z aside of it in
    the direction that the loops leave free there; so they say z (a x + b z), which is nought again at
    z = -a x / b.

    Raises:
        AssemblyError: where the crank does not turn in the other one.
    """
    at = np.array([meeting.angle])
    here = meeting.at(at)
    free = loops.least_constrained_direction(loops.linearise(here)[1])
    along = meeting.at(at + APART * np.array([-1.0, 1.0]))
    aside = loops.displaced(here.repeat(2, 0), APART * np.array([[-1.0], [1.0]]) * free)
    heights = determinant(loops, np.concatenate([along, aside]))
    a, b = heights[1] - heights[0], 0.5 * (heights[3] - heights[2])
    away = meeting.reach / 2.0 if abs(b) > BENT * abs(a) else 0.0
    for _ in range(HALVINGS if away else 0):
        beyond = meeting.at(at + sense * away)
        beyond[:, loops.crank_address] = at + sense * away
        step = -a / b * sense * away * free
        guess = loops.displaced(beyond, step[None])
        found = _closed(loops, guess)
        if found is not None and np.abs(found - guess).max() < BESIDE * np.abs(step).max():
            sides = determinant(loops, np.concatenate([beyond, found]))
            if sides[0] * sides[1] < 0.0:
                return found[0]
        away *= 0.5
    who = "the crank" if loops.drivers is None else "the drivers"
    raise AssemblyError(
        f"{loops.name}: {who} cannot pass {loops.driver_text(meeting.angle)} by folding, for it does not "
        "turn in the assembly that is met there; go on smoothly"
    )


def _closed(loops: ModelLoops, guess: Array) -> Array | None:
    try:
        return loops.close(guess)
    except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
        return None
