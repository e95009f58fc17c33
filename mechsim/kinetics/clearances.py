"""Joints with a clearance in runs from an initial state: a pin moves freely across the axis of its hole.

The joint becomes a planar one. A contact law acts on the distance r of the centres. Otherwise they are tied
as by a slack rope: with virtual coordinates u = x^2 / (2 c) and w = y^2 / (2 c) its law is u + w + g = c / 2.
The gap g = (c^2 - r^2) / (2 c) is smooth everywhere, and at contact its rate is that of c - r.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.errors import InputError
from mechsim.kinetics.model import DynamicModel
from mechsim.mechanism.clearances import Clearance
from mechsim.mechanism.joint_kinds import PLANAR, PRISMATIC
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
