"""Joints at which no loop can be cut: one side gets a link of its own, and it is cut between the two."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import replace

from mechsim.model.inertia import Inertia
from mechsim.model.joint_kinds import FIXED
from mechsim.model.joints import End, Joint
from mechsim.model.links import GROUND, IDENTITY, Link, Pose
from mechsim.model.mechanism import Mechanism

# between the names of a joint and of the link that its stand-in stands for
STANDS = "@"


def stand_in(joint: Joint) -> str:
    """Return the name of the link that stands where one side of a split joint does."""
    return f"{joint.name}{STANDS}{_stood_for(joint).link}"


def with_stand_ins(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, Pose]:
    """Return poses of links, and where joints are split, of what stands in for some of them."""
    known = {GROUND: IDENTITY, **poses}
    stands = {
        joint.a.link: known[joint.b.link]
        for joint in mechanism.joints
        if joint.kind == FIXED and joint.name == joint.a.link and joint.b.link in known
    }
    return {**stands, **poses}


def split(mechanism: Mechanism, names: Collection[str]) -> Mechanism:
    """Return a mechanism in which some joints lead to links of their own, fixed to those they led to.

    The new link's frame is that of the one it is fixed to, and it takes its share of that one's inertia. The
    fixed joint, called as it, can be cut.
    """
    shares = Counter(_stood_for(joint).link for joint in mechanism.joints if joint.name in names)
    links = [
        replace(link, inertia=_shared(link.inertia, 1 + shares[link.name])) if link.inertia else link
        for link in mechanism.links
    ]
    inertias, joints = {link.name: link.inertia for link in links}, list[Joint]()
    for joint in mechanism.joints:
        if joint.name not in names:
            joints.append(joint)
            continue
        name, end = stand_in(joint), _stood_for(joint)
        links.append(Link(name, inertia=inertias[end.link]))
        own: End = replace(end, link=name)
        led = replace(joint, a=own) if end is joint.a else replace(joint, b=own)
        joints += [led, Joint(name, FIXED, own, end)]
    return replace(mechanism, links=tuple(links), joints=tuple(joints))


def _stood_for(joint: Joint) -> End:
    """Return the end of a joint on whose link another stands: side b, but never the frame."""
    return joint.a if joint.b.link == GROUND else joint.b


def _shared(inertia: Inertia, parts: int) -> Inertia:
    """Return one of so many equal parts of a body that are rigidly joined."""
    if parts == 1:
        return inertia
    x, y, z = ((a / parts, b / parts, c / parts) for a, b, c in inertia.moments)
    return Inertia(inertia.mass / parts, inertia.centre, (x, y, z))
