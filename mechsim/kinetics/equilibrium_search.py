"""Search for equilibria: Newton's method from many configurations, and families of equilibria."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinetics.equations_of_motion import NEXT_TO_START, EquationsOfMotion
from mechsim.kinetics.linearization import (
    displaced_states,
    independent_rates,
    linear_model,
    null_directions,
    reduced_forces,
)
from mechsim.kinetics.state_quantities import joined_configurations
from mechsim.mechanism.motion import select_instants
from mechsim.numerics.arrays import Array, wrapped

# largest number of Newton steps from each start, and largest step
NEWTON_STEPS, MAX_STEP = 60, 0.3
# step below which Newton's method has converged, and number of successive configurations without force beyond
# rounding after which it has: along a family of equilibria steps do not become small
CONVERGED, BALANCED = 1e-12, 3
# stiffnesses below this fraction of the largest are rounding, and no step is taken along their directions
SINGULAR = 1e-14
# difference of coordinates in [rad] or characteristic lengths below which equilibria are equal
SAME_EQUILIBRIUM = 1e-6
# step along a direction without restoring force; a family's equilibria lie at least at this fraction of it
FAMILY_STEP, KEPT = 0.1, 0.5
# distance at which a path along a family has reached another of its equilibria, most steps of the path, and
# the fraction of the distance to go that a step must cover
ARRIVED, PATH_STEPS, PROGRESS = 1e-3, 100, 1e-2


@dataclass(frozen=True, slots=True)
class RestingState:
    """An equilibrium, or one equilibrium of a family.

    Attributes:
        q: the configuration.
        reached: whether it was reached along the motion from the initial configuration.
        dimension: dimension of its family; 0 for an isolated equilibrium.
        singular: whether the mechanism has more degrees of freedom there than next to it.
    """

    q: Coordinates
    reached: bool
    dimension: int
    singular: bool


def newton_equilibria(
    equations: EquationsOfMotion, q: Coordinates, downhill: NDArray[np.bool_] | None = None
) -> list[Coordinates | None]:
    """Return the equilibria that Newton's method reaches from n configurations; None where it reaches none.

    Downhill steps (n,) reverse unstable directions, so that they lead to stable equilibria.
    """
    downhill = np.zeros(len(q), dtype=np.bool_) if downhill is None else downhill
    q = Coordinates(q.values.copy(), q.turns.copy())
    active, reached = np.ones(len(q), dtype=np.bool_), np.zeros(len(q), dtype=np.bool_)
    balanced = np.zeros(len(q), dtype=np.intp)
    for _ in range(NEWTON_STEPS):
        indices = np.flatnonzero(active)
        if not indices.size:
            break
        # both searches take the same steps where all directions are stable
        rows = equations.loops.flat(q.select(indices))
        _, first, copies = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        different, copies = indices[first], copies.ravel()
        dofs, bases = null_directions(equations, q.select(different))
        for dof in np.unique(dofs).tolist():
            own = np.flatnonzero(dofs == dof)
            basis = bases[own, :, bases.shape[2] - dof :]
            forces = reduced_forces(equations, q.select(different[own]), basis)
            equal = np.searchsorted(own, copies[dofs[copies] == dof])
            which, basis, forces = indices[dofs[copies] == dof], basis[equal], select_instants(forces, equal)
            steps = [
                _newton_step(*row)
                for row in zip(forces.stiffness, forces.force, downhill[which], strict=True)
            ]
            step = np.array(steps).reshape(len(which), dof)
            length, force = (np.abs(values).max(1, initial=0.0) for values in (step, forces.force))
            balanced[which] = np.where(force <= forces.rounding, balanced[which] + 1, 0)
            stiffest = np.abs(forces.stiffness).max((1, 2), initial=0.0)
            ended = (length < CONVERGED) & (force <= forces.rounding + CONVERGED * stiffest)
            reached[which] = ended | (balanced[which] >= BALANCED)
            step *= np.where(reached[which], 0.0, np.minimum(1.0, MAX_STEP / np.fmax(length, MAX_STEP)))[
                :, None
            ]
            moved, closed = displaced_states(equations, q.select(which), basis, step)
            q.values[:, which], q.turns[..., which] = moved.q.values, moved.q.turns
            reached[which] &= closed
            active[which] = closed & ~reached[which]
    return [q.select(np.array([i])) if reached[i] else None for i in range(len(q))]


def _newton_step(stiffness: Array, force: Array, downhill: bool) -> Array:
    """Return K^-1 Q; downhill with the absolute values of all eigenvalues."""
    plain = np.asarray(np.linalg.lstsq(stiffness, force, rcond=SINGULAR)[0], np.float64)
    if not downhill or not force.size:
        return plain
    values, vectors = np.linalg.eig(stiffness)
    steep = np.abs(values)
    if (np.abs(values - steep) <= SINGULAR * steep.max()).all():
        return plain
    inverse = (steep > SINGULAR * steep.max()) / np.maximum(steep, np.finfo(float).tiny)
    components = np.linalg.lstsq(vectors, force.astype(np.complex128), rcond=None)[0]
    return np.asarray(np.real(vectors @ (inverse * components)), np.float64)


def all_at_rest(equations: EquationsOfMotion, q: Coordinates) -> bool:
    """Return whether no force beyond rounding moves a mechanism in any of n configurations."""
    for k in range(len(q)):
        configuration = q.select(np.array([k]))
        forces = reduced_forces(equations, configuration, independent_rates(equations, configuration)[None])
        if np.abs(forces.force).max(initial=0.0) > forces.rounding[0]:
            return False
    return True


def difference(equations: EquationsOfMotion, q: Coordinates, other: Coordinates) -> Array:
    """Return the displacement of the free coordinates in units from q to another configuration, (free,).

    Angles differ by less than half a revolution, and parameters of closed curves by half a period.
    """
    from scipy.spatial.transform import Rotation

    tree, units = equations.loops.tree, equations.loops.units
    change = (other.values - q.values)[:, 0] / units
    change[~tree.slides] = wrapped(change[~tree.slides])
    for name, period in tree.closed_parameters.items():
        index = tree.index_of[name]
        change[index] -= period / units[index] * np.rint(change[index] * units[index] / period)
    for ball, first, last in zip(tree.balls, q.turns[..., 0], other.turns[..., 0], strict=True):
        change[ball.first_angle : ball.first_angle + 3] = Rotation.from_matrix(last @ first.T).as_rotvec()
    return change[equations.free]


def same(equations: EquationsOfMotion, q: Coordinates, other: Coordinates) -> bool:
    """Return whether two configurations are equal."""
    return bool(np.abs(difference(equations, q, other)).max(initial=0.0) <= SAME_EQUILIBRIUM)


def distinct(
    equations: EquationsOfMotion, equilibria: Sequence[tuple[Coordinates, bool]]
) -> list[RestingState]:
    """Return different equilibria, and one equilibrium of each family.

    Args:
        equations: equations of motion.
        equilibria: equilibria, and whether they were reached along the motion; those that were come first.
    """
    different: list[tuple[Coordinates, bool]] = []
    for q, reached in equilibria:
        if not any(same(equations, q, other) for other, _ in different):
            different.append((q, reached))
    singular = [_singular(equations, q) for q, _ in different]
    for (q, reached), is_singular in [*zip(different, singular, strict=True)]:
        if is_singular:
            basis = independent_rates(equations, q)
            around = FAMILY_STEP * np.concatenate([np.eye(basis.shape[1]), -np.eye(basis.shape[1])])
            neighbours = _neighbouring_equilibria(equations, q, basis, around)
            neighbours = [other for other in neighbours if not _singular(equations, other)]
            different += [(other, reached) for other in neighbours]
            singular += [False] * len(neighbours)
    dimensions = [
        family_dimension(equations, q, is_singular)
        for (q, _), is_singular in zip(different, singular, strict=True)
    ]
    order = sorted(range(len(different)), key=lambda k: (-dimensions[k], singular[k], not different[k][1]))
    result: list[RestingState] = []
    while order:
        first, *order = order
        (q, reached), dimension = different[first], dimensions[first]
        result.append(RestingState(q, reached, dimension, singular[first]))
        if dimension and order:
            arrived = _reached(equations, q, [different[k][0] for k in order], dimension)
            order = [k for k, on_family in zip(order, arrived, strict=True) if not on_family]
        order = [k for k in order if not same(equations, q, different[k][0])]
    return result


def _singular(equations: EquationsOfMotion, q: Coordinates) -> bool:
    """Return whether the mechanism has more degrees of freedom in a configuration than next to it."""
    basis = independent_rates(equations, q)
    u = NEXT_TO_START * np.eye(basis.shape[1])
    u = np.concatenate([u, u.sum(0, keepdims=True)])
    moved, closed = displaced_states(equations, q, basis, u)
    dofs, _ = null_directions(equations, moved.q)
    return bool((dofs[closed] < basis.shape[1]).any())


def _neighbouring_equilibria(
    equations: EquationsOfMotion, q: Coordinates, basis: Array, u: Array
) -> list[Coordinates]:
    """Return equilibria that Newton's method reaches from displacements (n, dof) of a configuration."""
    moved, closed = displaced_states(equations, q, basis, u)
    ends = newton_equilibria(equations, moved.q.select(closed))
    return [end for end in ends if end is not None]


