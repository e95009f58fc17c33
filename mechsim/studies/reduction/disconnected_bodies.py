"""Bodies that no joint, contact, equality or tendon connects to the tracked bodies."""

from typing import TYPE_CHECKING

import mujoco

from mechsim.studies.reduction.candidate import Candidate, NotApplicable, count_text, name_list
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.locked_joints import joints_of

if TYPE_CHECKING:
    import networkx as nx

CATEGORY = "disconnected bodies"
TENDON, JOINT = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtEq.mjEQ_JOINT


def propose(observed: Evidence) -> list[Candidate]:
    """Propose to remove all bodies that only the world connects to the tracked or driven bodies."""
    import networkx as nx

    graph = ties(observed)
    kept = set[str]()
    for name in (*observed.tracked, *needed_bodies(observed)):
        if name in graph:
            kept |= nx.node_connected_component(graph, name)
    roots = [
        body.name
        for body in observed.spec.worldbody.bodies
        if body.name not in kept and not _below(body) & kept
    ]
    roots += [
        body.name
        for above in _fixed(observed)
        for body in above.bodies
        if body.name not in kept and not _below(body) & kept and body.name not in roots
    ]
    moving = [name for name in roots if _moves(observed, name)]
    if not moving:
        return []
    what = f"{count_text(len(moving), 'part')} that nothing connects to what is tracked: {name_list(moving)}"
    return [Candidate(CATEGORY, what, lambda spec: _without(spec, moving))]


def ties(observed: Evidence) -> "nx.Graph[str]":
    """Return the graph of bodies that interact, bodies that cannot move left out."""
    import networkx as nx

    model = observed.model
    graph: nx.Graph[str] = nx.Graph()
    still = {0}
    for body in range(1, model.nbody):
        above = int(model.body_parentid[body])
        if above in still and not model.body_jntnum[body]:
            still.add(body)
            continue
        graph.add_node(model.body(body).name)
        if above not in still:
            graph.add_edge(model.body(body).name, model.body(above).name)
    for group in (*_equalities(observed.spec), *_tendons(observed.spec)):
        inside = [name for name in group if name in graph]
        nx.add_path(graph, inside)
    touching = [
        body_of(observed.spec.geom(name)) for name in observed.touched if observed.spec.geom(name) is not None
    ]
    nx.add_path(graph, [name for name in touching if name in graph])
    return graph


def needed_bodies(observed: Evidence) -> set[str]:
    """Return the bodies of driven joints and of actuators that have a motion law."""
    spec, bodies = observed.spec, set[str]()
    for name in observed.scene.drive:
        bodies.add(body_of(spec.joint(name)))
    for name in observed.scene.ctrl:
        bodies |= bodies_of(spec, spec.actuator(name))
    return bodies


def bodies_of(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> set[str]:
    """Return the bodies on which an actuator acts."""
    kind = actuator.trntype
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        return set(_tendon_bodies(spec.tendon(actuator.target)))
    if kind == mujoco.mjtTrn.mjTRN_BODY:
        return {actuator.target}
    if kind in (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK):
        return {body_of(spec.site(actuator.target))}
    return {body_of(spec.joint(actuator.target))}


def _equalities(spec: mujoco.MjSpec) -> list[list[str]]:
    """Return the bodies that each equality couples."""
    groups: list[list[str]] = []
    for equality in spec.equalities:
        names = [name for name in (equality.name1, equality.name2) if name]
        if equality.type == JOINT:
            groups.append([body_of(spec.joint(name)) for name in names])
        elif equality.type == TENDON:
            groups.append([body for name in names for body in _tendon_bodies(spec.tendon(name))])
        elif equality.objtype == mujoco.mjtObj.mjOBJ_SITE:
            groups.append([body_of(spec.site(name)) for name in names])
        else:
            groups.append(names)
    return groups


def _tendons(spec: mujoco.MjSpec) -> list[list[str]]:
    return [_tendon_bodies(tendon) for tendon in spec.tendons]


def _tendon_bodies(tendon: mujoco.MjsTendon) -> list[str]:
    """Return the bodies that a tendon acts on."""
    if joints_of(tendon):
        return [body_of(wrap.target) for wrap in tendon.path]
    return [body_of(wrap.target) for wrap in tendon.path if hasattr(wrap.target, "parent")]


def body_of(element: "mujoco.MjsJoint | mujoco.MjsSite | mujoco.MjsGeom") -> str:
    """Return the body of a joint, a site or a geom."""
    return str(element.parent.name)


def _below(body: mujoco.MjsBody) -> set[str]:
    return {child.name for child in body.find_all("body")}


def _fixed(observed: Evidence) -> list[mujoco.MjsBody]:
    """Return the bodies that cannot move."""
    model = observed.model
    still = {0}
    for body in range(1, model.nbody):
        if int(model.body_parentid[body]) in still and not model.body_jntnum[body]:
            still.add(body)
    return [observed.spec.body(model.body(body).name) for body in sorted(still) if body]


def _moves(observed: Evidence, name: str) -> bool:
    body = observed.spec.body(name)
    return bool(body.joints) or any(child.joints for child in body.find_all("body"))


def _without(spec: mujoco.MjSpec, names: list[str]) -> None:
    for name in names:
        body = spec.body(name)
        if body is None:
            raise NotApplicable(f"body {name} is removed already")
        spec.delete(body)
