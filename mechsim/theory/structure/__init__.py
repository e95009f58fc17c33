"""Structure of a mechanism: how many freedoms it has and why, and the Assur groups it is built of."""

from mechsim.theory.structure.assur import AssurGroup, Decomposition, assur_groups
from mechsim.theory.structure.mobility_count import FreeMotion, Mobility, mobility
from mechsim.theory.structure.planar import plane_normal

__all__ = [
    "AssurGroup",
    "Decomposition",
    "FreeMotion",
    "Mobility",
    "assur_groups",
    "mobility",
    "plane_normal",
]
