"""Loop equations of any mechanism: public names of `mechsim.kinematics.loops`."""

from mechsim.kinematics.loops.maximal_coordinates import Rows, equations, residual_norms
from mechsim.kinematics.loops.mobility import DofCount, dof_count
from mechsim.kinematics.loops.motion import assemble, conditioning, solve
from mechsim.kinematics.vector_method.rotations import turned_by
from mechsim.mechanism.link_poses import guessed_poses
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
