"""Candidates for removal by category, in the order in which the search tries them."""

from collections.abc import Callable

from mechsim.studies.reduction.candidates import bodies, elements, rods
from mechsim.studies.reduction.reduced_scene import Evidence

CATEGORIES: tuple[Callable[[Evidence], list[bodies.RemovalCandidate]], ...] = (
    elements.contacts,
    elements.visual_elements,
    elements.limits,
    elements.actuators,
    bodies.disconnected_bodies,
    elements.redundant_equalities,
    bodies.locked_joints,
    rods.passive_chains,
    rods.rods_as_lengths,
    bodies.fused_bodies,
    elements.springs,
)
