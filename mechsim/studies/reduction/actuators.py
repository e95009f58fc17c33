"""Actuators without a motion law and without force."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, count_text, name_list
from mechsim.studies.reduction.evidence import Evidence

CATEGORY = "actuators"
# largest force of an idle actuator, in [N m] or [N]
MAX_FORCE_AT_REST = 1e-12


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to remove the actuators that no motion law controls and that exerted no force."""
    still = [
        name
        for name, most in observed.forces.items()
        if most <= MAX_FORCE_AT_REST and name not in observed.scene.ctrl
    ]
    if not still:
        return []
    what = f"{count_text(len(still), 'actuator')} at rest: {name_list(still)}"
    return [Candidate(CATEGORY, what, lambda spec: without(spec, still))]


def without(spec: mujoco.MjSpec, names: list[str]) -> None:
    """Remove actuators."""
    for actuator in list(spec.actuators):
        if actuator.name in names:
            spec.delete(actuator)
