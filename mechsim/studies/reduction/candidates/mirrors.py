"""Mirrored mechanisms: a side that a joint equality couples one to one to another side, as in a gripper."""

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np

from mechsim.studies.reduction.candidates.bodies import (
    NotApplicable,
    RemovalCandidate,
    body_of,
    count_text,
    existing,
    interaction_graph,
    joints_of,
    name_list,
    needed_bodies,
)
from mechsim.studies.reduction.reduced_scene import Evidence

MIRRORED = "mirrored mechanisms"
JOINT = mujoco.mjtEq.mjEQ_JOINT


def mirrored_mechanisms(observed: Evidence) -> list[RemovalCandidate]:
    """Propose to remove each side that a joint equality couples one to one to a side that remains.

    An actuator that acts on both by a tendon acts on the remaining joint with its share of the force.
    """
    import networkx as nx

    candidates: list[RemovalCandidate] = []
    for equality in observed.spec.equalities:
        ratio = _one_to_one(equality)
        if ratio is None:
            continue
        graph = interaction_graph(_untied(observed, equality.name))
        for kept, removed in ((equality.name1, equality.name2), (equality.name2, equality.name1)):
            side = nx.node_connected_component(graph, body_of(observed.spec.joint(removed)))
            if body_of(observed.spec.joint(kept)) in side or side & (
                set(observed.tracked) | _driven(observed)
            ):
                continue
            roots = [name for name in side if observed.spec.body(name).parent.name not in side]
            what = f"{count_text(len(side), 'body', 'bodies')} that mirror others: {name_list(sorted(side))}"
            edit = partial(
                _without, equality=equality.name, kept=kept, removed=removed, ratio=ratio, roots=roots
            )
            candidates.append(RemovalCandidate(MIRRORED, what, edit))
    return candidates


def _one_to_one(equality: mujoco.MjsEquality) -> float | None:
    """Return the ratio of two coupled joints if it is 1 or -1."""
    if equality.type != JOINT or not equality.name2:
        return None
    straight = np.array_equal(equality.data[[0, 2, 3, 4]], np.zeros(4)) and abs(equality.data[1]) == 1.0
    return float(equality.data[1]) if straight else None


def _driven(observed: Evidence) -> set[str]:
    """Return the bodies of prescribed joints and of actuators that act on no coupled tendon."""
    over = {name for tendon in observed.spec.tendons for name in joints_of(tendon)}
    tied = {body_of(observed.spec.joint(name)) for name in over}
    return {body_of(observed.spec.joint(name)) for name in observed.scene.joint_laws} | (
        needed_bodies(observed) - tied
    )


def _untied(observed: Evidence, equality: str) -> Evidence:
    """Return a scene without the equality, actuators and fixed tendons that couple the sides."""
    spec = observed.spec.copy()
    spec.delete(spec.equality(equality))
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for tendon in list(spec.tendons):
        if joints_of(tendon):
            spec.delete(tendon)
    return replace(observed, spec=spec)


def _without(
    spec: mujoco.MjSpec, equality: str, kept: str, removed: str, ratio: float, roots: list[str]
) -> None:
    (tie,) = existing(spec, "equality", equality)
    existing(spec, "body", *roots)
    for tendon in list(spec.tendons):
        weights = joints_of(tendon)
        if removed in weights:
            if set(weights) != {kept, removed}:
                raise NotApplicable(f"tendon {tendon.name} acts on other joints too")
            _transfer_to_joint(spec, tendon, kept, weights[kept], weights[kept] + ratio * weights[removed])
    spec.delete(tie)
    for name in roots:
        spec.delete(spec.body(name))


def _transfer_to_joint(
    spec: mujoco.MjSpec, tendon: mujoco.MjsTendon, joint: str, own_weight: float, total_weight: float
) -> None:
    """Replace a tendon over two coupled joints by joint actuators on one of them.

    Args:
        spec: changed in place.
        tendon: over both joints.
        joint: the remaining joint.
        own_weight: coefficient of this joint.
        total_weight: sum of both coefficients.
    """
    plain = not (np.any(tendon.stiffness) or np.any(tendon.damping) or tendon.frictionloss or tendon.armature)
    if (
        not plain
        or tendon.limited == int(mujoco.mjtLimited.mjLIMITED_TRUE)
        or not total_weight
        or not own_weight
    ):
        raise NotApplicable(f"tendon {tendon.name} has a spring, a damper, inertia or a limit")
    share = own_weight / total_weight
    for actuator in spec.actuators:
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and actuator.target == tendon.name:
            actuator.trntype, actuator.target = mujoco.mjtTrn.mjTRN_JOINT, joint
            actuator.gear = total_weight * np.asarray(actuator.gear)
            actuator.gainprm = share * np.asarray(actuator.gainprm)
            actuator.biasprm = share * np.asarray(actuator.biasprm)
            actuator.forcerange = share * np.asarray(actuator.forcerange)
    spec.delete(tendon)
