"""Planar mechanisms as they are drawn: flat links in layers, so that they pass one another."""

from mechsim.model.joint_kinds import KINDS
from mechsim.model.link_poses import hinged_normals
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.shapes.body import span


def planar_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return the normal of the plane of motion in each link's frame, or None unless the links can be flat.

    Besides moving in planes, as `model.link_poses` says it, a flat link has all its joints in one plane.
    """
    if not all(KINDS[joint.kind].aligned for joint in mechanism.joints):
        return None
    normals = hinged_normals(mechanism)
    for link, normal in (normals or {}).items():
        heights = [float(normal @ end.point) for end in mechanism.ends(link)]
        if heights and max(heights) - min(heights) > 1e-9 * span(mechanism):
            return None
    return normals


def layers_of(mechanism: Mechanism) -> dict[str, float]:
    """Return layers of a planar mechanism such that links which share a joint lie in different ones."""
    layers: dict[str, int] = {}
    for link in mechanism.links:
        near = {
            layers[other.link]
            for joint in mechanism.joints
            for here, other in ((joint.a, joint.b), (joint.b, joint.a))
            if here.link == link.name and other.link in layers
        }
        layers[link.name] = next(i for i in range(len(near) + 1) if i not in near)
    middle = max(layers.values(), default=0) / 2.0
    return {link: layer - middle for link, layer in layers.items()}
