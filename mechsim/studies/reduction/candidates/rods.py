"""Candidates among passive chains: rods replaced by distance constraints, fused chains and leaf bodies."""

from dataclasses import dataclass
from functools import partial
from itertools import permutations

import mujoco
import numpy as np

from mechsim.errors import first_names, several
from mechsim.mechanism.links import Inertia, combine, rows, vector
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.simulation.mjcf_reader.equality_constraints import CONNECT, WELD
from mechsim.simulation.plain_settings import LOWEST_COMPLIANCE_SOLIMP
from mechsim.simulation.state import quaternion, rotation_matrix
from mechsim.studies.reduction.candidates.elements import (
    LISTED,
    NotApplicable,
    RemovalCandidate,
    bodies_of,
    existing,
    fuse,
    joints_of,
    needed_bodies,
    touching_bodies,
)
from mechsim.studies.reduction.reduced_scene import Evidence


@dataclass(frozen=True, slots=True)
class LooseChain:
    """Passive bodies between a remaining body and an equality that closes a loop.

    Attributes:
        closing: name of the equality.
        chain_site: site on the last body at which the chain is closed.
        other_site: site of the equality on the remaining body.
        bodies: names of the bodies; the first is attached to a remaining body.
        joints: names of all joints of the bodies.
    """

    closing: str
    chain_site: str
    other_site: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]


def loose_chains(observed: Evidence) -> list[LooseChain]:
    """Return the passive chains of a scene that close loops; the shortest is first."""
    spec, chains = observed.spec, list[LooseChain]()
    kept = kept_bodies(observed)
    for equality in spec.equalities:
        if equality.type not in (CONNECT, WELD) or not equality.name2:
            continue
        for chain_site, other_site in permutations((equality.name1, equality.name2)):
            chain = _chain(spec, chain_site, other_site, kept)
            joints = tuple(joint.name for body in chain for joint in body.joints)
            names = tuple(body.name for body in chain)
            if joints and not _used(spec, names, joints, equality.name):
                chains.append(LooseChain(equality.name, chain_site, other_site, names, joints))
    return sorted(chains, key=lambda chain: len(chain.joints))


def kept_bodies(observed: Evidence) -> set[str]:
    """Return the bodies that are tracked, driven, actuated or in contact."""
    return {*observed.tracked, *needed_bodies(observed), *touching_bodies(observed)}


def _chain(spec: mujoco.MjSpec, chain_site: str, other_site: str, kept: set[str]) -> list[mujoco.MjsBody]:
    """Return the passive bodies from a remaining body to the site, its own body last."""
    above = set[str]()
    body = spec.site(other_site).parent
    while body is not None and body.name != "world":
        above.add(body.name)
        body = body.parent
    chain: list[mujoco.MjsBody] = []
    body = spec.site(chain_site).parent
    while body.name != "world" and body.name not in above:
        below = {child.name for child in body.find_all("body")} - {child.name for child in chain}
        if body.name in kept or below:
            # its children remain, and so does the body
            break
        chain.insert(0, body)
        body = body.parent
    return chain


def _used(spec: mujoco.MjSpec, bodies: tuple[str, ...], joints: tuple[str, ...], closing: str) -> bool:
    """Return whether any element except the closing equality acts on a chain."""
    sites = {site.name for site in spec.sites if site.parent.name in bodies}
    for equality in spec.equalities:
        names = {equality.name1, equality.name2}
        if equality.name != closing and names & ({*bodies, *joints} | sites):
            return True
    for tendon in spec.tendons:
        if set(joints_of(tendon)) & set(joints) or any(
            getattr(wrap.target, "name", "") in sites for wrap in tendon.path
        ):
            return True
    return any(bodies_of(spec, actuator) & set(bodies) for actuator in spec.actuators)


def add_weight(model: mujoco.MjModel, body: int, mass: float, centre: Array, moments: Array) -> None:
    """Add a mass to a body, in place.

    Args:
        model: changed in place.
        body: index of the body; nothing is added to the world.
        mass: in [kg].
        centre: centre of the mass in the body's frame, (3,) in [m].
        moments: inertia about this centre, in the body's frame, (3, 3) in [kg m2].
    """
    if body == 0 or not mass > 0.0:
        return
    axes = rotation_matrix(model.body_iquat[body])
    own = rows(axes @ np.diag(model.body_inertia[body]) @ axes.T)
    before = Inertia(float(model.body_mass[body]), vector(model.body_ipos[body]), own)
    whole = combine([before, Inertia(mass, vector(centre), rows(moments))])
    values, vectors = np.linalg.eigh(whole.matrix)
    if np.linalg.det(vectors) < 0.0:
        vectors[:, 0] *= -1.0
    model.body_mass[body], model.body_ipos[body], model.body_inertia[body] = whole.mass, whole.centre, values
    model.body_iquat[body] = quaternion(vectors)


TENDON = mujoco.mjtObj.mjOBJ_TENDON
# distance of joint anchors, relative to the rod length, up to which they coincide
ANCHOR_TOLERANCE = 1e-6
# time constants in steps, tried in addition to the compliance of the loop
TIME_CONSTANTS = (2.0, 4.0)


