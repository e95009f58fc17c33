"""The places of joints as dimensions, of a mechanism that has no parameters.

JOINT.at.x moves a joint on both of its links, as `pos` in an MJCF file does: given in link b's frame, and on
link a so that both still meet where the joint's coordinate is zero (of a ball or a universal joint: in the
guess). JOINT.a.at.x and JOINT.b.at.x move it on one link, in that link's frame. JOINT.tilt.x, JOINT.a.tilt.x
and JOINT.b.tilt.x turn its axis likewise.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.analytic.derivatives.dimensions import DesignFamily, Dimension
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, IDENTITY, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.model.rough_poses import rough_poses
from mechsim.numerics.arrays import Array

AXES = "xyz"


def placed_family(form: Form) -> DesignFamily:
    """Return the family of a mechanism whose dimensions are the places of its joints."""
    mechanism = form.mechanism
    own = form if isinstance(form, LoopForm) else LoopForm(mechanism)

    def describe(values: Mapping[str, float]) -> Mechanism:
        return _placed(mechanism, values)

    def make(values: Mapping[str, float]) -> Form:
        return replace(own, mechanism=describe(values)) if values else form

    found = {
        name: Dimension(name, value, unit) for joint in mechanism.joints for name, value, unit in _of(joint)
    }
    usual = tuple(name for name in found if name.count(".") == 2 and ".at." in name)
    return DesignFamily(form.name, found, describe, make, usual=usual)


def _of(joint: Joint) -> list[tuple[str, float, str]]:
    """Return name, value and unit of each dimension of a joint."""
    ends = {"": joint.b, ".a": joint.a, ".b": joint.b}
    found = [
        (f"{joint.name}{side}.at.{axis}", end.point[i], "m")
        for side, end in ends.items()
        for i, axis in enumerate(AXES)
    ]
    return found + [(f"{joint.name}{side}.tilt.{axis}", 0.0, "rad") for side in ends for axis in AXES]


def _placed(mechanism: Mechanism, values: Mapping[str, float]) -> Mechanism:
    """Return a mechanism with joints in other places."""
    found = {joint.name: joint for joint in mechanism.joints}
    for name, value in values.items():
        rest, what, axis = name.rsplit(".", 2)
        own = rest in found and not (rest[:-2] in found and rest[-2:] in (".a", ".b"))
        joint, side = (rest, "") if own else (rest[:-2], rest[-1:])
        change = np.zeros(3)
        i = AXES.index(axis)
        before = mechanism.joint(joint)
        start = (before.a if side == "a" else before.b).point[i] if what == "at" else 0.0
        change[i] = value - start
        found[joint] = _moved(mechanism, found[joint], side, what, change)
    return replace(mechanism, joints=tuple(found.values()))


def _moved(mechanism: Mechanism, joint: Joint, side: str, what: str, change: Array) -> Joint:
    if side:
        return replace(joint, **{side: _end(getattr(joint, side), what, change)})
    return replace(
        joint,
        a=_end(joint.a, what, _between(mechanism, joint) @ change),
        b=_end(joint.b, what, change),
    )


def _between(mechanism: Mechanism, joint: Joint) -> Array:
    """Return the turn from link b's frame to link a's where both sides of a joint meet."""
    if KINDS[joint.kind].aligned:
        return joint.a.frame @ joint.b.frame.T
    poses = {GROUND: IDENTITY, **rough_poses(mechanism)}
    return poses[joint.a.link].rotation.T @ poses[joint.b.link].rotation


def _end(end: End, what: str, change: Array) -> End:
    if what == "at":
        return replace(end, point=_vector(np.asarray(end.point) + change))
    frame = turned_by(end.frame[None], change[None])[0]
    return End(end.link, end.point, _vector(frame[:, 2]), _vector(frame[:, 0]))


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
