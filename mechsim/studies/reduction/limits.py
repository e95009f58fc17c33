"""Limits that are never reached."""

from collections.abc import Collection

import mujoco

from mechsim.studies.reduction.candidate import Candidate, counted
from mechsim.studies.reduction.evidence import Evidence

FAMILY = "limits"
NONE = int(mujoco.mjtLimited.mjLIMITED_FALSE)


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to take away all limits at which nothing stood."""
    model = seen.model
    joints = [model.joint(j).name for j in range(model.njnt) if model.jnt_limited[j]]
    tendons = [model.tendon(t).name for t in range(model.ntendon) if model.tendon_limited[t]]
    free = [name for name in (*joints, *tendons) if name not in seen.limited]
    found: list[Candidate] = []
    if free:
        what = f"{counted(len(free), 'limit')} that {'was' if len(free) == 1 else 'were'} never reached"
        found.append(Candidate(FAMILY, what, lambda spec: _without(spec, free)))
    for name in (*joints, *tendons):
        if name in seen.limited:
            edit = lambda spec, names=(name,): _without(spec, names)  # noqa: E731
            found.append(Candidate(FAMILY, f"limit of {name}", edit, pays=True))
    return found


def _without(spec: mujoco.MjSpec, names: Collection[str]) -> None:
    for part in (*spec.joints, *spec.tendons):
        if part.name in names:
            part.limited = NONE
