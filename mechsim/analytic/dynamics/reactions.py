"""Joint reactions by Newton and Euler with the Jacobian of the loop equations, and what it leaves open."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mechsim.analytic.closure import RANK_TOLERANCE
from mechsim.analytic.closure.loop_equations import row_units
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.vector_method.rotations import cross
from mechsim.maths.arrays import Array
from mechsim.maths.complex_step import least_norm, null_space
from mechsim.model.efforts import Reaction
from mechsim.model.joints import KINDS
from mechsim.model.mechanism import Joint, Mechanism


@dataclass(frozen=True, slots=True)
class Balance:
    """All forces that give the links their motion.

    Attributes:
        drives: driver -> torque on the driven joint's link b about its axis, or force along it, (n,) in
            [N m] or [N].
        holds: coordinate -> likewise, of what holds it.
        reactions: joint -> reaction.
        gears: "driver-driven" of gears and other couplings -> torque on the driven joint's link b about its
            axis, or force along it, (n,) in [N m] or [N]; on the driver's is -slope times it.
        residual: largest imbalance left of any link, relative to the largest wrench, (n,).
        indeterminacy: number of independent self-stresses: forces the joints can hold against each
            other without any load.
    """

    drives: Mapping[str, Array]
    holds: Mapping[str, Array]
    reactions: Mapping[str, Reaction]
    gears: Mapping[str, Array]
    residual: Array
    indeterminacy: int


def balance(unit: UnitMotion, needed: Array) -> Balance:
    """Return the drive torque and all joint reactions that give the links the wrenches they need.

    Solves J' lambda = needed for the multipliers of the loop equations, J being their Jacobian; where
    rows are redundant, by least norm with lengths in units of the mechanism's size.

    Args:
        unit: the motion per radian.
        needed: inertial wrenches less what is applied, about link origins, (n, L, 6) in [N, N m].
    """
    mechanism, jacobian = unit.mechanism, unit.held_rows.jacobian
    columns, rows = _scales(mechanism, jacobian.shape[1])
    scaled = np.swapaxes(jacobian * columns, 1, 2) * rows  # (n, 6 L, m)
    right = needed.reshape(len(unit), -1) * columns
    solution, slack = _least_norm(scaled, right)
    multipliers = solution * rows
    left = np.abs((scaled @ solution[..., None])[..., 0] - right).max(1)
    size = np.maximum(np.abs(right).max(1), np.finfo(np.float64).tiny)
    told = _named(mechanism, multipliers)
    return Balance(
        {name: told[name] for name in mechanism.drivers},
        {name: told[name] for name in mechanism.holds},
        {
            joint.name: _reaction(unit, joint, span, multipliers, slack * rows[:, None])
            for joint, span in zip(mechanism.joints, _spans(mechanism), strict=True)
        },
        {law.label: told[law.label] for law in mechanism.laws},
        left / size,
        slack.shape[-1],
    )


def _least_norm(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Return least-norm solutions, (n, m), and what the matrix takes to nought, (n, m, s)."""
    u, values, vt = np.linalg.svd(np.real(matrix), full_matrices=True)
    rank = int((values > RANK_TOLERANCE * values[:, :1]).sum(1).min())
    if np.iscomplexobj(matrix):
        slack = null_space(matrix, matrix.shape[2] - rank, RANK_TOLERANCE)
        return least_norm(matrix, right, RANK_TOLERANCE), slack
    part = (np.swapaxes(u[:, :, :rank], 1, 2) @ right[..., None]) / values[:, :rank, None]
    return (np.swapaxes(vt[:, :rank], 1, 2) @ part)[..., 0], np.swapaxes(vt[:, rank:], 1, 2)


def _scales(mechanism: Mechanism, count: int) -> tuple[Array, Array]:
    """Return the units of the columns and rows of the loop Jacobian in the mechanism's size."""
    columns = np.tile([mechanism.size] * 3 + [1.0] * 3, len(mechanism.links))
    return columns, row_units(mechanism, count)


def _spans(mechanism: Mechanism) -> list[slice]:
    ends = np.cumsum([0, *(6 - KINDS[joint.kind].freedoms for joint in mechanism.joints)]).tolist()
    return [slice(first, last) for first, last in pairwise(ends)]


def _reaction(unit: UnitMotion, joint: Joint, span: slice, multipliers: Array, slack: Array) -> Reaction:
    wrench, point = _wrench(unit, joint, span, multipliers[..., None])
    alone, _ = _wrench(unit, joint, span, slack)
    scale = np.array([unit.mechanism.size] * 3 + [1.0] * 3)
    undone = np.abs(alone * scale[:, None]).max((0, 2), initial=0.0)
    return Reaction(
        link=joint.b.link,
        by=joint.a.link,
        force=wrench[:, :3, 0],
        moment=wrench[:, 3:, 0],
        point=point,
        determined=undone <= 1e-9,
    )


def _wrench(unit: UnitMotion, joint: Joint, span: slice, multipliers: Array) -> tuple[Array, Array]:
    """Return wrenches on link b about its joint point per column of multipliers, (n, 6, k), and the point."""
    end, sign = (joint.b, 1.0) if unit.slot(joint.b.link) is not None else (joint.a, -1.0)
    slot = unit.slot(end.link)
    assert slot is not None
    part = unit.held_rows.jacobian[:, span, 6 * slot : 6 * slot + 6]
    wrench = sign * np.swapaxes(part, 1, 2) @ multipliers[:, span]
    point, _ = unit.point(joint.b.link, joint.b.point)
    arm = point - unit.position[:, slot]
    force = wrench[:, :3]
    wrench[:, 3:] -= np.swapaxes(cross(arm[:, None], np.swapaxes(force, 1, 2)), 1, 2)
    return wrench, point


def _named(mechanism: Mechanism, multipliers: Array) -> dict[str, Array]:
    """Return the multipliers of couplings, holds and drivers, which are the last rows, by name."""
    names = [*(law.label for law in mechanism.laws), *mechanism.holds, *mechanism.drivers]
    first = multipliers.shape[1] - len(names)
    return {name: multipliers[:, first + i] for i, name in enumerate(names)}
