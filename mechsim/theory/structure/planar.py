"""Whether a mechanism is planar, and its lower pairs as a plane sees them."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure import assemble
from mechsim.model.mechanism import GROUND, IDENTITY, End, Joint, Mechanism, Pose

Array = NDArray[np.float64]

# directions this little out of parallel are parallel: assembly leaves 1e-12, a real tilt is far larger
PARALLEL = 1e-9


def plane_normal(mechanism: Mechanism, poses: Mapping[str, Pose] | None = None) -> Array | None:
    """Return the direction across which a mechanism is planar, or None if it is spatial.

    Planar: all joints are revolute or prismatic, revolute axes lie along one direction and prismatic
    ones across it.

    Args:
        mechanism: the mechanism.
        poses: moving link -> poses that close the loops, of which the first is used; None assembles
            the mechanism at its start.

    Returns:
        Unit vector in the ground frame, (3,), or None.

    Raises:
        AssemblyError: if the loops do not close at the start.
    """
    if any(joint.kind not in ("revolute", "prismatic") for joint in mechanism.joints):
        return None
    poses = assemble(mechanism, [mechanism.start]) if poses is None else poses
    normal = _axis(mechanism.joint(mechanism.driver).a, poses)
    for joint in mechanism.joints:
        axis = _axis(joint.a, poses)
        tilt = np.cross(axis, normal) if joint.kind == "revolute" else axis @ normal
        if not np.abs(tilt).max() <= PARALLEL:
            return None
    return normal


def _axis(end: End, poses: Mapping[str, Pose]) -> Array:
    pose = IDENTITY if end.link == GROUND else poses[end.link].at(0)
    return pose.rotation @ np.asarray(end.axis)


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
    must not depend on it.
    """
    import networkx as nx

    revolutes = [joint for joint in mechanism.joints if joint.kind == "revolute"]
    pins: nx.Graph[str] = nx.Graph()
    pins.add_nodes_from(joint.name for joint in revolutes)
    near = PARALLEL * mechanism.size
    pins.add_edges_from((a.name, b.name) for a, b in combinations(revolutes, 2) if _on_one_pin(a, b, near))

    order = [link.name for link in mechanism.links]
    pairs: list[Pairs] = []
    for pin in nx.connected_components(pins):
        met = {end.link for name in pin for end in (mechanism.joint(name).a, mechanism.joint(name).b)}
        pairs.append(Pairs(tuple(sorted(met, key=[GROUND, *order].index)), True))
    slides = (joint for joint in mechanism.joints if joint.kind == "prismatic")
    return pairs + [Pairs((joint.a.link, joint.b.link), False) for joint in slides]


def _on_one_pin(first: Joint, second: Joint, near: float) -> bool:
    """Say whether two revolute joints share a link and, on it, an axis."""
    for one in (first.a, first.b):
        for other in (second.a, second.b):
            if one.link == other.link:
                gap = np.asarray(one.point) - np.asarray(other.point)
                if float(np.linalg.norm(np.cross(gap, one.axis))) <= near:
                    return True
    return False
