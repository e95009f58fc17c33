"""Gaps of one-sided contacts, of ropes, and between flanks with backlash.

A one-sided contact opens, and a rope goes slack, by a gap g: the law of a cam's lift s becomes s - g = f(q),
a rope's path p + g = l. While it is closed g is 0, and its force pushes, or the rope pulls: 0 <= g, 0 <= F,
g F = 0 (C. Glocker, *Set-Valued Force Laws*, 2001, ch. 3). A coupling with the backlash b has a flank on each
side: left - g = p(right) with -b/2 <= g <= b/2, and a force only where g is at one of its ends.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from mechsim.kinetics.clearances import with_clearances
from mechsim.kinetics.model import REPEATED, DynamicModel
from mechsim.mechanism.bristle_friction import with_bristles
from mechsim.mechanism.joint_kinds import PRISMATIC, REVOLUTE
from mechsim.mechanism.joints import Coupling, End, Joint
from mechsim.mechanism.links import EX, GROUND, NO_INERTIA, VIRTUAL_PREFIX, Link
from mechsim.mechanism.mechanism import Mechanism

# end of the names of coordinates that are gaps
GAP = ".gap"


def gap_of(mechanism: Mechanism, coupling: Coupling) -> str:
    """Return the name of the gap that opens where a coupling ends; empty for one that always holds."""
    name = coupling.name if coupling.rope else coupling.name.removesuffix(".law")
    contact = mechanism.contacts.get(name)
    opens = coupling.rope or coupling.backlash or (contact is not None and contact.one_sided)
    return name + GAP if opens else ""


def opens(mechanism: Mechanism) -> bool:
    """Whether a mechanism has one-sided contacts, ropes or backlash."""
    return any(gap_of(mechanism, coupling) for coupling in mechanism.couplings)


def gaps_of(mechanism: Mechanism) -> list[str]:
    """Return the names of the gaps that are coordinates of a mechanism."""
    return [joint.name for joint in mechanism.joints if joint.name.endswith(GAP)]


def gap_limits(mechanism: Mechanism) -> dict[str, tuple[float, float]]:
    """Return gap -> the values at which it is closed, for the gaps that are coordinates of a mechanism."""
    present, limits = gaps_of(mechanism), dict[str, tuple[float, float]]()
    for coupling in mechanism.couplings:
        if (gap := gap_of(mechanism, coupling)) in present:
            half = 0.5 * coupling.backlash
            limits[gap] = (-half, half) if half else (0.0, np.inf)
    return limits


def with_gaps(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism with the gaps of its one-sided contacts and ropes as coordinates."""
    present, links, joints = gaps_of(mechanism), list[Link](), list[Joint]()
    couplings: list[Coupling] = []
    for coupling in mechanism.couplings:
        gap = gap_of(mechanism, coupling)
        if gap and gap not in present:
            link = Link(VIRTUAL_PREFIX + gap, inertia=NO_INERTIA)
            straight = mechanism.unit(next(iter(coupling.left_terms))) == "m" or coupling.rope
            kind = PRISMATIC if straight else REVOLUTE
            links.append(link)
            joints.append(Joint(gap, kind, End(GROUND, axis=EX), End(link.name, axis=EX)))
            sign = 1.0 if coupling.rope else -1.0
            coupling = replace(coupling, left={**coupling.left_terms, gap: sign}, pressure_angle=None)
        couplings.append(coupling)
    if not links:
        return mechanism
    return replace(
        mechanism,
        links=(*mechanism.links, *links),
        # before other joints: closed gaps are independent coordinates at the start
        joints=(*joints, *mechanism.joints),
        couplings=tuple(couplings),
    )


@lru_cache(maxsize=REPEATED)
def released(model: DynamicModel) -> DynamicModel:
    """Return a model for runs from an initial state: with free pins, gaps, and bristles of frictions."""
    model = with_clearances(model)
    return replace(model, mechanism=with_gaps(model.mechanism), forces=with_bristles(model.forces))


def without_gaps(mechanism: Mechanism, closed: Mapping[str, float]) -> Mechanism:
    """Return a mechanism without coordinates of gaps: closed contacts hold at a value, others have no law."""
    gaps, couplings = gaps_of(mechanism), list[Coupling]()
    for coupling in mechanism.couplings:
        gap = gap_of(mechanism, coupling)
        if gap in gaps:
            if gap not in closed:
                continue
            terms = {name: weight for name, weight in coupling.left_terms.items() if name != gap}
            zeros = coupling.zeros[0] - coupling.left_terms[gap] * closed[gap], coupling.zeros[1]
            coupling = replace(coupling, left=terms, zeros=zeros)
        couplings.append(coupling)
    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link.name.removeprefix(VIRTUAL_PREFIX) not in gaps),
        joints=tuple(joint for joint in mechanism.joints if joint.name not in gaps),
        couplings=tuple(couplings),
    )
