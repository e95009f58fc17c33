"""Rods: passive chains that connect a point of one body to a point of another."""

from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.studies.reduction.disconnected_bodies import bodies_of, needed_bodies
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.locked_joints import joints_of

CONNECT, WELD = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD


@dataclass(frozen=True, slots=True)
class LooseChain:
    """Passive bodies between a body that remains and an equality that closes a loop.

    Attributes:
        closing: name of the equality.
        chain_site: site at which the chain is closed, on its last body.
        other_site: site of the equality on the body that remains.
        bodies: names, the first attached to a body that remains.
        joints: names, all of the bodies.
    """

    closing: str
    chain_site: str
    other_site: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]


def loose_chains(observed: Evidence) -> list[LooseChain]:
    """Return the passive chains of a scene that close loops, the shortest first."""
    spec, chains = observed.spec, list[LooseChain]()
    kept = kept_bodies(observed)
    for equality in spec.equalities:
        if equality.type not in (CONNECT, WELD) or not equality.name2:
            continue
        ends = (equality.name1, equality.name2)
        for chain_site, other_site in (ends, ends[::-1]):
            chain = _chain(spec, chain_site, other_site, kept)
            if chain:
                joints = tuple(joint.name for body in chain for joint in body.joints)
                names = tuple(body.name for body in chain)
                if not _used(spec, names, joints, equality.name):
                    chains.append(LooseChain(equality.name, chain_site, other_site, names, joints))
    return sorted(chains, key=lambda chain: len(chain.joints))


def kept_bodies(observed: Evidence) -> set[str]:
    """Return the bodies that are tracked, driven, actuated or in contact."""
    touching = {
        observed.spec.geom(name).parent.name
        for name in observed.touched
        if observed.spec.geom(name) is not None
    }
    return set(observed.tracked) | needed_bodies(observed) | touching


def _chain(spec: mujoco.MjSpec, chain_site: str, other_site: str, kept: set[str]) -> list[mujoco.MjsBody]:
    """Return the bodies from the one that remains to the site's; none if one is needed or branches."""
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
            # its children remain, so it remains too
            break
        chain.insert(0, body)
        body = body.parent
    return chain if any(child.joints for child in chain) else []


def _used(spec: mujoco.MjSpec, bodies: tuple[str, ...], joints: tuple[str, ...], closing: str) -> bool:
    """Return whether anything but its closing equality acts on a chain."""
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
        model: changed.
        body: to which it is added; nothing is added to the world.
        mass: in [kg].
        centre: of it in the body's frame, (3,) in [m].
        moments: about its centre, in the body's frame, (3, 3) in [kg m2].
    """
    if body == 0 or not mass > 0.0:
        return
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axes = rotation.reshape(3, 3)
    own_mass, total_mass = float(model.body_mass[body]), float(model.body_mass[body]) + mass
    total_centre = (own_mass * model.body_ipos[body] + mass * centre) / total_mass
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T + moments
    for component_mass, component_centre in ((own_mass, model.body_ipos[body]), (mass, centre)):
        arm = component_centre - total_centre
        inertia += component_mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    values, vectors = np.linalg.eigh(inertia)
    if np.linalg.det(vectors) < 0.0:
        vectors[:, 0] *= -1.0
    model.body_mass[body], model.body_ipos[body], model.body_inertia[body] = total_mass, total_centre, values
    mujoco.mju_mat2Quat(model.body_iquat[body], vectors.ravel())
