"""Contacts that never come about."""

import mujoco

from mechsim.studies.reduction.candidate import Candidate, counted
from mechsim.studies.reduction.evidence import Evidence

OFF = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
FAMILY = "contacts"


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to look for no contacts where none came about, else for none of geoms that touched nothing."""
    if seen.spec.option.disableflags & OFF:
        return []
    if not seen.touched:
        return [Candidate(FAMILY, "looking for contacts: nothing touched", _none)]
    apart = [
        geom.name
        for geom in seen.spec.geoms
        if geom.name not in seen.touched and (geom.contype or geom.conaffinity)
    ]
    if not apart:
        return []
    what = f"contacts of {counted(len(apart), 'geom')} that touched nothing"
    return [Candidate(FAMILY, what, lambda spec: _without(spec, apart))]


def _none(spec: mujoco.MjSpec) -> None:
    spec.option.disableflags |= OFF


def _without(spec: mujoco.MjSpec, names: list[str]) -> None:
    for geom in spec.geoms:
        if geom.name in names:
            geom.contype = geom.conaffinity = 0
    for pair in list(spec.pairs):
        if pair.geomname1 in names or pair.geomname2 in names:
            spec.delete(pair)
