"""Load-displacement curves of one degree of freedom, past limit points.

Along the curve of assemblies with parameter u, a load f on a displacement d is in balance with the
generalised force Q of all other loads where f d'(u) + Q = 0. The parameter keeps its meaning where f or d
turns back. The balance is stable under a constant load where f'(u) d'(u) > 0, since this is the second
derivative of the total potential; f'(u) = 0 is a limit point, where a constant load snaps through.

Source: Z. P. Bazant, L. Cedolin, Stability of Structures (2010), section 4.4 (snap-through).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError, several
from mechsim.kinetics.contacts import CLOSED_GAP
from mechsim.kinetics.curve_equilibria import EquilibriumCurve, curve_through, tangents_next_to
from mechsim.kinetics.dynamic_run import Initial
from mechsim.kinetics.linearization import independent_rates, reduced_forces
from mechsim.kinetics.state_quantities import load_displacement, values_at
from mechsim.kinetics.statics import limits_next_to, prepared_equations, pulls_under
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.quantity import Quantity
from mechsim.numerics.arrays import Array, wrapped
from mechsim.numerics.newton import root

# points in each interval of the curve of assemblies
POINTS = 8
# fewest points of a curve
MIN_POINTS = 3
# step of central differences of fourth order along the curve: truncation and rounding are both about 1e-13
STEP = 1e-3
# rise of a load between points, relative to the largest load, that is rounding of these differences
ROUNDING = 1e-11
# length along the curve below which points are equal
POINT_TOLERANCE = 1e-9
# derivative of the displacement, per radian or characteristic length, below which a load has no effect
NO_EFFECT = 1e-9


@dataclass(frozen=True, slots=True)
class LoadCurve:
    """A load-displacement curve of n points.

    Attributes:
        load: in [N] or [N m], (n,).
        displacement: in [m] or [rad], (n,).
        q: joint coordinate -> its values, (n,) in [m] or [rad].
        stable: whether the balance is stable under a constant load, (n,).
        limit_points: load and displacement of each limit point, (k, 2), in the order of the curve.
        pulling: whether a contact would have to pull there, or a rope to push, (n,); no limit point is listed
            there.
    """

    load: Array
    displacement: Array
    q: Mapping[str, Array]
    stable: NDArray[np.bool_]
    limit_points: Array
    pulling: NDArray[np.bool_]


def load_curve(
    source: Any,
    load: str,
    forces: Forces | None = None,
    *,
    between: tuple[float, float] = (-np.inf, np.inf),
    initial: Mapping[str, Initial] | None = None,
) -> LoadCurve:
    """Return the load on a displacement that holds each configuration of one degree of freedom at rest.

    Args:
        source: a mechanism, or an object that has one.
        load: displacement on which the load does work: a joint coordinate "J", a component "P.x" of a point,
            or "distance:P,Q".
        forces: other applied forces; the default is those of the source.
        between: interval of the displacement in SI that the curve must not leave, nor the limits of joints.
        initial: coordinates `J.q` of a configuration of the curve.

    Raises:
        InputError: for an unknown load, another number of degrees of freedom, or a start outside `between`.
    """
    equations, q = prepared_equations(source, forces, initial or {})
    quantity = load_displacement(load, equations.model.mechanism)
    name, dofs = equations.model.mechanism.name, independent_rates(equations, q).shape[1]
    if dofs != 1:
        raise InputError(f"{name} has {dofs} degrees of freedom, and a load curve needs one; lock joints")
    limits = limits_next_to(equations, q, getattr(equations.model.solver, "ranges", {}))
    curve, start = _dense(curve_through(equations, q, limits))
    displacement = _displacements(curve, quantity, start)
    inside, between = _within_limits(curve, limits, load, start, between, displacement[start])
    required = (displacement >= between[0]) & (displacement <= between[1])
    within = required & inside
    if not within[start]:
        raise InputError(
            f"{name}: {load} is {displacement[start]:.6g} at the start of the load curve, outside "
            f"{between[0]:.6g} to {between[1]:.6g}; start within it (--initial)"
        )
    outside = np.flatnonzero(~within)
    first = int(outside[outside < start].max(initial=-1)) + 1
    last = int(outside[outside > start].min(initial=len(within)))
    effect = NO_EFFECT * (1.0 if quantity.unit == "rad" else equations.loops.tree.length)
    if curve.forward is None:
        # at most the whole of a closed curve, as much on either side of the start as the interval lets
        whole = 0.5 * curve.lengths[:-1].sum()
        positions = np.cumsum(curve.lengths) - curve.lengths - whole
        back, ahead = -positions[first], positions[last - 1]
        if back + ahead >= whole:
            back = min(back, max(0.5 * whole, whole - ahead))
            first, last = np.searchsorted(
                positions, [-back - POINT_TOLERANCE, whole - back + POINT_TOLERANCE]
            ).tolist()
    points, moved = last - first, [False, False]
    for side, k, row, inner in ((0, first - 1, first - 1, first), (1, last - 1, last, last - 1)):
        if 0 <= row < len(within) and not required[row]:
            end = between[int(displacement[row] > between[1])]
            moved[side] = abs(displacement[inner] - end) > effect
            if moved[side]:
                displacement[row] = _moved(curve, quantity, k, row, end)
    rows = np.arange(first - moved[0], last + moved[1])
    q, displacement = curve.q.select(rows), displacement[rows]
    curve = EquilibriumCurve(equations, q, curve.tangents[rows], curve.lengths[rows])
    values, derivatives = _loads(curve, quantity)
    rows = np.flatnonzero(np.abs(derivatives) > effect)
    if min(points, len(rows)) < MIN_POINTS:
        raise InputError(
            f"{name}: the load curve has {several(min(points, len(rows)), 'point')} from {between[0]:.6g} to "
            f"{between[1]:.6g}; give a wider interval"
        )
    q, values, signs = curve.q.select(rows), values[rows], np.sign(derivatives[rows])
    pulling = np.array([pulls_under(equations, q.select(np.array([k])), quantity) for k in range(len(q))])
    # where the displacement turns back, the load has a pole, which is no limit point
    joined = signs[1:] == signs[:-1]
    rise = np.where(joined, np.diff(values), 0.0)
    rise[np.abs(rise) <= ROUNDING * np.abs(values).max()] = 0.0
    rising = (np.append(0.0, rise) + np.append(rise, 0.0)) * signs > 0.0
    peaks = ((rise[1:] > 0.0) != (rise[:-1] > 0.0)) & joined[1:] & joined[:-1]
    turns = 1 + np.flatnonzero(peaks & ((rise[1:] != 0.0) | (rise[:-1] != 0.0)) & ~pulling[1:-1])
    turning = [(*_limit_point(curve, quantity, int(rows[k])),) for k in turns]
    nearest = displacement[rows][turns]
    limit_points = np.reshape(turning, (-1, 2))
    if quantity.angle:
        # the same revolution as that of the curve
        limit_points[:, 1] = nearest + wrapped(limit_points[:, 1] - nearest)
    coordinates = {joint: q.values[i] for joint, i in equations.loops.tree.index_of.items()}
    return LoadCurve(values, displacement[rows], coordinates, rising & ~pulling, limit_points, pulling)


def _within_limits(
    curve: EquilibriumCurve, limits: Array, load: str, start: int, between: tuple[float, float], first: float
) -> tuple[NDArray[np.bool_], tuple[float, float]]:
    """Return the points within the limits of all coordinates, and the displacements within those of its own.

    `first` is the displacement at the start, which limits may only exceed by rounding.
    """
    values, index = curve.q.values, curve.equations.loops.tree.index_of.get(load)
    if index is not None:
        low, high = limits[:, index] - values[index, start]
        between = max(between[0], first + min(low, 0.0)), min(between[1], first + max(high, 0.0))
    beyond = np.abs(np.clip(values, *limits[..., None]) - values) > CLOSED_GAP
    return beyond.sum(0) == 0, between


def _dense(curve: EquilibriumCurve) -> tuple[EquilibriumCurve, int]:
    """Return points in the order of a curve, with their tangents, and the number of the start."""
    interval = np.repeat(np.arange(len(curve.lengths)), POINTS)
    u = (curve.lengths[:, None] * np.arange(POINTS) / POINTS).ravel()
    # both directions begin at the start
    positions, order = np.unique(curve.positions(interval, u), return_index=True)
    lengths = np.append(np.diff(positions), positions[-1] - positions[-2])
    q = curve.configurations(interval[order], u[order])
    tangents, _ = tangents_next_to(curve.equations, q, curve.tangents[interval[order]])
    if curve.forward is None:
        # a closed curve, once in each direction
        whole, rows = curve.lengths.sum(), np.append(np.tile(np.arange(len(order)), 2), 0)
        lengths[-1] = whole - positions[-1]
        positions = np.concatenate([positions - whole, positions, [whole]])
        q, tangents, lengths = q.select(rows), tangents[rows], lengths[rows]
    else:
        tangents = np.where((interval[order] >= curve.forward)[:, None], -tangents, tangents)
    dense = EquilibriumCurve(curve.equations, q, tangents, lengths, curve.forward)
    return dense, int(np.argmin(np.abs(positions)))


def _moved(curve: EquilibriumCurve, quantity: Quantity, k: int, row: int, end: float) -> float:
    """Move a point, k or k + 1, along interval k of a curve to a displacement, which is returned."""
    which = np.array([k])

    def beyond(u: float) -> float:
        """Return the displacement beyond the requested one."""
        q = curve.configurations(which, np.array([u]))
        away = values_at(curve.equations, quantity, curve.equations.kinematics(q)) - end
        return float((wrapped(away) if quantity.angle else away)[0])

    u = root(beyond, 0.0, float(curve.lengths[k]))
    q = curve.configurations(which, np.array([u]))
    tangent = tangents_next_to(curve.equations, q, curve.tangents[which])[0][0]
    curve.q.values[:, row], curve.q.turns[..., row] = q.values[:, 0], q.turns[..., 0]
    curve.tangents[row] = tangent
    curve.lengths[k] = u if row > k else curve.lengths[k] - u
    return end


def _displacements(curve: EquilibriumCurve, quantity: Quantity, start: int) -> Array:
    """Return the displacement at the points of a curve, (n,); angles without jumps from the start on."""
    values = values_at(curve.equations, quantity, curve.equations.kinematics(curve.q))
    return np.unwrap(values) + values[start] - np.unwrap(values)[start] if quantity.angle else values


def _loads(curve: EquilibriumCurve, quantity: Quantity) -> tuple[Array, Array]:
    """Return the loads in balance at the points of a curve, and the derivatives d', (n,) each."""
    equations, every = curve.equations, np.arange(len(curve.q))
    force = reduced_forces(equations, curve.q, curve.tangents[..., None]).force[:, 0]
    displaced = (
        curve.configurations(every, np.full(len(every), step))
        for step in STEP * np.array([-2.0, -1.0, 1.0, 2.0])
    )
    moved = [values_at(equations, quantity, equations.kinematics(q)) for q in displaced]
    if quantity.angle:
        moved = list(np.unwrap(moved, axis=0))
    derivative = (moved[0] - 8.0 * moved[1] + 8.0 * moved[2] - moved[3]) / (12.0 * STEP)
    with np.errstate(divide="ignore", invalid="ignore"):
        return -force / derivative, derivative


def _limit_point(curve: EquilibriumCurve, quantity: Quantity, k: int) -> tuple[float, float]:
    """Return load and displacement of the limit point next to a point of the curve."""

    def around(u: Array) -> EquilibriumCurve:
        """Return the curve at displacements (n,) along the tangent of the point."""
        which = np.full(len(u), k)
        q, tangents = curve.configurations(which, u), curve.tangents[which]
        return EquilibriumCurve(
            curve.equations, q, tangents_next_to(curve.equations, q, tangents)[0], np.ones(len(u))
        )

    def rise(position: float) -> float:
        ends = np.array([-2.0, -1.0, 1.0, 2.0]) * STEP + position
        values, _ = _loads(around(ends), quantity)
        return float(values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3])

    low, high = -float(curve.lengths[k - 1]), float(curve.lengths[k])
    limit = around(np.array([root(rise, low, high) if rise(low) * rise(high) < 0.0 else 0.0]))
    return float(_loads(limit, quantity)[0][0]), float(_displacements(limit, quantity, 0)[0])
