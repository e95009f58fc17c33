"""Gaps of one-sided contacts and of ropes.

A one-sided contact opens, and a rope goes slack, by a gap g: the law of a cam's lift s becomes s - g = f(q),
a rope's path p + g = l. While it is closed g is 0, and its force pushes, or the rope pulls: 0 <= g, 0 <= F,
g F = 0 (C. Glocker, *Set-Valued Force Laws*, 2001, ch. 3).
"""

from collections.abc import Container
from dataclasses import replace

from mechsim.model.joint_kinds import PRISMATIC, REVOLUTE
from mechsim.model.joints import Coupling, End, Joint
from mechsim.model.links import EX, GROUND, ORIGIN, VIRTUAL_PREFIX, Inertia, Link
from mechsim.model.mechanism import Mechanism

# end of the names of coordinates that are gaps
GAP = ".gap"


def gap_of(mechanism: Mechanism, coupling: Coupling) -> str:
    """Return the name of the gap that opens where a coupling of a rope or a cam ends; empty for others."""
    name = coupling.name if coupling.rope else coupling.name.removesuffix(".law")
    contact = mechanism.contacts.get(name)
    return name + GAP if coupling.rope or (contact is not None and contact.one_sided) else ""


def gaps_of(mechanism: Mechanism) -> list[str]:
    """Return the names of the gaps that are coordinates of a mechanism."""
    return [joint.name for joint in mechanism.joints if joint.name.endswith(GAP)]


def with_gaps(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with the gaps of its one-sided contacts and ropes as coordinates."""
    present, links, joints = gaps_of(mechanism), list[Link](), list[Joint]()
    couplings: list[Coupling] = []
    for coupling in mechanism.couplings:
        gap = gap_of(mechanism, coupling)
        if gap and gap not in present:
            link = Link(VIRTUAL_PREFIX + gap, inertia=Inertia(0.0, ORIGIN, (ORIGIN, ORIGIN, ORIGIN)))
            straight = mechanism.unit(next(iter(coupling.left_terms))) == "m" or coupling.rope
            kind = PRISMATIC if straight else REVOLUTE
            links.append(link)
            joints.append(Joint(gap, kind, End(GROUND, axis=EX), End(link.name, axis=EX)))
            sign = 1.0 if coupling.rope else -1.0
            coupling = replace(coupling, left={**coupling.left_terms, gap: sign})
        couplings.append(coupling)
    return replace(
        mechanism,
        links=(*mechanism.links, *links),
        # before other joints: closed gaps are independent coordinates at the start
        joints=(*joints, *mechanism.joints),
        couplings=tuple(couplings),
    )


def without_gaps(mechanism: Mechanism, closed: Container[str]) -> Mechanism:
    """Return a mechanism without coordinates of gaps, whose contacts are closed, or without a law."""
    gaps, couplings = gaps_of(mechanism), list[Coupling]()
    for coupling in mechanism.couplings:
        gap = gap_of(mechanism, coupling)
        if gap in gaps:
            if gap not in closed:
                continue
            terms = {name: weight for name, weight in coupling.left_terms.items() if name != gap}
            coupling = replace(coupling, left=terms)
        couplings.append(coupling)
    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link.name.removeprefix(VIRTUAL_PREFIX) not in gaps),
        joints=tuple(joint for joint in mechanism.joints if joint.name not in gaps),
        couplings=tuple(couplings),
    )
