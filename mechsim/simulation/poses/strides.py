"""The path of an assembly by strides short enough that each is shown to stay in it."""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses.meetings import WINDOW, Meeting, determinant, meeting_between, settled

# the crank's longest stride
STRIDE = 2.0 * np.pi / 16
# a walk that needs strides below this stands at a dead centre; what lies nearer needs no walk
SHORTEST = 1e-14
# opening of the loops, in units of the stride squared, from which one Newton step leaves an opening
# far below what the next stride is judged by
LOOSE, ROUNDING, MOST_STEPS = 0.05, 1e-13, 8
# a correction longer than this part of the stride may have fallen into the other assembly
SAFE = 0.25
# a zero of the determinant this near, in [rad], is looked at: assemblies may meet there
TRIED = 0.05


@dataclass(frozen=True)
class Strides:
    """States on a path, by rising distance from its start, and the meetings of assemblies it passed."""

    states: list[Array]
    meetings: list[Meeting]


def walk(loops: ModelLoops, start: Array, end: float) -> Strides:
    """Return nearly closed states on the path from a closed state to a crank angle, the last one there.

    Where two assemblies meet on a smooth path, it goes on smoothly.

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    here, stride = start[None], STRIDE
    angle = float(start[loops.crank_place])
    sense = 1.0 if end > angle else -1.0
    jacobian = loops.linearise(here)[1]
    slope, side, height = loops.tangent(jacobian), loops.side(jacobian), loops.determinant(jacobian)[0]
    bend, sinking, trial = np.zeros_like(slope), 0.0, TRIED
    found: list[Array] = []
    passed: list[Meeting] = []
    while sense * (end - angle) > SHORTEST:
        left = abs(end - angle)
        # where the determinant comes to zero, another assembly comes near
        ahead = height / sinking if height * sinking > 0.0 else np.inf
        if ahead < trial:
            trial = 0.03 * ahead
            beyond = loops.moved(here, 3.0 * sense * ahead * slope + 4.5 * ahead**2 * bend)
            meeting = _tried(loops, here[0], beyond, angle + 3.0 * sense * ahead)
            if meeting is not None:
                passed.append(meeting)
                rows = meeting.states[:: int(sense)]
                rows = rows[sense * (rows[:, loops.crank_place] - angle) > 0.0]
                inside = rows[sense * (end - rows[:, loops.crank_place]) >= 0.0]
                found += list(inside)
                if len(inside) < len(rows):
                    found.append(_within(loops, meeting, end))
                    break
                here = rows[-1:]
                angle = float(here[0, loops.crank_place])
                jacobian = loops.linearise(here)[1]
                slope, side = loops.tangent(jacobian), loops.side(jacobian)
                height = loops.determinant(jacobian)[0]
                bend, sinking, trial, stride = np.zeros_like(slope), 0.0, TRIED, WINDOW
                continue
        stride = min(stride, max(0.7 * ahead, SHORTEST))
        # a stride a tenth longer saves a last one that would be next to nothing
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
                    f"{loops.name}: the {_passing(loops, angle)} in this assembly; "
                    "stay on this side of the dead centre or change the dimensions"
                )
            continue
        here, slope_there = there
        low = loops.determinant(loops.linearise(here)[1])[0]
        sinking, height = (height - low) / step, low
        trial = max(trial, 0.03 * height / sinking) if height * sinking > 0.0 else TRIED
        trial = min(trial, TRIED)
        bend = sense * (slope_there - slope) / step
        slope, angle = slope_there, target
        found.append(here[0])
        stride = min(2.0 * step, STRIDE)
    return Strides(found, passed)


def _passing(loops: ModelLoops, angle: float) -> str:
    if loops.drive is None:
        return f"crank cannot pass {angle:.7g} rad"
    return f"drivers cannot pass {loops.said(angle)}"


def _tried(loops: ModelLoops, here: Array, beyond: Array, angle: float) -> Meeting | None:
    """Return the meeting between a closed state and a rough one beyond it; None where there is none."""
    beyond[0, loops.crank_place] = angle
    try:
        closed = loops.close(beyond)
    except (AssemblyError, FloatingPointError, np.linalg.LinAlgError):
        return None
    if np.abs(closed - beyond).max() > SAFE * np.abs(here - beyond).max():
        return None
    heights = determinant(loops, np.stack([here, closed[0]]))
    return meeting_between(loops, here, closed[0]) if heights[0] * heights[1] < 0.0 else None


def _within(loops: ModelLoops, meeting: Meeting, angle: float) -> Array:
    """Return the state at a crank angle close to a meeting, (nq,)."""
    state = meeting.at(np.array([angle]))
    state[0, loops.crank_place] = angle
    return (settled(loops, state) if meeting.near(np.array([angle]))[0] else loops.close(state))[0]


def _landed(loops: ModelLoops, here: Array, guess: Array, side: Array) -> tuple[Array, Array] | None:
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