def family_dimension(equations: EquationsOfMotion, q: Coordinates, singular: bool = False) -> int:
    """Return the dimension of the family of equilibria through a configuration; 0 if it is isolated.

    A direction without restoring force leads along a family if there are equilibria at a finite distance
    along it. A family of singular configurations has no regular ones.
    """
    linear = linear_model(equations, q)
    neutral, basis = np.linalg.qr(linear.neutral)[0], linear.basis
    if not neutral.shape[1]:
        return 0
    ends = _neighbouring_equilibria(equations, q, basis, FAMILY_STEP * neutral.T)
    ends = [end for end in ends if not singular or _singular(equations, end)]
    reached = [neutral.T @ basis.T @ difference(equations, q, end) for end in ends]
    if not reached:
        return 0
    sizes = np.linalg.svd(np.array(reached), compute_uv=False)
    return int(np.count_nonzero(sizes >= KEPT * FAMILY_STEP))


def _reached(
    equations: EquationsOfMotion, start: Coordinates, targets: Sequence[Coordinates], dimension: int
) -> list[bool]:
    """Return which equilibria a path along a family reaches from one of its equilibria."""
    nodes = _family_curve(equations, start) if dimension == 1 else [start]
    reached = [
        min(nodes, key=lambda q, target=target: float(np.linalg.norm(difference(equations, q, target))))
        for target in targets
    ]
    arrived, active = [False] * len(targets), [*range(len(targets))]
    for _ in range(PATH_STEPS):
        steps: list[Coordinates] = []
        for k in [*active]:
            moved = _step_along(equations, reached[k], targets[k], dimension)
            if moved is None:
                active.remove(k)
                arrived[k] = bool(np.linalg.norm(difference(equations, reached[k], targets[k])) <= ARRIVED)
            else:
                steps.append(moved)
        if not active:
            break
        ends = newton_equilibria(equations, joined_configurations(steps))
        for k, moved, end in [*zip(active, steps, ends, strict=True)]:
            if end is None or _returned(equations, reached[k], moved, end):
                active.remove(k)
            else:
                reached[k] = end
    return arrived


