"""Contacts that never occur."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, count_text
from mechsim.studies.reduction.evidence import Evidence

OFF = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
CATEGORY = "contacts"


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to disable contacts if none occurred, otherwise those of geoms that touched nothing."""
    if observed.spec.option.disableflags & OFF:
        return []
    if not observed.touched:
        return [Candidate(CATEGORY, "looking for contacts: nothing touched", _none)]
    apart = [
        geom.name
        for geom in observed.spec.geoms
        if geom.name not in observed.touched and (geom.contype or geom.conaffinity)
    ]
    if not apart:
        return []
    what = f"contacts of {count_text(len(apart), 'geom')} that touched nothing"
    return [Candidate(CATEGORY, what, lambda spec: _without(spec, apart))]


def _none(spec: mujoco.MjSpec) -> None:
    spec.option.disableflags |= OFF


def _without(spec: mujoco.MjSpec, names: list[str]) -> None:
    for geom in spec.geoms:
        if geom.name in names:
            geom.contype = geom.conaffinity = 0
    for pair in list(spec.pairs):
        if pair.geomname1 in names or pair.geomname2 in names:
            spec.delete(pair)
