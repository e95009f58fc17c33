"""Candidates for removal by category, in the order in which the search tries them."""

from collections.abc import Callable

from mechsim.studies.reduction.candidates import elements, rods
from mechsim.studies.reduction.reduced_scene import Evidence

CATEGORIES: tuple[Callable[[Evidence], list[elements.RemovalCandidate]], ...] = (
    elements.contacts,
    elements.visual_elements,
    elements.limits,
    elements.actuators,
    elements.disconnected_bodies,
    elements.redundant_equalities,
    elements.locked_joints,
    rods.passive_chains,
    rods.rods_as_lengths,
    elements.fused_bodies,
    elements.springs,
)
