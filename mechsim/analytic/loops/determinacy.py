"""What the drivers determine, by rank at generic poses: undetermined joints and redundant drivers."""

from dataclasses import dataclass, replace

import numpy as np

from mechsim.analytic.loops.loop_solver import loop_solver
from mechsim.analytic.loops.numerical_rank import rank
from mechsim.analytic.loops.tree_assembly import assembled, closed
from mechsim.analytic.loops.tree_loops import TreeLoops, tree_loops
from mechsim.analytic.loops.tree_motion import Coordinates
from mechsim.analytic.loops.undetermined_joints import joints_to_lock, undetermined_names
from mechsim.errors import AssemblyError
from mechsim.model.link_poses import rough_poses, starts
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# how far to either side of its start a mechanism is moved, in [rad] or parts of its size, so that a special
# pose is not taken for the rule
DISPLACEMENT = 1e-2


@dataclass(frozen=True, slots=True)
class Determinacy:
    """What the drivers of a mechanism determine.

    Attributes:
        dofs: degrees of freedom left by loops, couplings and locked joints, passive ones included.
        drivers: names of the driven coordinates.
        undetermined: coordinates or points that can move while the drivers stand, one for each
            undetermined degree of freedom.
        redundant_drivers: drivers and locked joints that others determine already.
        redundant_equations: dependent equations of joints and couplings.
    """

    dofs: int
    drivers: tuple[str, ...]
    undetermined: tuple[str, ...]
    redundant_drivers: tuple[str, ...]
    redundant_equations: int

    @property
    def outcome(self) -> str:
        """One of "determined", "underdetermined" and "overdetermined"."""
        return (
            "overdetermined"
            if self.redundant_drivers
            else "underdetermined"
            if self.undetermined
            else "determined"
        )


def driver_determinacy(mechanism: Mechanism) -> Determinacy:
    """Return what the drivers of a mechanism determine near its initial pose.

    Raises:
        AssemblyError: where the loops do not close.
    """
    loops_driven, q, jacobian = _generic_pose(mechanism)
    loops = replace(loops_driven, driven=())
    names = (*mechanism.locked, *mechanism.drivers)
    rows, redundant = jacobian, list[str]()
    for name in names:
        row = np.zeros((1, loops.tree.count))
        row[0, loops.tree.index_of[name]] = 1.0
        wider = np.vstack([rows, row])
        if rank(wider) == rank(rows):
            redundant.append(name)
        else:
            rows = wider
    locked = len([name for name in mechanism.locked if name not in redundant])
    return Determinacy(
        dofs=loops.tree.count - rank(jacobian) - locked,
        drivers=mechanism.drivers,
        undetermined=tuple(undetermined_names(loop_solver(loops_driven, q))),
        redundant_drivers=tuple(redundant),
        redundant_equations=len(jacobian) - rank(jacobian),
    )


def undetermined_joints(mechanism: Mechanism) -> tuple[str, ...]:
    """Return what is to be locked so that the drivers determine the rest, as `joints_to_lock` chooses it.

    Raises:
        AssemblyError: where the loops do not close.
    """
    loops_driven, q, _ = _generic_pose(mechanism)
    return joints_to_lock(loop_solver(loops_driven, q))


def _generic_pose(mechanism: Mechanism) -> tuple[TreeLoops, Coordinates, Array]:
    """Return the driven loops, coordinates near the start where their rank is highest, and the slope."""
    loops_driven, guess = tree_loops(mechanism, rough_poses(mechanism), starts(mechanism))
    loops = replace(loops_driven, driven=())
    try:
        start = closed(loops, guess)
    except AssemblyError:  # from there; with the drivers where they start it closes, or is told why not
        loops_driven, start = assembled(mechanism)
        loops = replace(loops_driven, driven=())
    poses = [start, *_displaced_poses(loops, start)]
    jacobians = [loops.linearise(q)[1][:, :, 0] for q in poses]
    best = int(np.argmax([rank(jacobian) for jacobian in jacobians]))
    return loops_driven, poses[best], jacobians[best]


def _displaced_poses(loops: TreeLoops, start: Coordinates) -> list[Coordinates]:
    """Return closed coordinates a little to either side of some, along all that is free."""
    jacobian = loops.linearise(start)[1][:, :, 0]
    freedoms = np.linalg.svd(jacobian)[2][rank(jacobian) :] if len(jacobian) else np.eye(loops.tree.count)
    if not len(freedoms):
        return []
    # no freedom is left out, and none counts as much as another
    direction = (1.0 + 0.3 * np.arange(len(freedoms))) @ freedoms
    direction /= np.abs(direction).max()
    poses: list[Coordinates] = []
    for sign in (1.0, -1.0):
        try:
            poses.append(closed(loops, loops.displaced(start, sign * DISPLACEMENT * direction[:, None])))
        except (AssemblyError, np.linalg.LinAlgError):
            continue  # a dead centre or an immobile structure: the other poses decide
    return poses
