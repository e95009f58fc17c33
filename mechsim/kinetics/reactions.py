"""Joint reactions by Newton and Euler with the Jacobian of the loop equations, and their indeterminacy."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops.maximal_coordinates import is_length, row_units
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.force_record import MeshForce, Reaction
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Coupling, Joint
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.meshes import Mesh, mesh_of, meshes_of, threads_of
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.jets import stepped_least_norm, stepped_null_space
from mechsim.numerics.rank import RANK_TOLERANCE

# component of a self-stress below which it is zero
DETERMINED = 1e-9


@dataclass(frozen=True, slots=True)
class Balance:
    """All forces that cause the motion of the links.

    Attributes:
        drives: driver -> torque on the driven joint's link b about its axis, or force along it, (n,) in
            [N m] or [N].
        holds: locked coordinate -> torque or force that locks it, as in `drives`.
        reactions: joint -> reaction.
        gears: "driver-driven" of gears and other couplings -> torque on the driven joint's link b about its
            axis, or force along it, (n,) in [N m] or [N]; the driver has this multiplied by minus the
            derivative of the driven by the driving coordinate.
        meshes: gear, bevel and rack pair -> force at its pitch point.
        sums: names of several joints between the same two links -> the sum of their reactions, about the
            point of the first. Self-stresses between these joints alone leave it determined.
        undetermined: couplings whose force self-stresses change.
        residual: largest imbalance of any link, relative to the largest wrench, (n,).
        indeterminacy: number of independent self-stresses: joint forces in balance without any load.
        at_branch_point: whether there are more of them than elsewhere, (n,).
    """

    drives: Mapping[str, Array]
    holds: Mapping[str, Array]
    reactions: Mapping[str, Reaction]
    gears: Mapping[str, Array]
    meshes: Mapping[str, MeshForce]
    sums: Mapping[str, Reaction]
    undetermined: frozenset[str]
    residual: Array
    indeterminacy: int
    at_branch_point: NDArray[np.bool_]


def balance(unit: UnitMotion, needed: Array) -> Balance:
    """Return the drive torque and all joint reactions that exert given wrenches on the links.

    Solves J' lambda = needed for the multipliers of the loop equations with the Jacobian J; for redundant
    equations by minimum norm, with lengths in characteristic lengths. At a branch point, where more equations
    are redundant than elsewhere, forces are unbounded; there the result is the minimum-norm solution with the
    smallest imbalance.

    Args:
        unit: the motion per radian.
        needed: inertial wrenches less applied ones, about link origins, (n, L, 6) in [N, N m].
    """
    mechanism, jacobian = unit.mechanism, unit.locked_rows.jacobian
    columns, rows = _scales(mechanism, jacobian.shape[1])
    scaled = np.swapaxes(jacobian * columns, 1, 2) * rows  # (n, 6 L, m)
    right = needed.reshape(len(unit), -1) * columns
    solution, slack, sound = _least_norm(scaled, right[..., None])
    solution = solution[..., 0]
    multipliers = solution * rows
    imbalance = np.abs((scaled @ solution[..., None])[..., 0] - right).max(1)
    scale = np.maximum(np.abs(right).max(1), np.finfo(np.float64).tiny)
    named = _named(mechanism, multipliers)
    carried = [
        _carried(unit, joint, span, multipliers, slack * rows[:, None])
        for joint, span in zip(mechanism.joints, _spans(mechanism), strict=True)
    ]
    return Balance(
        {name: named[name] for name in mechanism.drivers},
        {name: named[name] for name in mechanism.locked},
        {load.joint.name: _reaction(mechanism, load, sound) for load in carried},
        {name: named[name] for name in mechanism.named_laws},
        mesh_forces(unit, named),
        _sums(mechanism, carried, sound),
        frozenset(
            name
            for name in mechanism.named_laws
            if (np.abs(slack[sound, _row(mechanism, name, multipliers)]) > DETERMINED).any()
        ),
        imbalance / scale,
        slack.shape[-1],
        ~sound,
    )


def _least_norm(matrix: Array, right: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return minimum-norm solutions, (n, m, k), the common null space, (n, m, s), and where it is complete.

    At the other instants, (n,) False, the null space is larger. `right` is (n, 6 L, k).
    """
    u, values, vt = np.linalg.svd(np.real(matrix), full_matrices=True)
    significant = values > RANK_TOLERANCE * values[:, :1]
    rank = int(significant.sum(1).max())
    sound = significant.sum(1) == rank
    if np.iscomplexobj(matrix):
        slack = stepped_null_space(matrix, matrix.shape[2] - rank, RANK_TOLERANCE)
        return stepped_least_norm(matrix, right[..., 0], RANK_TOLERANCE)[..., None], slack, sound
    kept = significant[:, :rank, None]
    projected = np.where(kept, np.swapaxes(u[:, :, :rank], 1, 2) @ right, 0.0)
    projected = projected / np.where(kept, values[:, :rank, None], 1.0)
    return np.swapaxes(vt[:, :rank], 1, 2) @ projected, np.swapaxes(vt[:, rank:], 1, 2), sound


