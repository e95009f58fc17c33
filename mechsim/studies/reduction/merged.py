"""Bodies without joints, which are part of the body they hang on."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, NotThere, counted
from mechsim.studies.reduction.evidence import Evidence

FAMILY = "merged bodies"


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to merge all bodies without joints with those they hang on, except what is tracked."""
    bodies = [
        body for body in list(seen.spec.bodies)[1:] if not body.joints and body.name not in seen.tracked
    ]
    if not bodies:
        return []
    what = f"{counted(len(bodies), 'body', 'bodies')} without joints, merged with what they hang on"
    return [Candidate(FAMILY, what, lambda spec: _merged(spec, seen.tracked))]


def _merged(spec: mujoco.MjSpec, tracked: frozenset[str]) -> None:
    for name in tracked:
        spec.body(name).fuse = 0
    if not spec.fuse_static():
        raise NotThere("no body can be merged")
