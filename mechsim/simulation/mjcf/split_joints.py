"""Joints that no constraint closes: one side gets a link of its own there, and between the two it is cut."""

from collections.abc import Collection
from dataclasses import replace

from mechsim.model.mechanism import End, Joint, Link, Mechanism
from mechsim.simulation.mjcf.joints import FIXED

# between the names of a joint and of the link that its stand-in stands for
STANDS = "@"


def stand_in(joint: Joint) -> str:
    """Return the name of the link that stands where side b of a split joint does."""
    return f"{joint.name}{STANDS}{joint.b.link}"


def split(mechanism: Mechanism, names: Collection[str]) -> Mechanism:
    """Return a mechanism in which some joints lead to links of their own, fixed to those they led to.

    The new link's frame is that of the one it is fixed to. The fixed joint, called as it, can be cut.
    """
    links, joints = list(mechanism.links), list[Joint]()
    for joint in mechanism.joints:
        if joint.name not in names:
            joints.append(joint)
            continue
        name = stand_in(joint)
        links.append(Link(name))
        own: End = replace(joint.b, link=name)
        joints += [replace(joint, b=own), Joint(name, FIXED, own, joint.b)]
    return replace(mechanism, links=tuple(links), joints=tuple(joints))
