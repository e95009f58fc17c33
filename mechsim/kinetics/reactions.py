"""Joint reactions by Newton and Euler with the Jacobian of the loop equations, and their indeterminacy."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops.maximal_coordinates import row_units
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.force_record import MeshForce, Reaction
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Coupling, Joint
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.meshes import Mesh, mesh_of, meshes_of
from mechsim.numerics.arrays import Array, cross
from mechsim.numerics.block_least_norm import block_least_norm
from mechsim.numerics.graphs import components
from mechsim.numerics.jets import stepped_least_norm, stepped_null_space
from mechsim.numerics.rank import RANK_TOLERANCE

# component of a self-stress below which it is zero
DETERMINED = 1e-9
# number of links up to which the balance is solved by one dense matrix: for a few instants this takes 0.8 of
# the time of blocks, for 400 twice as long (`validation/speed/loop_speed.py`)
DENSE_LINKS = 6


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
    mechanism = unit.mechanism
    solved, imbalance = _multipliers(unit, needed[..., None])
    multipliers, sound = solved.values[..., 0], solved.sound
    named = _named(mechanism, multipliers)
    carried = _carried(unit, solved)
    return Balance(
        {name: named[name] for name in mechanism.drivers},
        {name: named[name] for name in mechanism.locked},
        dict(
            zip(
                [joint.name for joint in mechanism.joints], _reactions(mechanism, carried, sound), strict=True
            )
        ),
        {name: named[name] for name in mechanism.named_laws},
        mesh_forces(unit, named),
        _sums(mechanism, carried, sound),
        frozenset(
            name
            for name in mechanism.named_laws
            if (
                np.abs(solved.stresses([_row(mechanism, name, multipliers.shape[1])])[sound]) > DETERMINED
            ).any()
        ),
        imbalance,
        solved.indeterminacy,
        ~sound,
    )


@dataclass(frozen=True, slots=True)
class Multipliers:
    """Multipliers of the loop equations, and the independent self-stresses.

    Attributes:
        values: minimum-norm multipliers of k sets of wrenches, (n, m, k).
        stresses: equations of a joint and its couplings -> their multipliers in self-stresses, (n, rows, s).
        indeterminacy: number of self-stresses.
        sound: whether there are no more of them, (n,).
    """

    values: Array
    stresses: Callable[[Sequence[int]], Array]
    indeterminacy: int
    sound: NDArray[np.bool_]


def _multipliers(unit: UnitMotion, needed: Array) -> tuple[Multipliers, Array]:
    """Return multipliers that exert sets of wrenches (n, L, 6, k), and relative imbalances of the first."""
    mechanism, equations = unit.mechanism, unit.locked_rows
    count, links = len(equations.blocks), len(mechanism.links)
    columns = np.array([mechanism.characteristic_length] * 3 + [1.0] * 3)
    rows = row_units(mechanism, count)
    right = needed * columns[:, None]
    if links <= DENSE_LINKS or np.iscomplexobj(right) or np.iscomplexobj(unit.position):
        scaled = np.swapaxes(equations.jacobian * np.tile(columns, links), 1, 2) * rows  # (n, 6 L, m)
        flat = right.reshape(len(unit), -1, right.shape[-1])
        solution, slack, sound = _least_norm(scaled, flat)
        exerted = scaled @ solution[..., :1]
        stresses = partial(_selected, slack * rows[:, None])
        nullity = slack.shape[-1]
    else:
        blocks = [
            {slot: values * columns * unit_of for slot, values in block.items()}
            for block, unit_of in zip(equations.blocks, rows, strict=True)
        ]
        clusters = _clusters(mechanism, count)
        solved = block_least_norm(blocks, clusters, right)
        solution, sound, nullity = solved.solution, solved.complete, solved.nullity
        exerted = np.zeros_like(right[..., :1])
        for i, block in enumerate(blocks):
            for slot, values in block.items():
                exerted[:, slot] += values[..., None] * solution[:, None, i, :1]
        cluster_of = {i: (k, j) for k, cluster in enumerate(clusters) for j, i in enumerate(cluster)}

        def stresses(which: Sequence[int]) -> Array:
            null = solved.null[cluster_of[which[0]][0]] if which else np.zeros((len(unit), 0, 0))
            return null[:, [cluster_of[i][1] for i in which]] * rows[which, None]

    first = right[..., 0].reshape(len(unit), -1)
    imbalance = np.abs(exerted.reshape(first.shape) - first).max(1)
    scale = np.maximum(np.abs(first).max(1), np.finfo(np.float64).tiny)
    return Multipliers(solution * rows[:, None], stresses, nullity, sound), imbalance / scale


def _selected(values: Array, which: Sequence[int]) -> Array:
    return values[:, which]


def _clusters(mechanism: Mechanism, count: int) -> list[list[int]]:
    """Return all equations, those together whose self-stresses add up in a reaction or a sum of them."""
    edges: list[tuple[int, int]] = []
    first = dict[frozenset[str], int]()
    coupled = {name: {*law.coordinates} for name, law in mechanism.named_laws.items()}
    for joint, span in zip(mechanism.joints, _spans(mechanism), strict=True):
        edges += pairwise(range(span.start, span.stop))
        if span.start < span.stop:
            edges.append((span.start, first.setdefault(frozenset({joint.a.link, joint.b.link}), span.start)))
            laws = [name for name, names in coupled.items() if names.intersection(joint.coordinates)]
            edges += [(span.start, _row(mechanism, name, count)) for name in laws]
    return [sorted(members) for members in components(range(count), edges)]


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


def linear_drives(unit: UnitMotion, needed: Array) -> Array:
    """Return torques and forces of the drivers that exert sets of wrenches (n, L, 6, k), (n, drivers, k)."""
    multipliers = _multipliers(unit, needed)[0].values
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
    solved, _ = _multipliers(unit, needed)
    multipliers, sound = solved.values, solved.sound
    spans = dict(zip([joint.name for joint in mechanism.joints], _spans(mechanism), strict=True))
    result: list[tuple[Array, Array, NDArray[np.bool_]]] = []
    for joint in joints:
        if isinstance(joint, str):
            row = _row(mechanism, joint, multipliers.shape[1])
            wrench, alone = (
                np.pad(values, ((0, 0), (0, 5), (0, 0)))
                for values in (multipliers[:, [row]], solved.stresses([row]))
            )
            result.append((wrench, alone, sound))
            continue
        span, related = spans[joint.name], [*shares(unit, joint)]
        rows = [_row(mechanism, share.coupling, multipliers.shape[1]) for share in related]
        slack = solved.stresses([*range(span.start, span.stop), *rows])
        count = span.stop - span.start
        both = np.concatenate([multipliers[:, span], slack[:, :count]], 2)
        (both,), _ = _wrenches(unit, [joint], [span], both[None])
        wrench, alone = both[..., : multipliers.shape[2]], both[..., multipliers.shape[2] :]
        for i, share in enumerate(related):
            effort = multipliers[:, None, rows[i]]
            along = (share.linear + share.separating * np.sign(effort[:, 0, :1]))[..., None]
            wrench = wrench + along * effort
            alone = alone + along * slack[:, None, count + i]
        result.append((wrench, alone, sound))
    return result


def _spans(mechanism: Mechanism) -> list[slice]:
    kinds = [KINDS[joint.kind] for joint in mechanism.joints]
    ends = np.cumsum([0, *(kind.forces + kind.moments for kind in kinds)]).tolist()
    return [slice(first, last) for first, last in pairwise(ends)]


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


def _carried(unit: UnitMotion, solved: Multipliers) -> list[JointLoad]:
    """Return the loads of all joints; those with as many equations and self-stresses are computed at once."""
    mechanism, values = unit.mechanism, solved.values[..., :1]
    joints, spans = mechanism.joints, _spans(mechanism)
    related = [[*shares(unit, joint)] for joint in joints]
    slack: list[Array] = []
    alike: dict[tuple[int, int], list[int]] = {}
    for i, (span, own) in enumerate(zip(spans, related, strict=True)):
        rows = [_row(mechanism, share.coupling, values.shape[1]) for share in own]
        slack.append(solved.stresses([*range(span.start, span.stop), *rows]))
        alike.setdefault((span.stop - span.start, slack[i].shape[2]), []).append(i)
    loads: dict[int, JointLoad] = {}
    for (count, _), members in alike.items():
        both = np.stack([np.concatenate([values[:, spans[i]], slack[i][:, :count]], 2) for i in members])
        wrenches, points = _wrenches(unit, [joints[i] for i in members], [spans[i] for i in members], both)
        for i, wrench, point in zip(members, wrenches, points, strict=True):
            load = JointLoad(joints[i], wrench[..., 0], wrench[..., 1:], np.zeros((len(unit), 6, 0)), point)
            loads[i] = _with_shares(unit, load, related[i], values[..., 0], slack[i][:, count:])
    return [loads[i] for i in range(len(joints))]


def _with_shares(
    unit: UnitMotion, load: JointLoad, related: Sequence[Share], values: Array, slack: Array
) -> JointLoad:
    """Return a load with the contributions of couplings, from multipliers and those of self-stresses."""
    wrench, alone, apart = load.wrench, load.alone, [load.apart]
    for i, share in enumerate(related):
        effort = values[:, _row(unit.mechanism, share.coupling, values.shape[1]), None]
        stress = slack[:, None, i]
        wrench = wrench + share.linear * effort + share.separating * magnitude(effort)
        alone = alone + share.linear[..., None] * stress
        apart.append(share.separating[..., None] * stress)
    # the separating tooth force depends on the magnitude of the coupling force, not on its sign
    return JointLoad(load.joint, wrench, alone, np.concatenate(apart, -1), load.point) if related else load


def _sums(mechanism: Mechanism, loads: Sequence[JointLoad], sound: NDArray[np.bool_]) -> dict[str, Reaction]:
    """Return the sum of the reactions of joints between the same two links, about the first one's point."""
    groups: dict[frozenset[str], list[JointLoad]] = {}
    for load in loads:
        groups.setdefault(frozenset({load.joint.a.link, load.joint.b.link}), []).append(load)
    several = [group for group in groups.values() if len(group) > 1]
    names = [" + ".join(load.joint.name for load in group) for group in several]
    return dict(zip(names, _reactions(mechanism, [*map(_together, several)], sound), strict=True))


