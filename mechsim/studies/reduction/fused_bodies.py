"""Bodies without joints, fused with their parents."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, NotApplicable, count_text
from mechsim.studies.reduction.evidence import Evidence

CATEGORY = "fused bodies"


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to fuse all bodies without joints with their parents, except tracked bodies."""
    bodies = [
        body
        for body in list(observed.spec.bodies)[1:]
        if not body.joints and body.name not in observed.tracked
    ]
    if not bodies:
        return []
    what = f"{count_text(len(bodies), 'body', 'bodies')} without joints, fused with their parents"
    return [Candidate(CATEGORY, what, lambda spec: _fused(spec, observed.tracked))]


def _fused(spec: mujoco.MjSpec, tracked: frozenset[str]) -> None:
    for name in tracked:
        spec.body(name).fuse = 0
    if not spec.fuse_static():
        raise NotApplicable("no body can be fused")
