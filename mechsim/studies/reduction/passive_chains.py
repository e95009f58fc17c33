"""Chains that close a loop, or hang, and only weigh: fused where they stand, halfway through the motion."""

from functools import partial

import mujoco

from mechsim.maths.arrays import Array
from mechsim.studies.reduction.candidate import Candidate, NotThere, counted, listed
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.rods import LooseChain, kept_bodies, loose_chains
from mechsim.studies.reduction.still_joints import fuse_at, require_unused

FAMILY = "passive chains"


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to fuse each chain that nothing needs, and each leaf."""
    found = [
        Candidate(
            FAMILY,
            f"loop {one.closing} with {counted(len(one.joints), 'joint')}, {listed(list(one.joints))}: fused",
            partial(_fused, chain=one, places=_places(seen, one.joints)),
        )
        for one in loose_chains(seen)
    ]
    for name in _leaves(seen):
        joints = tuple(joint.name for joint in seen.spec.body(name).joints)
        what = f"{counted(len(joints), 'joint')} of {name}, of which nothing is tracked: fused"
        chain = LooseChain("", "", "", (name,), joints)
        found.append(Candidate(FAMILY, what, partial(_fused, chain=chain, places=_places(seen, joints))))
    return found


def _leaves(seen: Evidence) -> list[str]:
    """Return the bodies that nothing hangs on, closes a loop with, or needs."""
    spec, kept = seen.spec, kept_bodies(seen)
    ends = {name for one in spec.equalities for name in (one.name1, one.name2) if name}
    closed = {site.parent.name for site in spec.sites if site.name in ends}
    return [
        body.name
        for body in spec.bodies
        if body.joints
        and body.name not in kept | closed | ends
        and not body.find_all("body")
        and all(joint.type != mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)
    ]


def _places(seen: Evidence, joints: tuple[str, ...]) -> dict[str, Array]:
    """Return the coordinates of joints halfway through the motion."""
    model, state = seen.model, seen.qpos[len(seen.qpos) // 2]
    found: dict[str, Array] = {}
    for name in joints:
        place = int(model.joint(name).qposadr[0])
        width = 4 if int(model.joint(name).type[0]) == int(mujoco.mjtJoint.mjJNT_BALL) else 1
        found[name] = state[place : place + width].copy()
    return found


def _fused(spec: mujoco.MjSpec, chain: LooseChain, places: dict[str, Array]) -> None:
    equality = spec.equality(chain.closing) if chain.closing else None
    if chain.closing and equality is None:
        raise NotThere(f"loop {chain.closing} is left out already")
    if any(spec.joint(name) is None for name in chain.joints):
        raise NotThere(f"{listed(list(chain.joints))} are left out already")
    if equality is not None:
        spec.delete(equality)
    for name in chain.joints:
        require_unused(spec, name)
    for name, value in places.items():
        fuse_at(spec, name, value)
