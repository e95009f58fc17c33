"""Springs, dampers and dry friction that hardly act."""

from typing import Any

import mujoco
import numpy as np

from mechsim.studies.reduction.candidate import Candidate
from mechsim.studies.reduction.evidence import Evidence

FAMILY = "springs"
# what a joint may have that acts with rows or by itself
KINDS = {
    "frictionloss": "dry friction",
    "stiffness": "spring",
    "damping": "damper",
}


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to take each kind away from all joints and tendons that have it, and each by itself."""
    found: list[Candidate] = []
    for field, what in KINDS.items():
        parts = (*seen.spec.joints, *seen.spec.tendons)
        # where a joint is prescribed these are of the drive's effort alone
        names = [part.name for part in parts if _has(part, field) and part.name not in seen.scene.drive]
        if not names:
            continue
        if len(names) > 1:
            edit = lambda spec, names=tuple(names), field=field: _without(spec, names, field)  # noqa: E731
            found.append(
                Candidate(FAMILY, f"{what} of all {len(names)} joints that have one", edit, pays=True)
            )
        for name in names:
            edit = lambda spec, names=(name,), field=field: _without(spec, names, field)  # noqa: E731
            found.append(Candidate(FAMILY, f"{what} of {name}", edit, pays=True))
    return found


def _has(part: Any, field: str) -> bool:
    return bool(np.any(np.asarray(getattr(part, field)) != 0.0))


def _without(spec: mujoco.MjSpec, names: tuple[str, ...], field: str) -> None:
    for part in (*spec.joints, *spec.tendons):
        if part.name in names:
            setattr(part, field, 0.0 if field == "frictionloss" else np.zeros(3))
