"""The kinds of findings, the gravest first, and all of them of one scene."""

from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from mechsim.model.finding import Finding
from mechsim.model.programs import Programs
from mechsim.simulation.findings.actuation import fighting
from mechsim.simulation.findings.beyond_limits import beyond
from mechsim.simulation.findings.contacts import collisions
from mechsim.simulation.findings.freedoms import left_open
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.findings.loop_closure import doubled, gaps, repeated
from mechsim.simulation.findings.masses import impossible
from mechsim.simulation.findings.softness import refsafe, soft, timestep
from mechsim.simulation.findings.units_mistaken import mistaken
from mechsim.simulation.mjcf_reader import MjcfModel

# what is looked for, in the order in which it is told: what breaks a run, what bends it, what is to be known
LOOKED_FOR: tuple[Callable[[Inspected], Iterator[Finding]], ...] = (
    timestep,
    gaps,
    mistaken,
    impossible,
    beyond,
    collisions,
    doubled,
    fighting,
    refsafe,
    soft,
    left_open,
    repeated,
)


def findings(read: MjcfModel, programs: Programs | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with a scene, the gravest first.

    Args:
        read: what was read of its file.
        programs: of its drivers; None looks at a swing of them where a motion is needed.
    """
    scene = Inspected(read, programs)
    found: list[Finding] = []
    for look in LOOKED_FOR:
        # a state so wrong that it overflows is what other looks have found
        with suppress(FloatingPointError, np.linalg.LinAlgError):
            found += look(scene)
    return tuple(found)
