"""Equality constraints that the others imply."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, NotApplicable
from mechsim.studies.reduction.evidence import Evidence

CATEGORY = "redundant equalities"


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to remove each equality that is inactive or implied by the others."""
    candidates: list[Candidate] = []
    for name in observed.redundant:
        edit = lambda spec, name=name: _without(spec, name)  # noqa: E731
        candidates.append(Candidate(CATEGORY, f"equality {name}, which the others imply", edit))
    return candidates


def _without(spec: mujoco.MjSpec, name: str) -> None:
    equality = spec.equality(name)
    if equality is None:
        raise NotApplicable(f"equality {name} is removed already")
    spec.delete(equality)
