"""Bodies that what is tracked never feels: nothing joins, touches or ties them but the world."""

from typing import TYPE_CHECKING

import mujoco

from mechsim.studies.reduction.candidate import Candidate, NotThere, counted, listed
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.still_joints import joints_of

if TYPE_CHECKING:
    import networkx as nx

FAMILY = "parts apart"
TENDON, JOINT = mujoco.mjtEq.mjEQ_TENDON, mujoco.mjtEq.mjEQ_JOINT


def propose(seen: Evidence) -> list[Candidate]:
    """Propose to leave out all bodies that nothing but the world joins to what is tracked or driven."""
    import networkx as nx

    graph = ties(seen)
    kept = set[str]()
    for name in (*seen.tracked, *needed_bodies(seen)):
        if name in graph:
            kept |= nx.node_connected_component(graph, name)
    roots = [
        body.name for body in seen.spec.worldbody.bodies if body.name not in kept and not _below(body) & kept
    ]
    roots += [
        body.name
        for above in _fixed(seen)
        for body in above.bodies
        if body.name not in kept and not _below(body) & kept and body.name not in roots
    ]
    moving = [name for name in roots if _moves(seen, name)]
    if not moving:
        return []
    what = f"{counted(len(moving), 'part')} that nothing joins to what is tracked: {listed(moving)}"
    return [Candidate(FAMILY, what, lambda spec: _without(spec, moving))]


def ties(seen: Evidence) -> "nx.Graph[str]":
    """Return which bodies feel each other otherwise than by bodies that cannot move."""
    import networkx as nx

    model = seen.model
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
    for group in (*_equalities(seen.spec), *_tendons(seen.spec)):
        inside = [name for name in group if name in graph]
        nx.add_path(graph, inside)
    touching = [body_of(seen.spec.geom(name)) for name in seen.touched if seen.spec.geom(name) is not None]
    nx.add_path(graph, [name for name in touching if name in graph])
    return graph


def needed_bodies(seen: Evidence) -> set[str]:
    """Return the bodies of the joints that programs drive or whose actuators they feed."""
    spec, found = seen.spec, set[str]()
    for name in seen.scene.drive:
        found.add(body_of(spec.joint(name)))
    for name in seen.scene.ctrl:
        found |= bodies_of(spec, spec.actuator(name))
    return found


def bodies_of(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> set[str]:
    """Return the bodies on which an actuator acts."""
    kind = actuator.trntype
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        return set(_of_tendon(spec.tendon(actuator.target)))
    if kind == mujoco.mjtTrn.mjTRN_BODY:
        return {actuator.target}
    if kind in (mujoco.mjtTrn.mjTRN_SITE, mujoco.mjtTrn.mjTRN_SLIDERCRANK):
        return {body_of(spec.site(actuator.target))}
    return {body_of(spec.joint(actuator.target))}


def _equalities(spec: mujoco.MjSpec) -> list[list[str]]:
    """Return the bodies that each equality ties."""
    found: list[list[str]] = []
    for equality in spec.equalities:
        names = [name for name in (equality.name1, equality.name2) if name]
        if equality.type == JOINT:
            found.append([body_of(spec.joint(name)) for name in names])
        elif equality.type == TENDON:
            found.append([body for name in names for body in _of_tendon(spec.tendon(name))])
        elif equality.objtype == mujoco.mjtObj.mjOBJ_SITE:
            found.append([body_of(spec.site(name)) for name in names])
        else:
            found.append(names)
    return found


def _tendons(spec: mujoco.MjSpec) -> list[list[str]]:
    return [_of_tendon(tendon) for tendon in spec.tendons]


def _of_tendon(tendon: mujoco.MjsTendon) -> list[str]:
    """Return the bodies that a tendon runs over."""
    if joints_of(tendon):
        return [body_of(part.target) for part in tendon.path]
    return [body_of(part.target) for part in tendon.path if hasattr(part.target, "parent")]


def body_of(part: "mujoco.MjsJoint | mujoco.MjsSite | mujoco.MjsGeom") -> str:
    """Return the body of a joint, a site or a geom."""
    return str(part.parent.name)


def _below(body: mujoco.MjsBody) -> set[str]:
    return {one.name for one in body.find_all("body")}


def _fixed(seen: Evidence) -> list[mujoco.MjsBody]:
    """Return the bodies that cannot move."""
    model = seen.model
    still = {0}
    for body in range(1, model.nbody):
        if int(model.body_parentid[body]) in still and not model.body_jntnum[body]:
            still.add(body)
    return [seen.spec.body(model.body(body).name) for body in sorted(still) if body]


def _moves(seen: Evidence, name: str) -> bool:
    body = seen.spec.body(name)
    return bool(body.joints) or any(one.joints for one in body.find_all("body"))


def _without(spec: mujoco.MjSpec, names: list[str]) -> None:
    for name in names:
        body = spec.body(name)
        if body is None:
            raise NotThere(f"body {name} is left out already")
        spec.delete(body)
