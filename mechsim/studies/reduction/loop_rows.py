"""Equality constraints that say what others say already."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, NotThere
from mechsim.studies.reduction.evidence import Evidence

FAMILY = "loop rows"


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to leave out each equality that is not active or whose rows the others say already."""
    found: list[Candidate] = []
    for name in seen.redundant:
        edit = lambda spec, name=name: _without(spec, name)  # noqa: E731
        found.append(Candidate(FAMILY, f"equality {name}, which the others say already", edit))
    return found


def _without(spec: mujoco.MjSpec, name: str) -> None:
    equality = spec.equality(name)
    if equality is None:
        raise NotThere(f"equality {name} is left out already")
    spec.delete(equality)
