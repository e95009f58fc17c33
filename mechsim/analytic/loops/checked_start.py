"""Where a motion begins: put together, and with as many drivers as it has freedoms that count."""

from mechsim.analytic.loops.loop_solver import LoopSolver, loop_solver
from mechsim.analytic.loops.redundant_drivers import require_no_redundant_drivers
from mechsim.analytic.loops.tree_assembly import assembled
from mechsim.analytic.loops.tree_loops import tree_loops
from mechsim.analytic.loops.undetermined_joints import require_determined
from mechsim.errors import AssemblyError
from mechsim.model.link_poses import rough_poses, starts
from mechsim.model.mechanism import Mechanism


def checked_start(mechanism: Mechanism) -> LoopSolver:
    """Return what solves the loops of a mechanism about the coordinates in which it begins to move.

    Raises:
        AssemblyError: where the loops do not close at the start.
        MobilityError: where the drivers leave joints or tracked points open, or are too many.
    """
    try:
        loops, start = assembled(mechanism)
    except AssemblyError:
        # drivers that are too many seldom agree to the last digit
        require_no_redundant_drivers(
            loop_solver(*tree_loops(mechanism, rough_poses(mechanism), starts(mechanism)))
        )
        raise
    solver = loop_solver(loops, start)
    require_no_redundant_drivers(solver)
    require_determined(solver)
    return solver
