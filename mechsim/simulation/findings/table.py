"""The kinds of findings, the gravest first, and all of them of one scene."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from mechsim.model.finding import Finding
from mechsim.model.motion_laws import MotionLaws
from mechsim.simulation.findings.actuation import fighting
from mechsim.simulation.findings.beyond_limits import outside_limits
from mechsim.simulation.findings.compliance import compliant_loops, refsafe, timestep
from mechsim.simulation.findings.contacts import collisions
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.findings.loop_closure import duplicate_loops, gaps, redundant_constraints
from mechsim.simulation.findings.masses import impossible
from mechsim.simulation.findings.undetermined_dofs import undetermined
from mechsim.simulation.findings.units_mistaken import mistaken_units
from mechsim.simulation.mjcf_reader import MjcfModel

# what is looked for, in the order in which it is told: what breaks a run, what bends it, what is to be known
CHECKS: tuple[Callable[[Inspected], Iterator[Finding]], ...] = (
    timestep,
    gaps,
    mistaken_units,
    impossible,
    outside_limits,
    collisions,
    duplicate_loops,
    fighting,
    refsafe,
    compliant_loops,
    undetermined,
    redundant_constraints,
)


def findings(read: MjcfModel, motion_laws: MotionLaws | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with a scene, the gravest first.

    Args:
        read: what was read of its file.
        motion_laws: of its drivers; None looks at a swing of them where a motion is needed.
    """
    scene = Inspected(read, motion_laws)
    result: list[Finding] = []
    for check in CHECKS:
        # a state so wrong that it overflows is what other looks have found
        with suppress(FloatingPointError, np.linalg.LinAlgError):
            result += check(scene)
    return tuple(result)
