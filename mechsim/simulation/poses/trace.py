"""The path of an assembly by strides short enough that each is shown to stay in it."""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.change_points import WINDOW, Meeting, meeting_between, settled

# the crank's longest stride
STRIDE = 2.0 * np.pi / 16
# how far a stride may lead any joint, in [rad] or sizes: a correction that is a part of more could be a leap
LONGEST = 0.5
# a walk that needs strides below this stands at a dead centre; what lies nearer needs no walk
SHORTEST = 1e-14
# opening of the loops, in units of the stride squared, from which one Newton step leaves an opening
# far below what the next stride is judged by
LOOSE, ROUNDING, MOST_STEPS = 0.05, 1e-13, 8
# a correction longer than this part of the stride may have fallen into the other assembly; one that is such
# a part of a fine stride is rounding: 1e-14 rad from a dead centre the other assembly is 1e-7 rad away
SAFE, FINE = 0.25, 1e-11
# a zero of the determinant this near, in [rad], is looked at: assemblies may meet there
TRIED = 0.05
# how many times as far as the determinant's tangent has its zero it is looked what lies beyond: where several
# pairs of assemblies meet at once, so many times as far is the zero
BEYOND = (3.0, 6.0)
# step by which it is seen how the determinant sinks where a walk begins, in [rad]
BEGUN = 1e-6


@dataclass(frozen=True)
class Strides:
    """States on a path, by rising distance from its start, and the meetings of assemblies it passed."""

    states: list[Array]
    meetings: list[Meeting]


