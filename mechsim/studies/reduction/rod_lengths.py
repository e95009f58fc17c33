"""Rods with a joint at each end as distance constraints, their mass distributed to both ends."""

from functools import partial

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import plainly_compiled
from mechsim.studies.reduction.candidate import Candidate, NotApplicable, name_list
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.rods import CONNECT, LooseChain, add_weight, loose_chains

CATEGORY = "rods as lengths"
SITE, TENDON = mujoco.mjtObj.mjOBJ_SITE, mujoco.mjtObj.mjOBJ_TENDON
# distance of joint anchors, relative to the rod length, below which they count as one point
ANCHOR_TOLERANCE = 1e-6
# time constants in steps, tried in addition to the loop's own compliance
CONSTANTS = (2.0, 4.0)


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to replace each rod by its length, with the loop's own compliance and with smaller ones."""
    candidates: list[Candidate] = []
    step = float(observed.spec.option.timestep)
    for chain in loose_chains(observed):
        if observed.spec.equality(chain.closing).type != CONNECT or rod_of(observed.spec, chain) is None:
            continue
        for constant in (None, *CONSTANTS):
            stiffness = (
                "as soft as its loop was" if constant is None else f"time constant {constant * step:g} s"
            )
            rod = f"rod {name_list(list(chain.bodies))}"
            what = f"{rod} with loop {chain.closing}: kept as a length, {stiffness}"
            seconds = None if constant is None else constant * step
            candidates.append(Candidate(CATEGORY, what, partial(_as_length, chain=chain, constant=seconds)))
    return candidates


def rod_of(spec: mujoco.MjSpec, chain: LooseChain) -> tuple[Array, float] | None:
    """Return the common anchor of a chain's joints, (3,), and the distance to its end; None if there is none.

    The hinge axes must pass through one point, so that the rod can follow the direction of the force.
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
    equality = spec.equality(chain.closing)
    if equality is None or any(spec.body(name) is None for name in chain.bodies):
        raise NotApplicable(f"loop {chain.closing} is removed already")
    rod = rod_of(spec, chain)
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
    constraint.solimp = solimp if constant is None else np.array([0.9999, 0.9999, 0.001, 0.5, 2.0])
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
