"""Where to cut the loops: a mechanism as a tree of bodies and a few joints closed by constraints."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import networkx as nx
import numpy as np

from mechsim.errors import InputError
from mechsim.model.mechanism import (
    GROUND,
    IDENTITY,
    End,
    Joint,
    Mechanism,
    Pose,
    joint_coordinate,
    universal_zero,
)

# a joint can be cut where MuJoCo has an equality that closes it exactly: a point on a point. What it
# costs is the constraint rows; validation/choices/cut_joint.py measures the choice.
CUT_COST = {"spherical": 3, "revolute": 4}
UNCUTTABLE = 1000


@dataclass(frozen=True, slots=True)
class Branch:
    """One joint of the tree, from a link already placed to the next.

    Attributes:
        joint: the joint.
        parent: its end on the placed link.
        child: its end on the next.
        sense: +1 if the joint's own order is parent to child, else -1.
    """

    joint: Joint
    parent: End
    child: End
    sense: int


@dataclass(frozen=True, slots=True)
class Tree:
    """A mechanism with its loops cut: branches in an order in which parents come first, and the cuts."""

    branches: tuple[Branch, ...]
    cuts: tuple[Joint, ...]


def cut_loops(
    mechanism: Mechanism, cut: tuple[str, ...] | None = None, *, keep: Collection[str] = ()
) -> Tree:
    """Return a spanning tree of the mechanism's links, rooted in the frame.

    Args:
        mechanism: the mechanism.
        cut: names of the joints to cut; None cuts those whose closing takes the fewest constraint
            rows, and among equals those farthest from the crank.
        keep: names of joints to cut only where no other can be.

    Raises:
        InputError: for cuts that leave a loop or part the chain, or a loop that no spherical or
            revolute joint closes.
    """
    graph: nx.MultiGraph[str] = nx.MultiGraph()
    graph.add_nodes_from([GROUND, *(link.name for link in mechanism.links)])
    asked = set(cut or ())
    for unknown in asked - {joint.name for joint in mechanism.joints}:
        known = ", ".join(joint.name for joint in mechanism.joints)
        raise InputError(f"{mechanism.name}: there is no joint {unknown!r} to cut; known are {known}")
    # what is driven or geared must be a joint of the model
    needed = {mechanism.driver, *(name for gear in mechanism.gears for name in (gear.driver, gear.driven))}
    for name in sorted(asked & needed):
        what = "driven" if name == mechanism.driver else "geared"
        raise InputError(f"{mechanism.name}: joint {name!r} is {what} and cannot be cut; cut another")
    distance = _distance_from_crank(mechanism)
    for order, joint in enumerate(mechanism.joints):
        held = UNCUTTABLE if joint.name in needed else CUT_COST.get(joint.kind, UNCUTTABLE - 1)
        held += 10 * (joint.name in keep)
        cost = 0 if joint.name in asked else held
        far = min(distance[joint.a.link], distance[joint.b.link])
        # the most costly to cut stay in the tree; among equals the nearest to the crank
        graph.add_edge(joint.a.link, joint.b.link, key=joint.name, weight=1e6 * cost - 1e3 * far - order)
    if not nx.is_connected(graph):
        lost = sorted(set(graph) - nx.node_connected_component(graph, GROUND))
        raise InputError(
            f"{mechanism.name}: no chain of joints leads from the frame to {', '.join(lost)}; add one"
        )
    kept = {key for _, _, key in nx.maximum_spanning_edges(graph, keys=True, data=False)}
    cuts = tuple(joint for joint in mechanism.joints if joint.name not in kept)
    for joint in cuts:
        if joint.name in needed:
            raise InputError(
                f"{mechanism.name}: the loop through joint {joint.name!r} has only driven and geared joints; "
                "have another joint in it"
            )
        if joint.kind not in CUT_COST:
            raise InputError(
                f"{mechanism.name}: a loop would have to be cut at {joint.kind} joint {joint.name!r}, which "
                "no MuJoCo constraint closes; have a revolute or spherical joint in every loop"
            )
    if cut is not None and {joint.name for joint in cuts} != asked:
        raise InputError(
            f"{mechanism.name}: cutting {', '.join(sorted(asked)) or 'no joint'} does not leave a tree; "
            f"as many joints as there are loops ({len(cuts)}) must be named, one in each"
        )
    return Tree(_ordered(mechanism, kept), cuts)


def _distance_from_crank(mechanism: Mechanism) -> dict[str, int]:
    """Count joints from the driven link to each link, the frame not being a way through."""
    driver = mechanism.joint(mechanism.driver)
    driven = driver.b.link if driver.a.link == GROUND else driver.a.link
    graph = nx.Graph([(joint.a.link, joint.b.link) for joint in mechanism.joints])
    far = len(mechanism.links) + 1
    if GROUND in graph:
        graph.remove_node(GROUND)
    steps = dict(nx.single_source_shortest_path_length(graph, driven)) if driven in graph else {}
    return {link.name: steps.get(link.name, far) for link in mechanism.links} | {GROUND: 0}


def _ordered(mechanism: Mechanism, kept: set[str]) -> tuple[Branch, ...]:
    placed, branches = {GROUND}, []
    waiting = [joint for joint in mechanism.joints if joint.name in kept]
    while waiting:
        joint = next(j for j in waiting if j.a.link in placed or j.b.link in placed)
        waiting.remove(joint)
        forward = joint.a.link in placed
        near, far = (joint.a, joint.b) if forward else (joint.b, joint.a)
        branches.append(Branch(joint, near, far, 1 if forward else -1))
        placed.add(far.link)
    return tuple(branches)


def zero_pose(branch: Branch) -> Pose:
    """Return the child's pose in the parent's frame with all coordinates of the joint at zero."""
    turn = np.eye(3)
    if branch.joint.kind == "universal":
        turn = universal_zero(branch.joint)
        turn = turn if branch.sense > 0 else turn.T
    rotation = branch.parent.frame @ turn @ branch.child.frame.T
    return Pose(np.asarray(branch.parent.point) - rotation @ np.asarray(branch.child.point), rotation)


def seated_pose(branch: Branch, parent: Pose, child: Pose) -> tuple[Pose, tuple[float, ...]]:
    """Return the child's pose in the parent's frame nearest to two rough poses, and its joint coordinates.

    The joint is kept exactly: only its free coordinates are taken from the rough poses.
    """
    joint = branch.joint
    a, b = (parent, child) if branch.sense > 0 else (child, parent)
    values = tuple(float(value) for value in joint_coordinate(joint, a, b))
    relative = parent.rotation.T @ child.rotation
    if joint.kind == "spherical":
        rotation = relative
        return Pose(np.asarray(branch.parent.point) - rotation @ np.asarray(branch.child.point), rotation), ()
    turn, way = np.eye(3), 0.0
    if joint.kind == "universal":
        turn = _about_z(values[0]) @ universal_zero(joint) @ _about_z(values[1])
    elif joint.kind == "prismatic":
        way = values[0]
    elif joint.kind == "cylindrical":
        way, turn = values[0], _about_z(values[1])
    else:
        turn = _about_z(values[0])
    if branch.sense < 0:
        turn = turn.T
    rotation = branch.parent.frame @ turn @ branch.child.frame.T
    along = branch.sense * way * branch.parent.frame[:, 2]
    place = np.asarray(branch.parent.point) + along - rotation @ np.asarray(branch.child.point)
    return Pose(place, rotation), values


def is_planar(mechanism: Mechanism, tree: Tree) -> bool:
    """Return whether every joint keeps the links in one plane, whatever the coordinates.

    Then a loop needs no constraint against leaving the plane.
    """
    poses: dict[str, Pose] = {GROUND: IDENTITY}
    normal: np.ndarray | None = None
    for branch in tree.branches:
        parent, local = poses[branch.parent.link], zero_pose(branch)
        poses[branch.child.link] = Pose(parent.point(tuple(local.position)), parent.rotation @ local.rotation)
    joints = sorted(mechanism.joints, key=lambda joint: joint.kind != "revolute")
    for joint in joints:
        axis = poses[joint.a.link].rotation @ np.asarray(joint.a.axis)
        if joint.kind == "revolute":
            normal = axis if normal is None else normal
            across = poses[joint.b.link].rotation @ np.asarray(joint.b.axis)
            if max(np.abs(np.cross(normal, axis)).max(), np.abs(np.cross(normal, across)).max()) > 1e-9:
                return False
        elif joint.kind == "prismatic":
            if normal is None or abs(float(normal @ axis)) > 1e-9:
                return False
        else:
            return False
    return True


def planar_senses(tree: Tree) -> dict[str, Mapping[str, float]]:
    """Return link -> the revolute joints whose angles add up to its own, each with its sign, in a plane."""
    poses: dict[str, Pose] = {GROUND: IDENTITY}
    sums: dict[str, Mapping[str, float]] = {GROUND: {}}
    normal: np.ndarray | None = None
    for branch in tree.branches:
        parent, local = poses[branch.parent.link], zero_pose(branch)
        link = branch.child.link
        poses[link] = Pose(parent.point(tuple(local.position)), parent.rotation @ local.rotation)
        sums[link] = sums[branch.parent.link]
        if branch.joint.kind == "revolute":
            axis = branch.sense * (poses[link].rotation @ np.asarray(branch.child.axis))
            normal = axis if normal is None else normal
            sums[link] = {**sums[link], branch.joint.name: 1.0 if float(axis @ normal) > 0.0 else -1.0}
    return sums


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
