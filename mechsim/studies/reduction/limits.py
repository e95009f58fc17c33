"""Limits that are never reached."""

from collections.abc import Collection

import mujoco

from mechsim.studies.reduction.candidate import Candidate, count_text
from mechsim.studies.reduction.evidence import Evidence

CATEGORY = "limits"
NONE = int(mujoco.mjtLimited.mjLIMITED_FALSE)


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to remove all limits that were never reached, and each of the others."""
    model = observed.model
    joints = [model.joint(j).name for j in range(model.njnt) if model.jnt_limited[j]]
    tendons = [model.tendon(t).name for t in range(model.ntendon) if model.tendon_limited[t]]
    free = [name for name in (*joints, *tendons) if name not in observed.limited]
    candidates: list[Candidate] = []
    if free:
        what = f"{count_text(len(free), 'limit')} that {'was' if len(free) == 1 else 'were'} never reached"
        candidates.append(Candidate(CATEGORY, what, lambda spec: _without(spec, free)))
    for name in (*joints, *tendons):
        if name in observed.limited:
            edit = lambda spec, names=(name,): _without(spec, names)  # noqa: E731
            candidates.append(Candidate(CATEGORY, f"limit of {name}", edit, only_if_faster=True))
    return candidates


def _without(spec: mujoco.MjSpec, names: Collection[str]) -> None:
    for element in (*spec.joints, *spec.tendons):
        if element.name in names:
            element.limited = NONE
