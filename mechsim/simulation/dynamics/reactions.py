"""What a joint transmits, read from what MuJoCo carries through the tree and from its loop constraints."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.model.mechanism import Joint
from mechsim.simulation.dynamics.loaded_model import LoadedModel

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Transmitted:
    """What the geometry of a joint transmits to its link b from its link a, in ground axes.

    Friction, springs and the drive in the joint act along its freedom and are not in it.

    Attributes:
        force: (n, 3) in [N].
        moment: about the joint's point on link b, (n, 3) in [N m].
        point: that point, (n, 3) in [m].
    """

    force: Array
    moment: Array
    point: Array


def transmitted(
    bench: LoadedModel, joint: Joint, fields: Mapping[str, Array], multipliers: Array
) -> Transmitted:
    """Return what a joint transmits.

    Args:
        bench: the mechanism.
        joint: one of its joints, in the tree or cut.
        fields: of a model on whose bodies all forces act as wrenches.
        multipliers: of the loop constraints, (n, m); each pulls a pair's first point, which is on link a.
    """
    axes = fields["xmat"].reshape(len(multipliers), -1, 3, 3)
    first, second = bench.body(joint.a.link), bench.body(joint.b.link)
    point = fields["xpos"][:, second] + axes[:, second] @ np.asarray(joint.b.point)
    numbers = bench.cut_pairs(joint)
    if numbers:
        force, moment = np.zeros((2, len(point), 3))
        for number in numbers:
            pulled = -multipliers[:, 3 * number : 3 * number + 3]
            body, local = bench.loops.pairs[number].ends[1]
            force += pulled
            moment += np.cross(fields["xpos"][:, body] + axes[:, body] @ local - point, pulled)
    else:
        below = bench.parent(joint.b.link) == joint.a.link
        body, sign = (second, 1.0) if below else (first, -1.0)
        wrench = sign * fields["cfrc_int"][:, body]  # on the child by its parent: moment, force
        root = fields["subtree_com"][:, bench.model.body_rootid[body]]
        force = wrench[:, 3:]
        moment = wrench[:, :3] + np.cross(root - point, force)
    a, b = axes[:, first] @ np.asarray(joint.a.axis), axes[:, second] @ np.asarray(joint.b.axis)
    return Transmitted(*_constraint_part(joint, force, moment, a, b), point)


def _constraint_part(joint: Joint, force: Array, moment: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Return force and moment without what acts along the joint's freedoms, for its axes on a and b."""
    if joint.kind == "spherical":
        return force, np.zeros_like(moment)
    if joint.kind == "universal":
        across = np.cross(a, b)
        across = across / np.sqrt((across**2).sum(1))[:, None]
        return force, across * (across * moment).sum(1)[:, None]
    along = b * (b * moment).sum(1)[:, None]
    turns, slides = joint.kind in ("revolute", "cylindrical"), joint.kind in ("prismatic", "cylindrical")
    if slides:
        force = force - b * (b * force).sum(1)[:, None]
    return force, moment - along if turns else moment
