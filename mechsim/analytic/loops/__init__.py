"""Loop equations of any mechanism: residual, Jacobian, rates, rank and assembly.

They are independent of closed forms. For given poses every moving link has six coordinates, and each joint
has constraint equations (`equations`). Whole motions are solved in the coordinates of a spanning tree
(`solve`), for all poses together.
"""

from mechsim.analytic.loops.maximal_coordinates import Rows, equations, residual_norms
from mechsim.analytic.loops.mobility import DofCount, dof_count
from mechsim.analytic.loops.motion import solve
from mechsim.analytic.loops.oracle import assemble, conditioning, rates, singular_values
from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.model.link_poses import guessed_poses
from mechsim.numerics.rank import RANK_TOLERANCE

__all__ = [
    "RANK_TOLERANCE",
    "DofCount",
    "Rows",
    "assemble",
    "conditioning",
    "dof_count",
    "equations",
    "guessed_poses",
    "rates",
    "residual_norms",
    "singular_values",
    "solve",
    "turned_by",
]
