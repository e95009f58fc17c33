"""Passive chains, which only add mass: fused in the pose halfway through the motion."""

from functools import partial

import mujoco

from mechsim.numerics.arrays import Array
from mechsim.studies.reduction.candidate import Candidate, NotApplicable, count_text, name_list
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.locked_joints import fuse_joint_at, require_unused
from mechsim.studies.reduction.rods import LooseChain, kept_bodies, loose_chains

CATEGORY = "passive chains"


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to fuse each passive chain and each passive leaf body."""
    candidates = [
        Candidate(
            CATEGORY,
            f"loop {chain.closing} with {count_text(len(chain.joints), 'joint')}, "
            f"{name_list(list(chain.joints))}: fused",
            partial(_fused, chain=chain, coordinates=_coordinates(observed, chain.joints)),
        )
        for chain in loose_chains(observed)
    ]
    for name in _leaves(observed):
        joints = tuple(joint.name for joint in observed.spec.body(name).joints)
        what = f"{count_text(len(joints), 'joint')} of {name}, of which nothing is tracked: fused"
        chain = LooseChain("", "", "", (name,), joints)
        candidates.append(
            Candidate(
                CATEGORY, what, partial(_fused, chain=chain, coordinates=_coordinates(observed, joints))
            )
        )
    return candidates


def _leaves(observed: Evidence) -> list[str]:
    """Return the leaf bodies that close no loop and that nothing else needs."""
    spec, kept = observed.spec, kept_bodies(observed)
    ends = {name for equality in spec.equalities for name in (equality.name1, equality.name2) if name}
    closed = {site.parent.name for site in spec.sites if site.name in ends}
    return [
        body.name
        for body in spec.bodies
        if body.joints
        and body.name not in kept | closed | ends
        and not body.find_all("body")
        and all(joint.type != mujoco.mjtJoint.mjJNT_FREE for joint in body.joints)
    ]


def _coordinates(observed: Evidence, joints: tuple[str, ...]) -> dict[str, Array]:
    """Return the coordinates of joints halfway through the motion."""
    model, state = observed.model, observed.qpos[len(observed.qpos) // 2]
    coordinates: dict[str, Array] = {}
    for name in joints:
        address = int(model.joint(name).qposadr[0])
        width = 4 if int(model.joint(name).type[0]) == int(mujoco.mjtJoint.mjJNT_BALL) else 1
        coordinates[name] = state[address : address + width].copy()
    return coordinates


def _fused(spec: mujoco.MjSpec, chain: LooseChain, coordinates: dict[str, Array]) -> None:
    equality = spec.equality(chain.closing) if chain.closing else None
    if chain.closing and equality is None:
        raise NotApplicable(f"loop {chain.closing} is removed already")
    if any(spec.joint(name) is None for name in chain.joints):
        raise NotApplicable(f"{name_list(list(chain.joints))} are removed already")
    if equality is not None:
        spec.delete(equality)
    for name in chain.joints:
        require_unused(spec, name)
    for name, value in coordinates.items():
        fuse_joint_at(spec, name, value)
