"""The table of what may be left out of a scene, cheapest to leave out first."""

from collections.abc import Callable

from mechsim.studies.reduction import (
    actuators,
    apart,
    contacts,
    limits,
    loop_rows,
    ornaments,
    springs,
    stepping,
    still_joints,
)
from mechsim.studies.reduction.candidate import Candidate
from mechsim.studies.reduction.evidence import Evidence

FAMILIES: tuple[Callable[[Evidence], list[Candidate]], ...] = (
    contacts.propose,
    ornaments.propose,
    limits.propose,
    actuators.propose,
    apart.propose,
    loop_rows.propose,
    still_joints.propose,
    springs.propose,
    stepping.cheaper,
)
# of these the cheapest that holds is taken, last of all
LAST = stepping.coarser
