"""Rods with a joint at each end as a length kept between two points, their mass shared between the ends."""

from functools import partial

import mujoco
import numpy as np

from mechsim.maths.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.reduction.candidate import Candidate, NotThere, listed
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.rods import CONNECT, LooseChain, add_weight, loose_chains

FAMILY = "rods as lengths"
SITE, TENDON = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_TENDON
# of the rod by which its joints may miss each other and count as one point
SAME = 1e-6
# time constants in steps, tried beside the loop's own softness
CONSTANTS = (2.0, 4.0)


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to keep each rod's length alone, as soft as its loop was and harder."""
    found: list[Candidate] = []
    step = float(seen.spec.option.timestep)
    for chain in loose_chains(seen):
        if seen.spec.equality(chain.closing).type != CONNECT or rod_of(seen.spec, chain) is None:
            continue
        for constant in (None, *CONSTANTS):
            how = "as soft as its loop was" if constant is None else f"time constant {constant * step:g} s"
            what = f"rod {listed(list(chain.bodies))} with loop {chain.closing}: kept as a length, {how}"
            soft = None if constant is None else constant * step
            found.append(Candidate(FAMILY, what, partial(_as_length, chain=chain, constant=soft)))
    return found


def rod_of(spec: mujoco.MjSpec, chain: LooseChain) -> tuple[Array, float] | None:
    """Return where a chain's joints meet in the world, (3,), and how far its end is; None where they do not.

    Hinges count whose axes go through one point, two of them at least: the rod may turn any way it is pulled.
    """
    model = plainly_compiled(spec)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    places = np.array([data.joint(name).xanchor for name in chain.joints])
    end = data.site(chain.near).xpos
    length = float(np.linalg.norm(end - places[0]))
    slides = any(int(model.joint(name).type[0]) == int(mujoco.mjtJoint.mjJNT_SLIDE) for name in chain.joints)
    if slides or not length > 0.0 or np.abs(places - places[0]).max() > SAME * length:
        return None
    return places[0].copy(), length


def _as_length(spec: mujoco.MjSpec, chain: LooseChain, constant: float | None) -> None:
    equality = spec.equality(chain.closing)
    if equality is None or any(spec.body(name) is None for name in chain.bodies):
        raise NotThere(f"loop {chain.closing} is left out already")
    rod = rod_of(spec, chain)
    if rod is None:
        raise NotThere(f"{chain.bodies[0]} is no rod")
    at, length = rod
    solref, solimp = equality.solref.copy(), equality.solimp.copy()
    parent = spec.body(chain.bodies[0]).parent
    local = _shared(spec, chain, parent.name, at)
    begin = parent.add_site(name=f"{chain.closing}@{parent.name}", pos=local, group=5).name
    spec.delete(spec.equality(chain.closing))
    spec.delete(spec.body(chain.bodies[0]))
    tendon = spec.add_tendon(name=f"{chain.closing}_length")
    tendon.wrap_site(begin)
    tendon.wrap_site(chain.far)
    made = spec.add_equality(
        name=chain.closing, type=mujoco.mjtEq.mjEQ_TENDON, objtype=TENDON, name1=tendon.name, active=True
    )
    made.solref = solref if constant is None else np.array([constant, 1.0])
    made.solimp = solimp if constant is None else np.array([0.9999, 0.9999, 0.001, 0.5, 2.0])
    model = plainly_compiled(spec)
    made.data = np.zeros(len(made.data))
    made.data[0] = length - float(model.tendon_length0[model.tendon(tendon.name).id])


def _shared(spec: mujoco.MjSpec, chain: LooseChain, parent: str, at: Array) -> Array:
    """Share a rod's mass between what its ends are on; return where it begins in its parent's frame."""
    model = plainly_compiled(spec)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    far = model.site(chain.far)
    own, other = int(model.body(parent).id), int(far.bodyid[0])
    end = data.site(chain.near).xpos
    along = (end - at) / float((end - at) @ (end - at))
    none = np.zeros((3, 3))
    local = data.xmat[own].reshape(3, 3).T @ (at - data.xpos[own])
    masses = [(float(model.body(name).mass[0]), data.body(name).xipos.copy()) for name in chain.bodies]
    to_end = sum(mass * float(np.clip((centre - at) @ along, 0.0, 1.0)) for mass, centre in masses)
    add_weight(model, own, sum(mass for mass, _ in masses) - to_end, local, none)
    add_weight(model, other, to_end, np.array(far.pos), none)
    spec.copy_back(model)
    return local
