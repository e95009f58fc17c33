"""Loop equations of any mechanism: public names of `mechsim.analytic.loops`."""

from mechsim.analytic.loops.maximal_coordinates import Rows, equations, residual_norms
from mechsim.analytic.loops.mobility import DofCount, dof_count
from mechsim.analytic.loops.motion import assemble, conditioning, solve
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
    "residual_norms",
    "solve",
    "turned_by",
]
