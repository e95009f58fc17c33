"""What drivers settle, by rank at generic poses: freedoms, what stays open, what is asked twice."""

from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.closure.loop_solver import loop_solver
from mechsim.analytic.closure.open_joints import open_names, to_lock
from mechsim.analytic.closure.telling import rank
from mechsim.analytic.closure.tree_assembly import assembled, closed
from mechsim.analytic.closure.tree_loops import TreeLoops, tree_loops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.model.mechanism import Mechanism
from mechsim.model.rough_poses import rough_poses, starts

# how far to either side of its start a mechanism is moved, in [rad] or parts of its size, so that a special
# pose is not taken for the rule
ASIDE = 1e-2


@dataclass(frozen=True, slots=True)
class Settled:
    """What the drivers of a mechanism settle.

    Attributes:
        freedoms: that loops, couplings and holds leave, those that change nothing wanted among them.
        drivers: names of the driven coordinates.
        open: coordinates or points that can move with the drivers held, one for each freedom left open.
        superfluous: drivers and holds that ask for what others settle already.
        redundant: equations of joints and couplings that repeat what others say.
    """

    freedoms: int
    drivers: tuple[str, ...]
    open: tuple[str, ...]
    superfluous: tuple[str, ...]
    redundant: int

    @property
    def outcome(self) -> str:
        """One of "determined", "undetermined" and "overdriven"."""
        return "overdriven" if self.superfluous else "undetermined" if self.open else "determined"


def settled(mechanism: Mechanism) -> Settled:
    """Return what the drivers of a mechanism settle, near where it starts.

    Raises:
        AssemblyError: where the loops do not close.
    """
    asked, best, slope = _generic(mechanism)
    loops = replace(asked, driven=())
    names = (*mechanism.locked, *mechanism.drivers)
    rows, superfluous = slope, list[str]()
    for name in names:
        row = np.zeros((1, loops.tree.count))
        row[0, loops.tree.places[name]] = 1.0
        wider = np.vstack([rows, row])
        if rank(wider) == rank(rows):
            superfluous.append(name)
        else:
            rows = wider
    held = len([name for name in mechanism.locked if name not in superfluous])
    return Settled(
        freedoms=loops.tree.count - rank(slope) - held,
        drivers=mechanism.drivers,
        open=tuple(open_names(loop_solver(asked, best))),
        superfluous=tuple(superfluous),
        redundant=len(slope) - rank(slope),
    )


def undetermined_joints(mechanism: Mechanism) -> tuple[str, ...]:
    """Return what is to be locked so that the drivers determine the rest, as `to_lock` chooses it.

    Raises:
        AssemblyError: where the loops do not close.
    """
    asked, best, _ = _generic(mechanism)
    return to_lock(loop_solver(asked, best))


def _generic(mechanism: Mechanism) -> tuple[TreeLoops, Coordinates, Array]:
    """Return the driven loops, coordinates near the start where their rank is highest, and the slope."""
    asked, rough = tree_loops(mechanism, rough_poses(mechanism), starts(mechanism))
    loops = replace(asked, driven=())
    try:
        start = closed(loops, rough)
    except AssemblyError:  # from there; with the drivers where they start it closes, or is told why not
        asked, start = assembled(mechanism)
        loops = replace(asked, driven=())
    stands = [start, *_aside(loops, start)]
    slopes = [loops.linearise(at)[1][:, :, 0] for at in stands]
    best = int(np.argmax([rank(slope) for slope in slopes]))
    return asked, stands[best], slopes[best]


def _aside(loops: TreeLoops, start: Coordinates) -> list[Coordinates]:
    """Return closed coordinates a little to either side of some, along all that is free."""
    slope = loops.linearise(start)[1][:, :, 0]
    freedoms = np.linalg.svd(slope)[2][rank(slope) :] if len(slope) else np.eye(loops.tree.count)
    if not len(freedoms):
        return []
    # no freedom is left out, and none counts as much as another
    direction = (1.0 + 0.3 * np.arange(len(freedoms))) @ freedoms
    direction /= np.abs(direction).max()
    found: list[Coordinates] = []
    for sense in (1.0, -1.0):
        try:
            found.append(closed(loops, loops.moved(start, sense * ASIDE * direction[:, None])))
        except (AssemblyError, np.linalg.LinAlgError):
            continue  # a dead centre or a locked structure: the other poses tell
    return found