def walk(loops: ModelLoops, start: Array, end: float, *, through: bool = True) -> Strides:
    """Return nearly closed states on the path from a closed state to a crank angle, the last one there.

    Where two assemblies meet on a smooth path, it goes on smoothly; unless it goes `through`, it ends a
    little beyond the first such meeting.

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    angle = float(start[loops.crank_address])
    walker = _Walker(loops, end, 1.0 if end > angle else -1.0, start[None])
    while walker.sense * (end - walker.angle) > SHORTEST and not walker.arrived:
        meeting = walker.meeting_ahead()
        if meeting is None:
            walker.stride_on()
        elif through:
            walker.pass_through(meeting)
        else:
            return Strides([*walker.found, *walker.beyond(meeting)], [meeting])
    return Strides(walker.found, walker.passed)


class _Walker:
    """A walk along a path: where it stands, how the path goes on there, and what it has passed.

    Attributes:
        here: the state, (1, nq).
        angle: of the crank there, in [rad].
        slope, bend: first and second derivative of the state by the crank angle there.
        height: determinant of the loops there.
        sinking: how fast the determinant has come nearer to zero, per radian.
        trial: a zero of it nearer than this, in [rad], is looked at.
        stride: the next one at the most, in [rad].
        arrived: whether the end was reached within a meeting.
    """

    def __init__(self, loops: ModelLoops, end: float, sense: float, start: Array):
        self.loops, self.end, self.sense = loops, end, sense
        self.found: list[Array] = []
        self.passed: list[Meeting] = []
        self.arrived = False
        self._stand(start, STRIDE)

    def _stand(self, here: Array, stride: float) -> None:
        """Stand at a state as if the walk began there."""
        jacobian = self.loops.linearise(here)[1]
        self.here, self.angle = here, float(here[0, self.loops.crank_address])
        self.slope, self.side = self.loops.tangent(jacobian), self.loops.determinant_sign(jacobian)
        self.height = self.loops.determinant(jacobian)[0]
        self.bend = np.zeros_like(self.slope)
        # a first stride past a meeting could end in the other assembly
        beside = self.loops.displaced(here, BEGUN * self.sense * self.slope)
        low = self.loops.determinant(self.loops.linearise(beside)[1])[0]
        self.sinking = (self.height - low) / BEGUN
        self.trial, self.stride = TRIED, stride

    @property
    def ahead(self) -> float:
        """How far off the determinant comes to zero, where another assembly comes near, in [rad]."""
        return self.height / self.sinking if self.height * self.sinking > 0.0 else np.inf

    def meeting_ahead(self) -> Meeting | None:
        """Return the meeting of assemblies just ahead; None where there is none to be looked for."""
        ahead = self.ahead
        if ahead >= self.trial:
            return None
        self.trial = 0.03 * ahead
        for times in BEYOND:
            far = times * self.sense * ahead
            beyond = self.loops.displaced(self.here, far * self.slope + 0.5 * far**2 * self.bend)
            meeting = _tried(self.loops, self.here[0], beyond, self.angle + far)
            if meeting is not None:
                return meeting
        return None

    def beyond(self, meeting: Meeting) -> Array:
        """Return the states of a meeting that are not behind, (k, nq)."""
        rows = meeting.states[:: int(self.sense)]
        return rows[self.sense * (rows[:, self.loops.crank_address] - self.angle) > 0.0]

    def pass_through(self, meeting: Meeting) -> None:
        """Go to the far side of a meeting, or to the end where that is within it."""
        self.passed.append(meeting)
        rows = self.beyond(meeting)
        inside = rows[self.sense * (self.end - rows[:, self.loops.crank_address]) >= 0.0]
        self.found += list(inside)
        if len(inside) < len(rows):
            self.found.append(_within(self.loops, meeting, self.end))
            self.arrived = True
        else:
            self._stand(rows[-1:], WINDOW)

    def stride_on(self) -> None:
        """Go one stride, or make the next one shorter where it could lead into another assembly."""
        loops, sense = self.loops, self.sense
        longest = LONGEST / max(loops.max_rate(self.slope), 1.0)
        self.stride = min(self.stride, max(min(0.7 * self.ahead, longest), SHORTEST))
        # a stride a tenth longer saves a last one that would be next to nothing
        left = abs(self.end - self.angle)
        step = left if left < 1.1 * self.stride else self.stride
        target = self.end if step == left else self.angle + sense * step
        guess = loops.displaced(self.here, sense * step * self.slope + 0.5 * step**2 * self.bend)
        guess[0, loops.crank_address] = target
        there = _landed(loops, self.here, guess, self.side)
        if there is None:
            self._shorten(step / 2.0)
            return
        self.here, slope = there
        low = loops.determinant(loops.linearise(self.here)[1])[0]
        self.sinking, self.height = (self.height - low) / step, low
        self.trial = min(max(self.trial, 0.03 * self.ahead), TRIED)
        self.bend = sense * (slope - self.slope) / step
        self.slope, self.angle = slope, target
        self.found.append(self.here[0])
        self.stride = min(2.0 * step, STRIDE)

    def _shorten(self, stride: float) -> None:
        """Close the state, for what is left open weighs the more the shorter the stride, and shorten that."""
        if stride < SHORTEST:
            raise AssemblyError(
                f"{self.loops.name}: the {_passing(self.loops, self.angle)} in this assembly; "
                "stay on this side of the dead centre or change the dimensions"
            )
        self.here = self.loops.close(self.here)
        self.slope = self.loops.tangent(self.loops.linearise(self.here)[1])
        self.bend, self.stride = np.zeros_like(self.slope), stride


def _passing(loops: ModelLoops, angle: float) -> str:
    if loops.drivers is None:
        return f"crank cannot pass {angle:.7g} rad"
    return f"drivers cannot pass {loops.driver_text(angle)}"


def _tried(loops: ModelLoops, here: Array, beyond: Array, angle: float) -> Meeting | None:
    """Return the meeting between a closed state and a rough one beyond it; None where there is none."""
    beyond[0, loops.crank_address] = angle
    try:
        closed = loops.close(beyond)
    except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
        return None
    if np.abs(closed - beyond).max() > SAFE * np.abs(here - beyond).max():
        return None
    return meeting_between(loops, here, closed[0])


def _within(loops: ModelLoops, meeting: Meeting, angle: float) -> Array:
    """Return the state at a crank angle close to a meeting, (nq,)."""
    state = meeting.at(np.array([angle]))
    state[0, loops.crank_address] = angle
    return (settled(loops, state) if meeting.near(np.array([angle]))[0] else loops.close(state))[0]


def _landed(loops: ModelLoops, here: Array, guess: Array, side: Array) -> tuple[Array, Array] | None:
    """Return the state that a guess leads to, and its slope; None if that may be another assembly."""
    there = guess
    step_of_crank = float(guess[0, loops.crank_address] - here[0, loops.crank_address])
    for _ in range(MOST_STEPS):
        residual, jacobian = loops.linearise(there)
        try:
            step, slope = loops.newton_step(residual, jacobian)
        except (np.linalg.LinAlgError, FloatingPointError):
            return None
        there = loops.displaced(there, step)
        if np.abs(there - guess).max() > SAFE * max(np.abs(here - guess).max(), FINE):
            return None
        if loops.closure_error(residual)[0] < max(LOOSE * step_of_crank**2, ROUNDING):
            # the last step may have crossed over, too
            reached = np.concatenate([jacobian, loops.linearise(there)[1]])
            sides = loops.determinant_sign(reached) * side
            if not sides.all():
                before = loops.linearise(here)[1].repeat(2, 0)
                sides = np.where(loops.sign_changed(before, reached), -1.0, 1.0)
            return None if sides.min() < 0.0 else (there, slope)
    return None
