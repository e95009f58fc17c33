"""Gaps of one-sided contacts, of ropes, and between flanks with backlash.

A one-sided contact opens, and a rope goes slack, by a gap g: the law of a cam's lift s becomes s - g = f(q),
a rope's path p + g = l. While it is closed g is 0, and its force pushes, or the rope pulls: 0 <= g, 0 <= F,
g F = 0 (C. Glocker, *Set-Valued Force Laws*, 2001, ch. 3). A coupling with the backlash b has a flank on each
side: left - g = p(right) with -b/2 <= g <= b/2, and a force only where g is at one of its ends.

A joint with a clearance, a pin that moves freely across the axis of its hole, becomes a planar one in runs
from an initial state. A contact law acts on the distance r of the centres. Otherwise they are tied as by a
slack rope: with virtual coordinates u = x^2 / (2 c) and w = y^2 / (2 c) its law is u + w + g = c / 2. The
gap g = (c^2 - r^2) / (2 c) is smooth everywhere, and at contact its rate is that of c - r.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from mechsim.errors import InputError
from mechsim.kinetics.model import REPEATED, DynamicModel
from mechsim.mechanism.bristle_friction import with_bristles
from mechsim.mechanism.clearances import Clearance
from mechsim.mechanism.joint_kinds import PLANAR, PRISMATIC, REVOLUTE
from mechsim.mechanism.joints import Coupling, End, Joint
from mechsim.mechanism.links import EX, GROUND, NO_INERTIA, VIRTUAL_PREFIX, Link
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.nonlinear_springs import NonlinearSpring
from mechsim.numerics.arrays import Array

# end of the name of a hole after that of its joint, and distance beyond the clearance that is rounding
HOLE, ROUNDING = ".hole", 1e-9


def with_clearances(model: DynamicModel) -> DynamicModel:
    """Return a model whose joints with a clearance are planar, with contact between pin and hole.

    The centres coincide at the start unless initial values place them elsewhere.
    """
    if not model.forces.clearances:
        return model
    mechanism, springs = model.mechanism, [*model.forces.nonlinear_springs]
    ranges, initial = {**model.solver.ranges}, {**model.solver.initial}
    restitution = {**model.solver.restitution}
    made = {law.name for law in mechanism.couplings} | {spring.name for spring in springs}
    for clearance in model.forces.clearances:
        name, hole = clearance.joint, clearance.joint + HOLE
        if hole in made:
            continue
        joint = replace(mechanism.joint(name), kind=PLANAR)
        joints = tuple(joint if other.name == name else other for other in mechanism.joints)
        mechanism = replace(mechanism, joints=joints)
        if name in ranges:
            ranges[f"{name}.turn"] = ranges.pop(name)
        initial = {f"{centre}.{q}": 0.0 for centre in _centred(name) for q in "qv"} | initial
        if clearance.stiffness:
            ends = (joint.a.link, joint.a.point), (joint.b.link, joint.b.point)
            springs.append(NonlinearSpring(ends, clearance.contact, hole))
            continue
        mechanism = _with_hole(mechanism, clearance)
        if clearance.restitution is not None:
            restitution[f"{hole}.gap"] = clearance.restitution
    solver = replace(model.solver, ranges=ranges, initial=initial, restitution=restitution)
    forces = replace(model.forces, nonlinear_springs=tuple(springs))
    return replace(model, mechanism=mechanism, forces=forces, solver=solver)


def _centred(joint: str) -> tuple[str, str]:
    """Return the coordinates of a pin across the axis of its hole, zero where the centres coincide."""
    return f"{joint}.x", f"{joint}.y"


def _with_hole(mechanism: Mechanism, clearance: Clearance) -> Mechanism:
    """Return a mechanism with the virtual coordinates and couplings of a rigid hole."""
    hole, radius = clearance.joint + HOLE, clearance.radius
    names = [f"{VIRTUAL_PREFIX}{hole}.{letter}" for letter in "xy"]
    squares = tuple(
        Coupling(name, {name: 1.0}, {f"{clearance.joint}.{name[-1]}": 1.0}, (0.0, 0.0, 0.5 / radius))
        for name in names
    )
    distance = Coupling(hole, dict.fromkeys(names, 1.0), {}, (0.5 * radius,), rope=True)
    return replace(
        mechanism,
        links=(*mechanism.links, *(Link(name, inertia=NO_INERTIA) for name in names)),
        joints=(
            *mechanism.joints,
            *(Joint(name, PRISMATIC, End(GROUND, axis=EX), End(name, axis=EX)) for name in names),
        ),
        couplings=(*mechanism.couplings, *squares, distance),
    )


def require_in_holes(model: DynamicModel, coordinates: Mapping[str, float | Array]) -> None:
    """Raise InputError for a pin that starts outside its hole."""
    for clearance in model.forces.clearances:
        name, radius = clearance.joint, clearance.radius
        x, y = (coordinates[centre] for centre in _centred(name))
        distance = float(np.max(np.hypot(x, y)))
        if distance > radius * (1.0 + ROUNDING):
            raise InputError(
                f"{model.mechanism.name}: the pin of joint {name!r} starts {distance:.6g} m from the centre "
                f"of its hole, {distance - radius:.3g} m beyond its clearance of {radius:.6g} m; give "
                f"{name}.x and {name}.y within it"
            )


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
