"""The categories of candidates in the order in which they are tried."""

from collections.abc import Callable

from mechsim.studies.reduction import (
    actuators,
    contacts,
    disconnected_bodies,
    fused_bodies,
    joint_polynomials,
    limits,
    locked_joints,
    mirrored_mechanisms,
    passive_chains,
    redundant_equalities,
    rod_lengths,
    springs,
    stepping,
    visual_only,
)
from mechsim.studies.reduction.candidate import Candidate
from mechsim.studies.reduction.evidence import Evidence

CATEGORIES: tuple[Callable[[Evidence], list[Candidate]], ...] = (
    contacts.propose,
    visual_only.propose,
    limits.propose,
    actuators.propose,
    disconnected_bodies.propose,
    mirrored_mechanisms.propose,
    redundant_equalities.propose,
    locked_joints.propose,
    passive_chains.propose,
    joint_polynomials.propose,
    rod_lengths.propose,
    fused_bodies.propose,
    springs.propose,
    stepping.cheaper,
)
# elements that cost time and act on nothing
VISUAL_ONLY = (visual_only.propose, limits.propose, redundant_equalities.propose, fused_bodies.propose)
# tried last; the cheapest within the tolerance is taken
STEPPING = stepping.coarser
