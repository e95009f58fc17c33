"""Candidates for removal by category, in the order in which the search tries them."""

from collections.abc import Callable

from mechsim.studies.reduction.candidates.bodies import (
    RemovalCandidate,
    disconnected_bodies,
    fused_bodies,
    locked_joints,
)
from mechsim.studies.reduction.candidates.elements import (
    actuators,
    contacts,
    limits,
    redundant_equalities,
    springs,
    visual_elements,
)
from mechsim.studies.reduction.candidates.rods import passive_chains, rods_as_lengths
from mechsim.studies.reduction.reduced_scene import Evidence

CATEGORIES: tuple[Callable[[Evidence], list[RemovalCandidate]], ...] = (
    contacts,
    visual_elements,
    limits,
    actuators,
    disconnected_bodies,
    redundant_equalities,
    locked_joints,
    passive_chains,
    rods_as_lengths,
    fused_bodies,
    springs,
)