def _together(loads: Sequence[JointLoad]) -> JointLoad:
    first = loads[0]

    def moved(load: JointLoad, wrenches: Array) -> Array:
        """Return wrenches (n, 6, k) about the first point and on its link b."""
        force, arm = wrenches[:, :3], load.point - first.point
        sign = 1.0 if load.joint.b.link == first.joint.b.link else -1.0
        moment = wrenches[:, 3:] + np.swapaxes(cross(arm[:, None], np.swapaxes(force, 1, 2)), 1, 2)
        return sign * np.concatenate([force, moment], 1)

    wrench = sum((moved(load, load.wrench[..., None]) for load in loads), np.zeros((1, 6, 1)))
    # a joint without equations has no self-stress
    stressed = max((load.alone for load in loads), key=lambda alone: alone.shape[-1])
    alone = sum(
        (moved(load, load.alone) for load in loads if load.alone.shape == stressed.shape),
        np.zeros_like(stressed),
    )
    apart = np.concatenate([moved(load, load.apart) for load in loads], -1)
    return JointLoad(first.joint, wrench[..., 0], alone, apart, first.point)


def _reactions(mechanism: Mechanism, loads: Sequence[JointLoad], sound: NDArray[np.bool_]) -> list[Reaction]:
    """Return reactions; those with as many self-stresses are computed at once."""
    scale = np.array([mechanism.characteristic_length] * 3 + [1.0] * 3)
    stresses = [np.real(np.concatenate([load.alone, load.apart], -1)) * scale[:, None] for load in loads]
    alike: dict[int, list[int]] = {}
    for i, alone in enumerate(stresses):
        alike.setdefault(alone.shape[-1], []).append(i)
    determined, projectors = dict[int, NDArray[np.bool_]](), dict[int, Array]()
    for count, members in alike.items():
        alone = np.stack([stresses[i] for i in members])
        largest = np.abs(alone[:, sound]).max(1, initial=0.0).max(-1, initial=0.0)
        determined |= zip(members, largest <= DETERMINED, strict=True)
        if count:
            projectors |= zip(members, _determined_projectors(alone), strict=True)
    return [
        Reaction(
            link=load.joint.b.link,
            by=load.joint.a.link,
            force=load.wrench[:, :3],
            moment=load.wrench[:, 3:],
            point=load.point,
            determined=determined[i],
            projector=projectors.get(i),
        )
        for i, load in enumerate(loads)
    ]


