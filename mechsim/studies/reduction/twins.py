"""Twins: a side of a scene that does what another does, tied to it one to one: a gripper's other finger."""

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np

from mechsim.studies.reduction.apart import body_of, needed_bodies, ties
from mechsim.studies.reduction.candidate import Candidate, NotThere, counted, listed
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.still_joints import joints_of

FAMILY = "twins"
JOINT = mujoco.mjtEq.mjEQ_JOINT


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to leave out each side that a joint equality ties one to one to one that stays.

    What acts on joints of both by a tendon acts on the one that stays, with its part.
    """
    import networkx as nx

    found: list[Candidate] = []
    for equality in seen.spec.equalities:
        ratio = _one_to_one(equality)
        if ratio is None:
            continue
        graph = ties(_untied(seen, equality.name))
        for kept, gone in ((equality.name1, equality.name2), (equality.name2, equality.name1)):
            side = nx.node_connected_component(graph, body_of(seen.spec.joint(gone)))
            if body_of(seen.spec.joint(kept)) in side or side & (set(seen.tracked) | _driven(seen)):
                continue
            roots = [name for name in side if seen.spec.body(name).parent.name not in side]
            what = f"{counted(len(side), 'body', 'bodies')} that do what others do: {listed(sorted(side))}"
            edit = partial(_without, equality=equality.name, kept=kept, gone=gone, ratio=ratio, roots=roots)
            found.append(Candidate(FAMILY, what, edit))
    return found


def _one_to_one(equality: mujoco.MjsEquality) -> float | None:
    """Return by how much one of two tied joints moves as the other moves by one, if that is 1 or -1."""
    if equality.type != JOINT or not equality.name2:
        return None
    straight = np.array_equal(equality.data[[0, 2, 3, 4]], np.zeros(4)) and abs(equality.data[1]) == 1.0
    return float(equality.data[1]) if straight else None


def _driven(seen: Evidence) -> set[str]:
    """Return the bodies of prescribed joints; actuators are dealt with by their tendons."""
    over = {name for tendon in seen.spec.tendons for name in joints_of(tendon)}
    tied = {body_of(seen.spec.joint(name)) for name in over}
    return {body_of(seen.spec.joint(name)) for name in seen.scene.drive} | (needed_bodies(seen) - tied)


def _untied(seen: Evidence, equality: str) -> Evidence:
    """Return a scene whose sides no equality or tendon of joints ties."""
    spec = seen.spec.copy()
    spec.delete(spec.equality(equality))
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for tendon in list(spec.tendons):
        if joints_of(tendon):
            spec.delete(tendon)
    return replace(seen, spec=spec)


def _without(
    spec: mujoco.MjSpec, equality: str, kept: str, gone: str, ratio: float, roots: list[str]
) -> None:
    tie = spec.equality(equality)
    if tie is None or any(spec.body(name) is None for name in roots):
        raise NotThere(f"{gone} is left out already")
    for tendon in list(spec.tendons):
        weights = joints_of(tendon)
        if gone in weights:
            if set(weights) != {kept, gone}:
                raise NotThere(f"tendon {tendon.name} runs over other joints too")
            _on_one(spec, tendon, kept, weights[kept], weights[kept] + ratio * weights[gone])
    spec.delete(tie)
    for name in roots:
        spec.delete(spec.body(name))


def _on_one(spec: mujoco.MjSpec, tendon: mujoco.MjsTendon, joint: str, own: float, both: float) -> None:
    """Let what acts on two joints that move alike act on one, as far as it goes and with that one's part.

    Args:
        spec: changed in place.
        tendon: over both, by which it acts.
        joint: that stays.
        own: its weight.
        both: the weight of both.
    """
    plain = not (np.any(tendon.stiffness) or np.any(tendon.damping) or tendon.frictionloss or tendon.armature)
    if not plain or tendon.limited == int(mujoco.mjtLimited.mjLIMITED_TRUE) or not both or not own:
        raise NotThere(f"tendon {tendon.name} has a spring, a damper, inertia or a limit of its own")
    part = own / both
    for actuator in spec.actuators:
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and actuator.target == tendon.name:
            actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_JOINT, joint
            actuator.gear = both * np.asarray(actuator.gear)
            actuator.gainprm = part * np.asarray(actuator.gainprm)
            actuator.biasprm = part * np.asarray(actuator.biasprm)
            actuator.forcerange = part * np.asarray(actuator.forcerange)
    spec.delete(tendon)
