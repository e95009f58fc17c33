"""Forces at the teeth of couplings and in the threads of screws, and what joints transmit because of them.

The row of a coupling acts on coordinates: on each joint's link b, and in reverse on its link a. A screw
transmits that effort itself. Teeth act at the pitch point instead, so that bearings carry the difference.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.vector_method.rotations import cross
from mechsim.model.couplings import Coupling
from mechsim.model.efforts import MeshForce
from mechsim.model.joint_kinds import COLUMN, KINDS
from mechsim.model.joints import Joint
from mechsim.model.meshes import Mesh, mesh_of, meshes_of, threads_of
from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True)
class Share:
    """What a coupling adds to a joint's reaction: wrenches on link b about the joint's point.

    Attributes:
        coupling: its name.
        linear: per unit of its effort, (n, 6).
        separating: per unit of that effort's size, (n, 6).
    """

    coupling: str
    linear: Array
    separating: Array


def mesh_forces(unit: UnitMotion, efforts: Mapping[str, Array]) -> dict[str, MeshForce]:
    """Return the force at the pitch point of each coupling that has one, from efforts of couplings (n,)."""
    return {
        name: MeshForce(
            link=mesh.driven.link,
            by=mesh.driver.link,
            force=efforts[name][:, None] * _in_ground(unit, mesh.carrier, mesh.tangential)
            + magnitude(efforts[name])[:, None] * _in_ground(unit, mesh.carrier, mesh.separating),
            point=_pitch_point(unit, mesh),
        )
        for name, mesh in meshes_of(unit.mechanism).items()
    }


def shares(unit: UnitMotion, joint: Joint) -> Iterator[Share]:
    """Yield what threads and teeth add to the reaction of a joint."""
    threads = threads_of(unit.mechanism)
    for name, law in unit.mechanism.named_laws.items():
        if not {*joint.coordinates} & {*law.coordinates}:
            continue
        if threads.get(name) is joint:
            effort = _on_coordinates(unit, joint, law)
            yield Share(name, effort, np.zeros_like(effort))
        elif (mesh := mesh_of(unit.mechanism, law)) is not None:
            tangential, separating = (
                _from_teeth(unit, joint, mesh, vector) for vector in (mesh.tangential, mesh.separating)
            )
            yield Share(name, _on_coordinates(unit, joint, law) - tangential, -separating)


def magnitude(effort: Array) -> Array:
    """Return the size of efforts whose numbers may be complex steps."""
    return effort * np.sign(np.real(effort))


def _on_coordinates(unit: UnitMotion, joint: Joint, law: Coupling) -> Array:
    """Return the wrench of a coupling's row on link b about the joint's point, per unit of effort, (n, 6)."""
    kind, zero = KINDS[joint.kind], np.zeros((len(unit), 3))
    out = np.zeros((len(unit), 6))
    for terms, factor in ((law.left_terms, 1.0), (law.right_terms, -law.slope)):
        for name in {*terms} & {*joint.coordinates}:
            index = joint.coordinates.index(name)
            if index < len(kind.slides):
                parts = unit.direction(joint.a, COLUMN[kind.slides[index]]), zero
            else:
                parts = zero, unit.axis(joint)
            out = out + factor * terms[name] * np.concatenate(parts, 1)
    return out


def _from_teeth(unit: UnitMotion, joint: Joint, mesh: Mesh, vector: Array) -> Array:
    """Return the wrench with which a joint must oppose a force on the driven one, as of link b, (n, 6)."""
    own, sign = (mesh.driven, 1.0) if mesh.driven.joint is joint else (mesh.driver, -1.0)
    force = sign * own.sign * _in_ground(unit, mesh.carrier, vector)
    arm = _pitch_point(unit, mesh) - unit.point(joint.b.link, joint.b.point)[0]
    return np.concatenate([force, cross(arm, force)], 1)


def _pitch_point(unit: UnitMotion, mesh: Mesh) -> Array:
    """Return the pitch point in the ground frame, (n, 3)."""
    slot, arm = unit.slot(mesh.carrier), _in_ground(unit, mesh.carrier, mesh.point)
    return arm if slot is None else unit.position[:, slot] + arm


def _in_ground(unit: UnitMotion, link: str, vector: Array) -> Array:
    """Return a vector of a link's frame in the ground frame, (n, 3)."""
    slot = unit.slot(link)
    turned = vector if slot is None else unit.rotation[:, slot] @ vector
    return np.broadcast_to(turned, (len(unit), 3))
