"""The lower pairs of a planar mechanism as its plane sees them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mechsim.model.joint_kinds import KINDS, Axis, Kind
from mechsim.model.joints import End, Joint
from mechsim.model.link_poses import PARALLEL, plane_normals
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# parts of a null vector below this are rounding: singular vectors come to about 1e-16 over the gap
# of RANK_TOLERANCE between zero and nonzero singular values
NOTHING = 1e-6


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of the point at the ground's origin, (3,) in [m/s], and angular velocity, (3,) in [rad/s]."""

    velocity: Array
    spin: Array

    def velocity_at(self, point: Array) -> Array:
        return self.velocity + np.cross(self.spin, point)


def motion_words(
    mechanism: Mechanism, poses: Mapping[str, Pose], body: tuple[str, ...], twist: Twist
) -> str | None:
    """Say about or along which joints a body moves; None if no joint determines it."""
    length = mechanism.characteristic_length
    ends = [
        (joint, end)
        for joint in joints_of(mechanism, set(body))
        for end in (joint.a, joint.b)
        if end.link in body
    ]
    positions = {joint.name: poses[end.link].point(end.point)[0] for joint, end in ends}
    speed = float(np.linalg.norm(twist.spin))
    if speed <= NOTHING:
        along = _along(poses, ends, twist.velocity, lambda kind: kind.slides)
        return f"slides along the axis of joint {along[0]}" if along else None
    direction = twist.spin / speed
    pitch = float(twist.velocity @ direction) / speed
    verb = "spins" if abs(pitch) <= NOTHING * length else "screws"
    foot = np.cross(direction, twist.velocity) / speed
    on_axis = [
        name
        for name, position in positions.items()
        if np.linalg.norm(np.cross(position - foot, direction)) <= NOTHING * length
    ]
    along = _along(poses, ends, direction, lambda kind: kind.turns)
    for name in along:
        if name in on_axis:
            return f"{verb} about the axis of joint {name}"
    for first, second in combinations(on_axis, 2):
        if np.linalg.norm(positions[first] - positions[second]) > NOTHING * length:
            return f"{verb} about the line through {first} and {second}"
    if on_axis:
        return f"{verb} about a line through {on_axis[0]} along ({', '.join(f'{x:.3g}' for x in direction)})"
    return None


def _along(
    poses: Mapping[str, Pose],
    ends: list[tuple[Joint, End]],
    direction: Array,
    axes: Callable[[Kind], tuple[Axis, ...]],
) -> list[str]:
    """Return the joints whose axis lies along a direction and is among some axes of their kind."""
    unit = direction / np.linalg.norm(direction)
    return [
        joint.name
        for joint, end in ends
        if "a" in axes(KINDS[joint.kind])
        and np.linalg.norm(np.cross(poses[end.link].rotation[0] @ np.asarray(end.axis), unit)) <= NOTHING
    ]


def joints_of(mechanism: Mechanism, links: set[str]) -> list[Joint]:
    """Return the joints between some links and the rest."""
    return [joint for joint in mechanism.joints if (joint.a.link in links) != (joint.b.link in links)]


def plane_normal(mechanism: Mechanism) -> Array | None:
    """Return the direction across which a mechanism is planar, or None if it is spatial.

    Returns:
        Unit vector in the ground frame, (3,), or None; planar as `model.motion_plane` says it.
    """
    normals = plane_normals(mechanism)
    return None if normals is None else normals[GROUND]


@dataclass(frozen=True, slots=True)
class Pairs:
    """Lower pairs at one place of a planar chain.

    Attributes:
        links: the links that meet there: two, or more on one pin. k links on a pin make k - 1 pairs.
        hinge: whether they turn on a pin; otherwise the two slide.
    """

    links: tuple[str, ...]
    hinge: bool


def planar_pairs(mechanism: Mechanism) -> list[Pairs]:
    """Return the pairs of a planar chain, revolute joints on one pin put together.

    Which of three links on a pin a description joins to which is its author's whim; a structure
    must not depend on it. Links that are fixed to each other are one; a joint that leaves the plane free
    is no pair.
    """
    import networkx as nx

    body = rigid(mechanism)

    hinges = [joint for joint in mechanism.joints if KINDS[joint.kind].hinge]
    pins: nx.Graph[str] = nx.Graph()
    pins.add_nodes_from(joint.name for joint in hinges)
    tolerance = PARALLEL * mechanism.characteristic_length
    pins.add_edges_from((a.name, b.name) for a, b in combinations(hinges, 2) if _on_one_pin(a, b, tolerance))

    order = [link.name for link in mechanism.links]
    pairs: list[Pairs] = []
    for pin in nx.connected_components(pins):
        links = {body[end.link] for name in pin for end in (mechanism.joint(name).a, mechanism.joint(name).b)}
        pairs.append(Pairs(tuple(sorted(links, key=[GROUND, *order].index)), True))
    slides = (joint for joint in mechanism.joints if KINDS[joint.kind].slides and not KINDS[joint.kind].turns)
    return pairs + [Pairs((body[joint.a.link], body[joint.b.link]), False) for joint in slides]


def rigid(mechanism: Mechanism) -> dict[str, str]:
    """Return of every link, the ground included, the first of those that are fixed to it."""
    import networkx as nx

    order = [GROUND, *(link.name for link in mechanism.links)]
    fixed: nx.Graph[str] = nx.Graph()
    fixed.add_nodes_from(order)
    welded = [joint for joint in mechanism.joints if not KINDS[joint.kind].dof]
    fixed.add_edges_from((joint.a.link, joint.b.link) for joint in welded)
    first = {
        name: min(component, key=order.index)
        for component in nx.connected_components(fixed)
        for name in component
    }
    return {name: first[name] for name in order}


def _on_one_pin(first: Joint, second: Joint, tolerance: float) -> bool:
    """Say whether two revolute joints share a link and, on it, an axis."""
    for end in (first.a, first.b):
        for other in (second.a, second.b):
            if end.link == other.link:
                gap = np.asarray(end.point) - np.asarray(other.point)
                if float(np.linalg.norm(np.cross(gap, end.axis))) <= tolerance:
                    return True
    return False
