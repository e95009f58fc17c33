"""Cuts of loops: a mechanism as a spanning tree and cut joints that constraints close."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import KINDS, Kind
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.link_poses import require_placed, split_joints, virtual_body
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import plane_normals
from mechsim.numerics.graphs import components, distances, spanning_edges
from mechsim.simulation.mjcf.joints import Branch, coincident_points


@dataclass(frozen=True, slots=True)
class Tree:
    """A mechanism with its loops cut.

    Attributes:
        mechanism: the cut mechanism, in which joints that no constraint closes are split.
        branches: tree joints, parents first.
        cuts: the cut joints.
    """

    mechanism: Mechanism
    branches: tuple[Branch, ...]
    cuts: tuple[Joint, ...]


def cut_loops(
    mechanism: Mechanism,
    cut: tuple[str, ...] | None = None,
    *,
    keep: Collection[str] = (),
    acting: Collection[str] = (),
    welds: bool = False,
    first: Collection[str] = (),
) -> Tree:
    """Return a spanning tree of the mechanism's links, rooted in the frame.

    Args:
        mechanism: the mechanism.
        cut: names of the joints to cut; None for the joints that require the fewest constraint rows, and
            among equal joints those farthest from the crank.
        keep: names of joints to cut only if no other joint can be cut.
        acting: coordinates that actuators act on; their joints are not cut.
        welds: whether hinges of a spatial mechanism are split and welded too. Rows of two points on an axis
            depend on each other; they close the loops, but MuJoCo's residual forces brake free motion.
        first: names of joints to cut, if a loop contains them, before any other.

    A joint that no point closes is split and welded if no other joint of its loop can be cut.

    Raises:
        InputError: if cuts leave a loop or divide the chain.
    """
    if not mechanism.joints:
        raise InputError(f"{mechanism.name} has no joints; add one")
    reasons = {
        "driven": {joint.name for joint in mechanism.driven_joints},
        "held": joints_with(mechanism, mechanism.locked),
        "geared": joints_with(mechanism, [name for law in mechanism.laws for name in law.coordinates]),
        "moved by an actuator or a spring": joints_with(mechanism, acting),
    }
    requested, needed = set(cut or ()), set[str]().union(*reasons.values())
    _require_cuttable(mechanism, requested, reasons)
    links, edges = [link.name for link in mechanism.links], [(j.a.link, j.b.link) for j in mechanism.joints]
    require_placed(mechanism, components([GROUND, *links], edges)[0])
    # the joints in the order in which they stay in the tree
    distance = _distance_from_crank(mechanism)

    def priority(joint: Joint) -> tuple[bool | int, ...]:
        """Return the reasons against cutting a joint, the strongest first.

        The number of rows has priority over the distance from the crank: fewer rows make quicker steps.
        """
        steps, kind = min(distance[joint.a.link], distance[joint.b.link]), KINDS[joint.kind]
        name, cuttable = joint.name, _cuttable(kind)
        dof = cuttable and kind.dof
        chosen = name in requested or name in first
        return not chosen, name in needed, not cuttable, name in keep, -dof, -steps

    # among joints with equal priority the first stays
    ordered = sorted(mechanism.joints, key=priority, reverse=True)
    kept = {*spanning_edges((joint.a.link, joint.b.link, joint.name) for joint in ordered)}
    cuts = tuple(joint for joint in mechanism.joints if joint.name not in kept)
    welded = welds and plane_normals(mechanism) is None
    rejected = [
        joint
        for joint in cuts
        if joint.name in needed
        or not (_cuttable(KINDS[joint.kind]) or not KINDS[joint.kind].dof)
        or (welded and KINDS[joint.kind].hinge)
    ]
    if rejected:
        names = {joint.name for joint in rejected}
        whole = tuple(virtual_body(joint) if joint.name in names else joint.name for joint in cuts)
        return cut_loops(split_joints(mechanism, names), whole, keep=keep, acting=acting)
    if cut is not None and {joint.name for joint in cuts if not KINDS[joint.kind].floating} != requested:
        raise InputError(
            f"{mechanism.name}: cutting {', '.join(sorted(requested)) or 'no joint'} does not leave a tree; "
            f"name {len(cuts)} joints, one in each loop"
        )
    # the equation of a rod remains if its coordinates place a link
    rods = tuple(joint for joint in mechanism.joints if joint.name in kept and KINDS[joint.kind].rod)
    placed, branches = {GROUND}, []
    waiting = [joint for joint in mechanism.joints if joint.name in kept]
    while waiting:
        joint = next(j for j in waiting if j.a.link in placed or j.b.link in placed)
        waiting.remove(joint)
        forward = joint.a.link in placed
        parent, child = (joint.a, joint.b) if forward else (joint.b, joint.a)
        branches.append(Branch(joint, parent, child, 1 if forward else -1))
        placed.add(child.link)
    # mj_jacDot of MuJoCo 4.0.0, and so the acceleration of an equality, is wrong for a slide after a ball
    late = {
        branch.joint.name for branch in branches if branch.direction < 0 and _slides_on_ball(branch.joint)
    }
    if cut is None and not late <= {*first}:
        return cut_loops(mechanism, keep=keep, acting=acting, welds=welds, first={*first, *late})
    return Tree(mechanism, tuple(branches), (*cuts, *rods))


def _slides_on_ball(joint: Joint) -> bool:
    kind = KINDS[joint.kind]
    return kind.ball and bool(kind.slides) and not kind.floating


def _require_cuttable(mechanism: Mechanism, requested: set[str], reasons: Mapping[str, set[str]]) -> None:
    """Reject cuts of unknown joints and of joints that must not be cut for a reason."""
    for unknown in requested - {joint.name for joint in mechanism.joints}:
        names = ", ".join(joint.name for joint in mechanism.joints)
        raise InputError(f"{mechanism.name}: there is no joint {unknown!r} to cut; choose from {names}")
    for reason, kept in reasons.items():
        for name in sorted(requested & kept):
            raise InputError(f"{mechanism.name}: joint {name!r} is {reason} and cannot be cut; cut another")


def joints_with(mechanism: Mechanism, coordinates: Collection[str]) -> set[str]:
    """Return the names of the joints with at least one of these coordinates."""
    return {joint.name for joint in mechanism.joints if set(joint.coordinates) & set(coordinates)}


def _cuttable(kind: Kind) -> bool:
    return coincident_points(kind) is not None


def _distance_from_crank(mechanism: Mechanism) -> dict[str, int]:
    """Return the number of joints from the driven link to each link on paths without the frame.

    Without a driver they count from the first joint.
    """
    driver = (mechanism.driven_joints or mechanism.joints)[0]
    driven = driver.b.link if driver.a.link == GROUND else driver.a.link
    neighbours: dict[str, list[str]] = {}
    for joint in mechanism.joints:
        a, b = joint.a.link, joint.b.link
        if GROUND not in (a, b):
            neighbours.setdefault(a, []).append(b)
            neighbours.setdefault(b, []).append(a)
    steps, farthest = distances(neighbours, driven), len(mechanism.joints)
    return {link.name: steps.get(link.name, farthest) for link in mechanism.links} | {GROUND: 0}


def turning_with(mechanism: Mechanism, tree: Tree, cut: Joint) -> dict[str, float]:
    """Return hinge of the tree -> its weight, +1 or -1, in the angle of a cut hinge of a planar mechanism."""
    normals = plane_normals(mechanism)
    assert normals is not None

    def along(end: End) -> float:
        """Return +1 for an axis along the normal, -1 for one against it."""
        return float(np.sign(normals[end.link] @ end.frame[:, 2]))

    sums: dict[str, dict[str, float]] = {GROUND: {}}
    for branch in tree.branches:
        own = sums[branch.child.link] = dict(sums[branch.parent.link])
        if KINDS[branch.joint.kind].turns:
            own[branch.joint.name] = branch.direction * along(branch.child)
    a, b, sign = sums[cut.a.link], sums[cut.b.link], along(cut.b)
    shares = {name: sign * (b.get(name, 0.0) - a.get(name, 0.0)) for name in sorted({*a, *b})}
    return {name: share for name, share in shares.items() if share}