def _family_curve(equations: EquationsOfMotion, start: Coordinates) -> list[Coordinates]:
    """Return equilibria along a family of dimension one, in both directions until it closes or ends."""
    nodes = [start]
    for sign in (1.0, -1.0):
        q, along = start, np.zeros(len(equations.free))
        for count in range(PATH_STEPS):
            basis = independent_rates(equations, q)
            forces = reduced_forces(equations, q, basis[None])
            right = np.linalg.svd(forces.stiffness[0])[2][-1]
            tangent = basis @ right
            forward = sign if not count else 1.0 if tangent @ along > 0.0 else -1.0
            step = MAX_STEP * forward * right[None]
            moved, closed = displaced_states(equations, q, basis, step)
            (end,) = newton_equilibria(equations, moved.q) if closed.all() else (None,)
            if end is None or _returned(equations, q, moved.q, end):
                break
            if count and np.linalg.norm(difference(equations, end, start)) < MAX_STEP:
                return nodes
            q, along = end, forward * tangent
            nodes.append(end)
    return nodes


def _returned(equations: EquationsOfMotion, q: Coordinates, moved: Coordinates, end: Coordinates) -> bool:
    """Return whether a step beyond the end of a family, such as a cam's dwell, led back to its start."""
    step, progress = (float(np.linalg.norm(difference(equations, q, other))) for other in (moved, end))
    return progress < PROGRESS * step


def _step_along(
    equations: EquationsOfMotion, q: Coordinates, target: Coordinates, dimension: int
) -> Coordinates | None:
    """Return a configuration a step along a family towards a target; None at the target or a dead end."""
    away = difference(equations, q, target)
    distance = float(np.linalg.norm(away))
    basis = independent_rates(equations, q)
    forces = reduced_forces(equations, q, basis[None])
    right = np.linalg.svd(forces.stiffness[0])[2][basis.shape[1] - dimension :]
    step = right.T @ (right @ (basis.T @ away))
    length = float(np.linalg.norm(step))
    if distance <= ARRIVED or length < PROGRESS * distance:
        return None
    step *= min(1.0, MAX_STEP / length)
    moved, closed = displaced_states(equations, q, basis, step[None])
    return moved.q if closed.all() else None
