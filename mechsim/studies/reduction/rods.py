"""Rods: chains that join one point of a body to one of another, and carry nothing else."""

from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.studies.reduction.apart import bodies_of, needed_bodies
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.still_joints import joints_of

CONNECT, WELD = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD


@dataclass(frozen=True, slots=True)
class LooseChain:
    """Bodies between a body that stays and an equality that closes a loop, of which nothing else is needed.

    Attributes:
        closing: name of the equality.
        near: site at which the chain is closed, on its last body.
        far: site of the equality on what stays.
        bodies: names, the first on what stays.
        joints: names, all of the bodies.
    """

    closing: str
    near: str
    far: str
    bodies: tuple[str, ...]
    joints: tuple[str, ...]


def loose_chains(seen: Evidence) -> list[LooseChain]:
    """Return the chains of a scene that close loops and that nothing needs otherwise, the shortest first."""
    spec, found = seen.spec, list[LooseChain]()
    kept = kept_bodies(seen)
    for equality in spec.equalities:
        if equality.type not in (CONNECT, WELD) or not equality.name2:
            continue
        ends = (equality.name1, equality.name2)
        for near, far in (ends, ends[::-1]):
            chain = _chain(spec, near, far, kept)
            if chain:
                joints = tuple(joint.name for body in chain for joint in body.joints)
                names = tuple(body.name for body in chain)
                if not _used(spec, names, joints, equality.name):
                    found.append(LooseChain(equality.name, near, far, names, joints))
    return sorted(found, key=lambda one: len(one.joints))


def kept_bodies(seen: Evidence) -> set[str]:
    """Return the bodies that carry what is tracked, driven, fed or touched."""
    touching = {seen.spec.geom(name).parent.name for name in seen.touched if seen.spec.geom(name) is not None}
    return set(seen.tracked) | needed_bodies(seen) | touching


def _chain(spec: mujoco.MjSpec, near: str, far: str, kept: set[str]) -> list[mujoco.MjsBody]:
    """Return the bodies from what stays to the one of a site; none where one is needed or branches."""
    above = set[str]()
    body = spec.site(far).parent
    while body is not None and body.name != "world":
        above.add(body.name)
        body = body.parent
    chain: list[mujoco.MjsBody] = []
    body = spec.site(near).parent
    while body.name != "world" and body.name not in above:
        below = {one.name for one in body.find_all("body")} - {one.name for one in chain}
        if body.name in kept or below:
            # what hangs on it has to be there, and so it has
            break
        chain.insert(0, body)
        body = body.parent
    return chain if any(one.joints for one in chain) else []


def _used(spec: mujoco.MjSpec, bodies: tuple[str, ...], joints: tuple[str, ...], closing: str) -> bool:
    """Say whether anything but its closing acts on a chain."""
    sites = {site.name for site in spec.sites if site.parent.name in bodies}
    for equality in spec.equalities:
        names = {equality.name1, equality.name2}
        if equality.name != closing and names & ({*bodies, *joints} | sites):
            return True
    for tendon in spec.tendons:
        if set(joints_of(tendon)) & set(joints) or any(
            getattr(part.target, "name", "") in sites for part in tendon.path
        ):
            return True
    return any(bodies_of(spec, actuator) & set(bodies) for actuator in spec.actuators)


def add_weight(model: mujoco.MjModel, body: int, mass: float, centre: Array, moments: Array) -> None:
    """Add a weight to a body, in place.

    Args:
        model: changed.
        body: to which it is added; the world needs none.
        mass: in [kg].
        centre: of it in the body's frame, (3,) in [m].
        moments: about its centre, in the body's frame, (3, 3) in [kg m2].
    """
    if body == 0 or not mass > 0.0:
        return
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    own, whole = float(model.body_mass[body]), float(model.body_mass[body]) + mass
    middle = (own * model.body_ipos[body] + mass * centre) / whole
    total = axes @ np.diag(model.body_inertia[body]) @ axes.T + moments
    for part, at in ((own, model.body_ipos[body]), (mass, centre)):
        arm = at - middle
        total += part * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    values, vectors = np.linalg.eigh(total)
    if np.linalg.det(vectors) < 0.0:
        vectors[:, 0] *= -1.0
    model.body_mass[body], model.body_ipos[body], model.body_inertia[body] = whole, middle, values
    mujoco.mju_mat2Quat(model.body_iquat[body], vectors.ravel())