def _determined_projectors(alone: Array) -> Array:
    """Return projections of forces and moments on the components without self-stress, (j, n, 2, 3, 3).

    P = 1 - sum of u u' over an orthonormal basis u of those of self-stresses (Gram and Schmidt, with pivots).
    """
    rest = alone.reshape(*alone.shape[:2], 2, 3, -1)
    projector = np.broadcast_to(np.eye(3), (*rest.shape[:3], 3, 3))
    for _ in range(3):
        length = np.sqrt((rest**2).sum(-2, keepdims=True))
        longest = length.argmax(-1)[..., None]
        length = np.take_along_axis(length, longest, -1)
        if not (loose := length > DETERMINED).any():
            break
        u = np.where(loose, np.take_along_axis(rest, longest, -1), 0.0) / np.where(loose, length, 1.0)
        projector = projector - u * np.swapaxes(u, -1, -2)
        rest = rest - u * (u * rest).sum(-2, keepdims=True)
    return projector


def _wrenches(
    unit: UnitMotion, joints: Sequence[Joint], spans: Sequence[slice], multipliers: Array
) -> tuple[Array, Array]:
    """Return wrenches on links b about their points, (j, n, 6, k), and these points, (j, n, 3).

    Args:
        unit: the motion.
        joints: j joints with as many equations.
        spans: their equations.
        multipliers: of these equations, (j, n, rows, k).
    """
    signs = np.array([1.0 if unit.slot(joint.b.link) is not None else -1.0 for joint in joints])
    ends = [joint.b if sign > 0.0 else joint.a for joint, sign in zip(joints, signs, strict=True)]
    slots = [slot for end in ends if (slot := unit.slot(end.link)) is not None]
    rows = unit.locked_rows.blocks
    blocks = np.zeros((len(joints), 0, len(unit), 6))
    if multipliers.shape[2]:
        blocks = np.array(
            [[row[slot] for row in rows[span]] for slot, span in zip(slots, spans, strict=True)]
        )
    wrench = np.moveaxis(blocks, 1, 3) @ (signs[:, None, None, None] * multipliers)
    points = np.stack([unit.point(joint.b.link, joint.b.point)[0] for joint in joints])
    arms = points - np.moveaxis(unit.position[:, slots], 1, 0)
    force = np.swapaxes(wrench[..., :3, :], 2, 3)
    wrench[..., 3:, :] -= np.swapaxes(cross(arms[:, :, None], force), 2, 3)
    return wrench, points


def _named(mechanism: Mechanism, multipliers: Array) -> dict[str, Array]:
    """Return the multipliers of couplings, locked coordinates and drivers, the last rows, by name."""
    names = [*mechanism.named_laws, *mechanism.locked, *mechanism.drivers]
    first = multipliers.shape[1] - len(names)
    return {name: multipliers[:, first + i] for i, name in enumerate(names)}


def _row(mechanism: Mechanism, coupling: str, count: int) -> int:
    """Return the row of a coupling among all `count` equations."""
    names = [*mechanism.named_laws]
    first = count - len(names) - len(mechanism.locked) - len(mechanism.drivers)
    return first + names.index(coupling)


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
    for name, law in unit.mechanism.named_laws.items():
        if not {*joint.coordinates} & {*law.coordinates}:
            continue
        if unit.threads.get(name) is joint:
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
