"""Planar mechanisms: the plane each link moves in, and layers so that links pass one another."""

import numpy as np

from mechsim.model.mechanism import GROUND, Mechanism
from mechsim.shapes.body import span
from mechsim.shapes.shape import Array


def planar_normals(mechanism: Mechanism) -> dict[str, Array] | None:
    """Return the normal of the plane of motion in each link's frame, or None for a spatial mechanism."""
    normals: dict[str, Array] = {GROUND: np.asarray(mechanism.joint(mechanism.driver).a.axis)}
    if any(joint.kind not in ("revolute", "prismatic") for joint in mechanism.joints):
        return None
    for _ in mechanism.links:
        for joint in mechanism.joints:
            for here, there in ((joint.a, joint.b), (joint.b, joint.a)):
                if here.link in normals and there.link not in normals:
                    # a direction has the same parts in both joint frames, but for the turn about the axis
                    parts = here.frame.T @ normals[here.link]
                    if joint.kind == "prismatic" or abs(parts[2]) > 1.0 - 1e-9:
                        normals[there.link] = there.frame @ parts
    for joint in mechanism.joints:
        for end in (joint.a, joint.b):
            if end.link not in normals:
                return None
            tilt = abs(float(normals[end.link] @ np.asarray(end.axis)))
            if abs(tilt - (joint.kind == "revolute")) > 1e-9:
                return None
    for link, normal in normals.items():
        heights = [float(normal @ np.asarray(end.point)) for end in mechanism.ends(link)]
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