def rods_as_lengths(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to replace each rod by its length, with the compliance of its loop and with smaller ones."""
    candidates: list[RemovalCandidate] = []
    step = float(observed.spec.option.timestep)
    options: dict[str, float | None] = {"compliance of its loop": None}
    options |= {f"time constant {constant * step:g} s": constant * step for constant in TIME_CONSTANTS}
    for chain in loose_chains(observed):
        closing = observed.spec.equality(chain.closing)
        if closing.type != CONNECT or rod_of_chain(observed.spec, chain) is None:
            continue
        for stiffness, constant in options.items():
            rod_name = f"rod {first_names(chain.bodies, LISTED)}"
            what = f"{rod_name} with loop {chain.closing}: kept as a length, {stiffness}"
            edit = partial(_as_length, chain=chain, constant=constant)
            candidates.append(RemovalCandidate("rods as lengths", what, edit))
    return candidates


def rod_of_chain(spec: mujoco.MjSpec, chain: LooseChain) -> tuple[Array, float] | None:
    """Return the common anchor of a chain's joints, (3,), and the distance to its end; or None.

    The hinge axes must intersect in one point, so that the rod can follow the direction of the force.
    """
    model = plainly_compiled(spec)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    anchors = np.array([data.joint(name).xanchor for name in chain.joints])
    end = data.site(chain.chain_site).xpos
    length = float(np.linalg.norm(end - anchors[0]))
    slides = any(int(model.joint(name).type[0]) == int(mujoco.mjtJoint.mjJNT_SLIDE) for name in chain.joints)
    if slides or not length > 0.0 or np.abs(anchors - anchors[0]).max() > ANCHOR_TOLERANCE * length:
        return None
    return anchors[0].copy(), length


def _as_length(spec: mujoco.MjSpec, chain: LooseChain, constant: float | None) -> None:
    (equality,) = existing(spec, "equality", chain.closing)
    existing(spec, "body", *chain.bodies)
    rod = rod_of_chain(spec, chain)
    if rod is None:
        raise NotApplicable(f"{chain.bodies[0]} is no rod")
    anchor, length = rod
    solref, solimp = equality.solref.copy(), equality.solimp.copy()
    parent = spec.body(chain.bodies[0]).parent
    local = _shared(spec, chain, parent.name, anchor)
    start_site = parent.add_site(name=f"{chain.closing}@{parent.name}", pos=local, group=5).name
    spec.delete(spec.equality(chain.closing))
    spec.delete(spec.body(chain.bodies[0]))
    tendon = spec.add_tendon(name=f"{chain.closing}_length")
    tendon.wrap_site(start_site)
    tendon.wrap_site(chain.other_site)
    constraint = spec.add_equality(
        name=chain.closing, type=mujoco.mjtEq.mjEQ_TENDON, objtype=TENDON, name1=tendon.name, active=True
    )
    constraint.solref = solref if constant is None else np.array([constant, 1.0])
    constraint.solimp = solimp if constant is None else np.array(LOWEST_COMPLIANCE_SOLIMP)
    model = plainly_compiled(spec)
    constraint.data = np.zeros(len(constraint.data))
    constraint.data[0] = length - float(model.tendon_length0[model.tendon(tendon.name).id])


def _shared(spec: mujoco.MjSpec, chain: LooseChain, parent: str, anchor: Array) -> Array:
    """Distribute a rod's mass to the bodies at its ends; return its first end in the parent's frame."""
    model = plainly_compiled(spec)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    other_site = model.site(chain.other_site)
    parent_body, other_body = int(model.body(parent).id), int(other_site.bodyid[0])
    end = data.site(chain.chain_site).xpos
    along = (end - anchor) / float((end - anchor) @ (end - anchor))
    none = np.zeros((3, 3))
    local_anchor = data.xmat[parent_body].reshape(3, 3).T @ (anchor - data.xpos[parent_body])
    masses = [(float(model.body(name).mass[0]), data.body(name).xipos.copy()) for name in chain.bodies]
    to_end = sum(mass * float(np.clip((centre - anchor) @ along, 0.0, 1.0)) for mass, centre in masses)
    add_weight(model, parent_body, sum(mass for mass, _ in masses) - to_end, local_anchor, none)
    add_weight(model, other_body, to_end, np.array(other_site.pos), none)
    spec.copy_back(model)
    return local_anchor


def passive_chains(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to fuse each passive chain and each passive leaf body."""
    candidates: list[RemovalCandidate] = []
    for chain in loose_chains(observed):
        joints = f"{several(len(chain.joints), 'joint')}, {first_names(chain.joints, LISTED)}"
        edit = partial(_fused, closing=chain.closing, coordinates=_coordinates(observed, chain.joints))
        what = f"loop {chain.closing} with {joints}: fused"
        candidates.append(RemovalCandidate("passive chains", what, edit))
    for name in _leaves(observed):
        joints = tuple(joint.name for joint in observed.spec.body(name).joints)
        edit = partial(_fused, closing="", coordinates=_coordinates(observed, joints))
        what = f"{several(len(joints), 'joint')} of {name}, which has no tracked point: fused"
        candidates.append(RemovalCandidate("passive chains", what, edit))
    return candidates


def _leaves(observed: Evidence) -> list[str]:
    """Return the leaf bodies that close no loop and that no other element needs."""
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
    for joint in map(model.joint, joints):
        address = int(joint.qposadr[0])
        width = 4 if int(joint.type[0]) == int(mujoco.mjtJoint.mjJNT_BALL) else 1
        coordinates[joint.name] = state[address : address + width].copy()
    return coordinates


def _fused(spec: mujoco.MjSpec, closing: str, coordinates: dict[str, Array]) -> None:
    if closing:
        spec.delete(*existing(spec, "equality", closing))
    for name, value in coordinates.items():
        fuse(spec, name, value)