def _linear_multipliers(unit: UnitMotion, needed: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return multipliers that exert sets of wrenches (n, L, 6, k), (n, m, k); null space, where complete."""
    jacobian = unit.locked_rows.jacobian
    columns, rows = _scales(unit.mechanism, jacobian.shape[1])
    scaled = np.swapaxes(jacobian * columns, 1, 2) * rows
    right = needed.reshape(len(unit), -1, needed.shape[-1]) * columns[:, None]
    solution, slack, sound = _least_norm(scaled, right)
    return solution * rows[:, None], slack * rows[:, None], sound


def linear_drives(unit: UnitMotion, needed: Array) -> Array:
    """Return torques and forces of the drivers that exert sets of wrenches (n, L, 6, k), (n, drivers, k)."""
    multipliers, _, _ = _linear_multipliers(unit, needed)
    return multipliers[:, multipliers.shape[1] - len(unit.mechanism.drivers) :]


def linear_reactions(
    unit: UnitMotion, needed: Array, joints: Sequence[Joint | str]
) -> list[tuple[Array, Array, NDArray[np.bool_]]]:
    """Return the wrenches of joints that exert several sets of wrenches on the links.

    Args:
        unit: the motion.
        needed: as for `balance`, in columns, (n, L, 6, k): a state, and changes of it.
        joints: k joints, or names of couplings, whose force takes the place of the first component.

    Returns:
        For each joint the wrenches on link b about its point, (n, 6, k), those of self-stresses, (n, 6, s),
        and whether these are all, (n,). Tooth forces that separate wheels are linear about the state.
    """
    mechanism = unit.mechanism
    multipliers, slack, sound = _linear_multipliers(unit, needed)
    spans = dict(zip([joint.name for joint in mechanism.joints], _spans(mechanism), strict=True))
    result: list[tuple[Array, Array, NDArray[np.bool_]]] = []
    for joint in joints:
        if isinstance(joint, str):
            row = _row(mechanism, joint, multipliers)
            wrench, alone = (
                np.pad(values[:, row, None], ((0, 0), (0, 5), (0, 0))) for values in (multipliers, slack)
            )
            result.append((wrench, alone, sound))
            continue
        wrench, _ = _wrench(unit, joint, spans[joint.name], multipliers)
        alone, _ = _wrench(unit, joint, spans[joint.name], slack)
        for share in shares(unit, joint):
            row = _row(mechanism, share.coupling, multipliers)
            along = share.linear + share.separating * np.sign(multipliers[:, row, :1])
            wrench = wrench + along[..., None] * multipliers[:, None, row]
            alone = alone + along[..., None] * slack[:, None, row]
        result.append((wrench, alone, sound))
    return result


def _scales(mechanism: Mechanism, count: int) -> tuple[Array, Array]:
    """Return the units of the columns and rows of the loop Jacobian in characteristic lengths."""
    columns = np.tile([mechanism.characteristic_length] * 3 + [1.0] * 3, len(mechanism.links))
    return columns, row_units(mechanism, count)


def _spans(mechanism: Mechanism) -> list[slice]:
    ends = np.cumsum([0, *(len(is_length(joint)) for joint in mechanism.joints)]).tolist()
    return [slice(first, last) for first, last in pairwise(ends)]


@dataclass(frozen=True, slots=True)
class JointLoad:
    """The wrench of a joint on its link b, and those of self-stresses.

    Attributes:
        joint: the joint.
        wrench: force and moment about the point, (n, 6).
        alone: the same of each self-stress, (n, 6, s).
        apart: the same of separating tooth forces of each self-stress, whose sign is unknown, (n, 6, k).
        point: the joint's point on link b, (n, 3).
    """

    joint: Joint
    wrench: Array
    alone: Array
    apart: Array
    point: Array


def _carried(unit: UnitMotion, joint: Joint, span: slice, multipliers: Array, slack: Array) -> JointLoad:
    wrench, point = _wrench(unit, joint, span, multipliers[..., None])
    alone, _ = _wrench(unit, joint, span, slack)
    apart = [np.zeros((*alone.shape[:2], 0))]
    for share in shares(unit, joint):
        row = _row(unit.mechanism, share.coupling, multipliers)
        effort, stress = multipliers[:, row, None], slack[:, None, row]
        wrench = wrench + (share.linear * effort + share.separating * magnitude(effort))[..., None]
        alone = alone + share.linear[..., None] * stress
        apart.append(share.separating[..., None] * stress)
    # the separating tooth force depends on the magnitude of the coupling force, not on its sign
    return JointLoad(joint, wrench[..., 0], alone, np.concatenate(apart, -1), point)


def _sums(mechanism: Mechanism, loads: Sequence[JointLoad], sound: NDArray[np.bool_]) -> dict[str, Reaction]:
    """Return the sum of the reactions of joints between the same two links, about the first one's point."""
    groups: dict[frozenset[str], list[JointLoad]] = {}
    for load in loads:
        groups.setdefault(frozenset({load.joint.a.link, load.joint.b.link}), []).append(load)
    return {
        " + ".join(load.joint.name for load in group): _reaction(mechanism, _together(group), sound)
        for group in groups.values()
        if len(group) > 1
    }


def _together(loads: Sequence[JointLoad]) -> JointLoad:
    first = loads[0]

    def moved(load: JointLoad, wrenches: Array) -> Array:
        """Return wrenches (n, 6, k) about the first point and on its link b."""
        force, arm = wrenches[:, :3], load.point - first.point
        sign = 1.0 if load.joint.b.link == first.joint.b.link else -1.0
        moment = wrenches[:, 3:] + np.swapaxes(cross(arm[:, None], np.swapaxes(force, 1, 2)), 1, 2)
        return sign * np.concatenate([force, moment], 1)

    wrench = sum((moved(load, load.wrench[..., None]) for load in loads), np.zeros((1, 6, 1)))
    alone = sum((moved(load, load.alone) for load in loads), np.zeros((1, 6, 1)))
    apart = np.concatenate([moved(load, load.apart) for load in loads], -1)
    return JointLoad(first.joint, wrench[..., 0], alone, apart, first.point)


def _reaction(mechanism: Mechanism, load: JointLoad, sound: NDArray[np.bool_]) -> Reaction:
    scale = np.array([mechanism.characteristic_length] * 3 + [1.0] * 3)
    alone = np.real(np.concatenate([load.alone, load.apart], -1)) * scale[:, None]
    undone = np.abs(alone[sound]).max((0, 2), initial=0.0)
    return Reaction(
        link=load.joint.b.link,
        by=load.joint.a.link,
        force=load.wrench[:, :3],
        moment=load.wrench[:, 3:],
        point=load.point,
        determined=undone <= DETERMINED,
        projector=_determined_projector(alone) if alone.shape[-1] else None,
    )


def _determined_projector(alone: Array) -> Array:
    """Return projections of force and moment on the components without self-stress, (n, 2, 3, 3)."""
    u, values, _ = np.linalg.svd(alone.reshape(len(alone), 2, 3, -1), full_matrices=False)
    loose = u * (values > DETERMINED)[..., None, :]
    return np.eye(3) - loose @ np.swapaxes(loose, -1, -2)


def _wrench(unit: UnitMotion, joint: Joint, span: slice, multipliers: Array) -> tuple[Array, Array]:
    """Return wrenches on link b about its joint point per column of multipliers, (n, 6, k), and the point."""
    end, sign = (joint.b, 1.0) if unit.slot(joint.b.link) is not None else (joint.a, -1.0)
    slot = unit.slot(end.link)
    assert slot is not None
    jacobian = unit.locked_rows.jacobian[:, span, 6 * slot : 6 * slot + 6]
    wrench = sign * np.swapaxes(jacobian, 1, 2) @ multipliers[:, span]
    point, _ = unit.point(joint.b.link, joint.b.point)
    arm = point - unit.position[:, slot]
    force = wrench[:, :3]
    wrench[:, 3:] -= np.swapaxes(cross(arm[:, None], np.swapaxes(force, 1, 2)), 1, 2)
    return wrench, point


def _named(mechanism: Mechanism, multipliers: Array) -> dict[str, Array]:
    """Return the multipliers of couplings, locked coordinates and drivers, the last rows, by name."""
    names = [*mechanism.named_laws, *mechanism.locked, *mechanism.drivers]
    first = multipliers.shape[1] - len(names)
    return {name: multipliers[:, first + i] for i, name in enumerate(names)}


def _row(mechanism: Mechanism, coupling: str, multipliers: Array) -> int:
    """Return the row of a coupling among all multipliers, (n, m)."""
    names = [*mechanism.named_laws]
    first = multipliers.shape[1] - len(names) - len(mechanism.locked) - len(mechanism.drivers)
    return first + names.index(coupling)


@dataclass(frozen=True, slots=True)
class Share:
    """Contribution of a coupling to a joint's reaction: wrenches on link b about the joint's point.

    Attributes:
        coupling: name of the coupling.
        linear: wrench per unit of its force, (n, 6).
        separating: wrench per unit magnitude of that force, (n, 6).
    """

    coupling: str
    linear: Array
    separating: Array


def mesh_forces(unit: UnitMotion, forces: Mapping[str, Array]) -> dict[str, MeshForce]:
    """Return the force at the pitch point of each coupling with one, from the forces of couplings (n,)."""
    return {
        name: MeshForce(
            link=mesh.driven.link,
            by=mesh.driver.link,
            force=forces[name][:, None] * _in_ground(unit, mesh.carrier, mesh.tangential)
            + magnitude(forces[name])[:, None] * _in_ground(unit, mesh.carrier, mesh.separating),
            point=_pitch_point(unit, mesh),
        )
        for name, mesh in meshes_of(unit.mechanism).items()
    }


def shares(unit: UnitMotion, joint: Joint) -> Iterator[Share]:
    """Yield the contributions of threads and teeth to the reaction of a joint."""
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
    """Return the magnitude of forces, which may have complex steps."""
    return effort * np.sign(np.real(effort))


def _on_coordinates(unit: UnitMotion, joint: Joint, law: Coupling) -> Array:
    """Return the wrench of a coupling on link b about the joint's point, per unit of its force, (n, 6)."""
    kind, zero = KINDS[joint.kind], np.zeros((len(unit), 3))
    out = np.zeros((len(unit), 6))
    for terms, factor in ((law.left_terms, 1.0), (law.right_terms, -law.ratio)):
        for name in {*terms} & {*joint.coordinates}:
            index = joint.coordinates.index(name)
            if index < len(kind.slides):
                components = unit.direction(joint.a, COLUMN[kind.slides[index]]), zero
            else:
                components = zero, unit.axis(joint)
            out = out + factor * terms[name] * np.concatenate(components, 1)
    return out


def _from_teeth(unit: UnitMotion, joint: Joint, mesh: Mesh, vector: Array) -> Array:
    """Return the wrench on link b with which a joint balances a tooth force on the driven wheel, (n, 6)."""
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
    rotated = vector if slot is None else unit.rotation[:, slot] @ vector
    return np.broadcast_to(rotated, (len(unit), 3))
