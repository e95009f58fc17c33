"""Springs, dampers and Coulomb friction with little effect."""

from typing import Any

import mujoco
import numpy as np

from mechsim.studies.reduction.candidate import Candidate
from mechsim.studies.reduction.evidence import Evidence

CATEGORY = "springs"
# field of a joint or tendon -> its name in messages
KINDS = {
    "frictionloss": "dry friction",
    "stiffness": "spring",
    "damping": "damper",
}


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to remove each kind from all joints and tendons that have it, and from each one."""
    candidates: list[Candidate] = []
    for field, what in KINDS.items():
        elements = (*observed.spec.joints, *observed.spec.tendons)
        # in a prescribed joint these only change the drive force
        names = [
            element.name
            for element in elements
            if _has(element, field) and element.name not in observed.scene.drive
        ]
        if not names:
            continue
        if len(names) > 1:
            edit = lambda spec, names=tuple(names), field=field: _without(spec, names, field)  # noqa: E731
            candidates.append(
                Candidate(
                    CATEGORY, f"{what} of all {len(names)} joints that have one", edit, only_if_faster=True
                )
            )
        for name in names:
            edit = lambda spec, names=(name,), field=field: _without(spec, names, field)  # noqa: E731
            candidates.append(Candidate(CATEGORY, f"{what} of {name}", edit, only_if_faster=True))
    return candidates


def _has(element: Any, field: str) -> bool:
    return bool(np.any(np.asarray(getattr(element, field)) != 0.0))


def _without(spec: mujoco.MjSpec, names: tuple[str, ...], field: str) -> None:
    for element in (*spec.joints, *spec.tendons):
        if element.name in names:
            setattr(element, field, 0.0 if field == "frictionloss" else np.zeros(3))
