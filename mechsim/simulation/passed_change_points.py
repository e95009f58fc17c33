"""Change points that a stepped motion passes, and the notes and errors about them."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.motion_laws import CrankProfile
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.poses import follow
from mechsim.simulation.poses.assembly_path import AssemblyPath
from mechsim.simulation.poses.branch_path import FoldedPath

# crank angles at which a profile is probed
PROBES = 64
# distance from a change point, in [rad], below which the start is at it: poses there are rounded as much
AT_START = 1e-6
# distance in [rad] by which a path is followed beyond the first crank angle
BEYOND = 0.05


def passed_change_points(closed: ClosedModel, profile: CrankProfile) -> list[float]:
    """Return the angles of the crank, or values of the path parameter, of the change points passed, in [rad].

    Raises:
        AssemblyError: where the loops do not close on it.
    """
    angle = profile.state(np.linspace(0.0, profile.duration, PROBES))[0]
    path = _path(closed, angle)
    low, high = float(angle.min()), float(angle.max())
    laps = (0.0,) if path.gain is None else (-TURN, 0.0, TURN)
    first = float(path.laps(angle[:1])[0]) * TURN
    met = [m.angle + first + lap for m in path.meetings for lap in laps]
    return sorted(at for at in met if low - AT_START <= at <= high + AT_START)


def _path(closed: ClosedModel, angles: Array) -> AssemblyPath | FoldedPath:
    """Return the path over crank angles (n,), extended a little beyond the first of them where possible.

    A branch point is confirmed only after the path has passed it, and the model may start on either side.
    """
    first = float(angles[0])
    behind = BEYOND * np.sign(first - closed.angle)
    with suppress(AssemblyError):
        return follow.followed(closed.loops, closed.qpos, np.append(angles, first + behind))[1]
    return follow.followed(closed.loops, closed.qpos, angles)[1]


def change_points_text(loops: ModelLoops, met: Sequence[float]) -> str:
    """Return the positions of change points as text."""
    if loops.drivers is not None:
        return ", ".join(loops.driver_text(at) for at in met[:3])
    return f"crank angle {', '.join(f'{at:.4g}' for at in met[:3])} rad"


def undecided_note(loops: ModelLoops, met: Sequence[float]) -> str:
    """Return the note that dynamics do not determine the branch; empty without change points."""
    if not met:
        return ""
    return (
        f"at {change_points_text(loops, met)} two assemblies meet, and dynamics alone cannot decide which "
        "one goes on: hold it by a second parallel crank or a flywheel, take more steps, or run it by pose"
    )


def require_regular_start(loops: ModelLoops, met: Sequence[float], start: float) -> None:
    """Reject a time-stepped run that starts at a change point.

    Raises:
        AssemblyError: with the crank angle or the driver values.
    """
    if any(abs(at - start) <= AT_START for at in met):
        raise AssemblyError(
            f"{loops.name}: it starts at {loops.driver_text(start)}, where two assemblies meet and dynamics "
            "alone cannot decide which one goes on; give a start at "
            f"{'another crank angle' if loops.drivers is None else 'other values of the drivers'}, "
            "hold it by a second parallel crank, or run it by pose"
        )
