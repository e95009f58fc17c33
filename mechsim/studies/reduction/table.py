"""The table of what may be left out of a scene, cheapest to leave out first."""

from collections.abc import Callable

from mechsim.studies.reduction import (
    actuators,
    apart,
    contacts,
    joint_polynomials,
    limits,
    loop_rows,
    merged,
    ornaments,
    passive_chains,
    rod_lengths,
    springs,
    stepping,
    still_joints,
    twins,
)
from mechsim.studies.reduction.candidate import Candidate
from mechsim.studies.reduction.evidence import Evidence

FAMILIES: tuple[Callable[[Evidence], list[Candidate]], ...] = (
    contacts.propose,
    ornaments.propose,
    limits.propose,
    actuators.propose,
    apart.propose,
    twins.propose,
    loop_rows.propose,
    still_joints.propose,
    passive_chains.propose,
    joint_polynomials.propose,
    rod_lengths.propose,
    merged.propose,
    springs.propose,
    stepping.cheaper,
)
# of what costs time and acts on nothing
ORNAMENTS = (ornaments.propose, limits.propose, loop_rows.propose, merged.propose)
# of these the cheapest that holds is taken, last of all
LAST = stepping.coarser
