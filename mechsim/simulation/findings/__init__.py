"""Checks a scene before it runs; each finding has a size, a line in the file and a remedy."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from mechsim.mechanism.finding import Finding
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.mechanism.motion_laws import CRANK, MotionLaws
from mechsim.simulation.findings import loop_closure
from mechsim.simulation.findings.actuation import controls_beyond_range, fighting
from mechsim.simulation.findings.compliance import compliant_loops, refsafe, timestep
from mechsim.simulation.findings.damping import negative_losses, too_stiff_for_step
from mechsim.simulation.findings.implausible_numbers import impossible, mistaken_units
from mechsim.simulation.findings.initial_state import collisions, outside_limits_at_start
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.findings.rule_table import with_severity
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel

__all__ = ["findings", "findings_in"]


# checks in the order of their findings: errors that break a run, effects that distort it, and notes
CHECKS: tuple[Callable[[Inspected], Iterator[Finding]], ...] = (
    timestep,
    too_stiff_for_step,
    loop_closure.gaps,
    mistaken_units,
    impossible,
    negative_losses,
    outside_limits_at_start,
    collisions,
    loop_closure.duplicate_loops,
    fighting,
    controls_beyond_range,
    refsafe,
    compliant_loops,
    loop_closure.undetermined,
    loop_closure.redundant_constraints,
)


def findings(read: MjcfModel, motion_laws: MotionLaws = CRANK) -> tuple[Finding, ...]:
    """Return the findings of a scene, most severe first.

    Args:
        read: the file as read.
        motion_laws: motion laws of the drivers; with `CRANK`, checks of a motion use a swing of the drivers.
    """
    return findings_in(Inspected(read, motion_laws))


@quiet()
def findings_in(scene: Inspected) -> tuple[Finding, ...]:
    """Return the findings of a scene, most severe first."""
    result: list[Finding] = []
    for check in CHECKS:
        # another check reports the cause of an overflow or a singular matrix
        with suppress(FloatingPointError, np.linalg.LinAlgError):
            result += check(scene)
    # virtual bodies and joints of pose drivers are not in the file
    return tuple(
        with_severity(finding) for finding in result if not finding.object.startswith(VIRTUAL_PREFIX)
    )
