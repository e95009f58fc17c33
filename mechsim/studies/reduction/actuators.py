"""Actuators at rest: none of the user's, and without force."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, counted, listed
from mechsim.studies.reduction.evidence import Evidence

FAMILY = "actuators"
# largest force of an actuator at rest, in [N m] or [N]
REST = 1e-12


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to leave out the actuators that no program feeds and that did nothing."""
    still = [name for name, most in seen.efforts.items() if most <= REST and name not in seen.scene.ctrl]
    if not still:
        return []
    what = f"{counted(len(still), 'actuator')} at rest: {listed(still)}"
    return [Candidate(FAMILY, what, lambda spec: without(spec, still))]


def without(spec: mujoco.MjSpec, names: list[str]) -> None:
    """Leave out actuators."""
    for actuator in list(spec.actuators):
        if actuator.name in names:
            spec.delete(actuator)
