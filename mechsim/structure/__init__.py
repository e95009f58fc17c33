"""Structure of a mechanism: how many freedoms it has and why, and the Assur groups it is built of."""

from mechsim.structure.assur import AssurGroup, Decomposition, assur_groups
from mechsim.structure.free_motion import FreeMotion
from mechsim.structure.mobility import Mobility, mobility
from mechsim.structure.planar import plane_normal

__all__ = [
    "AssurGroup",
    "Decomposition",
    "FreeMotion",
    "Mobility",
    "assur_groups",
    "mobility",
    "plane_normal",
]
