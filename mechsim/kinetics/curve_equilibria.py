"""All equilibria of one degree of freedom: roots of the generalised force along the curve of assemblies.

The curve is divided into intervals of arc length, in each of which the force f and its derivative, which are
exact, determine a cubic. An interval is halved until its cubic, compared with force and derivative in the
middle, shows that f has no root or is monotonic.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinetics.equations_of_motion import EquationsOfMotion
from mechsim.kinetics.equilibrium_search import difference
from mechsim.kinetics.linearization import (
    displaced_states,
    independent_rates,
    null_directions,
    reduced_forces,
)
from mechsim.kinetics.state_quantities import joined_configurations
from mechsim.numerics.arrays import REVOLUTION, Array

# longest and shortest step along a curve, in [rad] or characteristic lengths, and length on either side of
# the start at which an open curve ends, such as that of a slider; and number of coordinates above which the
# longest step and this length grow with the square root of the number, so that each moves as far
STEP, SHORTEST_STEP, MAX_LENGTH, FEW = 0.1, 1e-5, 30.0, 10
# largest deviation of a step from its tangent, relative to its length
MAX_DEVIATION = 0.3
# most halvings of an interval, down to 1e-10 of a step, and points at which a cubic is looked at
HALVINGS, SAMPLES = 32, 9
# multiple of the difference between cubic and force in the middle of an interval that bounds it elsewhere
SAFETY = 4.0
# change of the force after revolutions, relative to its derivative, that is rounding
SAME_FORCE = 1e-9
# most iterations of Newton's method between two points
ITERATIONS = 100
# limits of all coordinates of a curve without limits
NO_LIMITS = np.array([[-np.inf], [np.inf]])


@dataclass(frozen=True)
class EquilibriumCurve:
    """Successive configurations along a curve of assemblies, of one degree of freedom.

    Attributes:
        equations: equations of motion.
        q: configurations at the beginning of n intervals.
        tangents: unit tangents there in the free coordinates in units, (n, free).
        lengths: displacement along the tangent to the end of each interval, (n,).
        forward: number of the intervals in the first direction; the others lead in the opposite one. None if
            there are no others.
    """

    equations: EquationsOfMotion
    q: Coordinates
    tangents: Array
    lengths: Array
    forward: int | None = None

    def positions(self, interval: NDArray[np.intp], u: Array) -> Array:
        """Return the positions along the curve, 0 at its start, (k,)."""
        count = len(self.lengths) if self.forward is None else self.forward
        ends = np.concatenate([np.cumsum(self.lengths[:count]), np.cumsum(self.lengths[count:])])
        return np.where(interval < count, 1.0, -1.0) * ((ends - self.lengths)[interval] + u)

    def configurations(self, interval: NDArray[np.intp], u: Array) -> Coordinates:
        """Return the configurations at displacements along tangents, (k,) each."""
        bases = self.tangents[interval][..., None]
        return displaced_states(self.equations, self.q.select(interval), bases, u[:, None])[0].q

    def forces_at_ends(self) -> tuple[Array, Array]:
        """Return the forces and their derivatives at both ends of all intervals, (2, n) each.

        The end of an interval is the start of the next one in its direction, but along its own tangent.
        """
        n, count = len(self.lengths), len(self.lengths) if self.forward is None else self.forward
        force, derivative = np.empty((2, 2, n))
        force[0], derivative[0], _ = self._forces_at(self.q, self.tangents, self.tangents)
        cosines = (self.tangents[1:] * self.tangents[:-1]).sum(1)
        force[1, :-1], derivative[1, :-1] = force[0, 1:], derivative[0, 1:] / cosines
        last = np.unique([count - 1, n - 1])
        force[1, last], derivative[1, last], _ = self.forces(last, self.lengths[last])
        return force, derivative

    def forces(self, interval: NDArray[np.intp], u: Array) -> tuple[Array, Array, Array]:
        """Return the force along the curve, its derivative by u, and its rounding, (k,) each."""
        q, tangents = self.configurations(interval, u), self.tangents[interval]
        return self._forces_at(q, tangents_next_to(self.equations, q, tangents)[0], tangents)

    def _forces_at(self, q: Coordinates, basis: Array, tangents: Array) -> tuple[Array, Array, Array]:
        """Return the same in n configurations with unit tangents `basis`, by displacements along others."""
        forces = reduced_forces(self.equations, q, basis[..., None])
        derivative = -forces.stiffness[:, 0, 0] / (basis * tangents).sum(1)
        return forces.force[:, 0], derivative, forces.rounding

    def contains(self, q: Coordinates) -> bool:
        """Return whether a configuration lies on the curve."""
        for k in range(len(self.q)):
            away = difference(self.equations, self.q.select(np.array([k])), q)
            if np.linalg.norm(away) <= 2.0 * STEP * _breadth(self.equations):
                nearest = self.configurations(np.array([k]), np.array([away @ self.tangents[k]]))
                if np.abs(difference(self.equations, nearest, q)).max(initial=0.0) <= SHORTEST_STEP:
                    return True
        return False


def _breadth(equations: EquationsOfMotion) -> float:
    """Return the displacement of all coordinates relative to that of `FEW`, at least 1."""
    return float(np.sqrt(max(len(equations.free), FEW) / FEW))


def curve_through(
    equations: EquationsOfMotion, q: Coordinates, limits: Array = NO_LIMITS
) -> EquilibriumCurve:
    """Return the curve of assemblies through a configuration, in both directions unless it is closed.

    It ends in the first interval that crosses one of the limits (2, count) of all coordinates.
    """
    first = independent_rates(equations, q)[:, 0]
    nodes, tangents, lengths, closed = _one_way(equations, q, first, limits)
    forward = None if closed else len(lengths)
    if not closed:
        backward = _one_way(equations, q, -first, limits)[:3]
        nodes, tangents, lengths = nodes + backward[0], tangents + backward[1], lengths + backward[2]
    return EquilibriumCurve(
        equations, joined_configurations(nodes), np.array(tangents), np.array(lengths), forward
    )


def _one_way(
    equations: EquationsOfMotion, start: Coordinates, tangent: Array, limits: Array
) -> tuple[list[Coordinates], list[Array], list[float], bool]:
    """Return nodes, tangents and interval lengths in one direction, and whether the curve returned."""
    nodes, tangents, lengths = [start], [tangent], list[float]()
    breadth = _breadth(equations)
    longest = step = STEP * breadth
    low, high = limits
    while sum(lengths) < MAX_LENGTH * breadth and step >= SHORTEST_STEP:
        q, along = nodes[-1], tangents[-1]
        to_start = difference(equations, q, start)
        ahead, distance = float(along @ to_start), float(np.linalg.norm(to_start))
        returned = 0.9 * distance < ahead <= 1.5 * step and along @ tangents[0] > 0.0
        if len(lengths) > 1 and returned and not _forces_differ(equations, start, q, tangent, limits):
            return nodes, tangents, [*lengths, ahead], True
        moved, closed = displaced_states(equations, q, along[:, None], np.array([[step]]))
        change = difference(equations, q, moved.q) - step * along
        new, cosine = tangents_next_to(equations, moved.q, along[None])
        if not closed[0] or np.linalg.norm(change) > MAX_DEVIATION * step or cosine[0] < 0.9:
            step *= 0.5
            continue
        nodes, tangents, lengths = [*nodes, moved.q], [*tangents, new[0]], [*lengths, step]
        step = min(longest, 2.0 * step)
        if ((moved.q.values[:, 0] < low) | (moved.q.values[:, 0] > high)).any():
            break
    return nodes[:-1], tangents[:-1], lengths, False


def _forces_differ(
    equations: EquationsOfMotion, start: Coordinates, q: Coordinates, tangent: Array, limits: Array
) -> bool:
    """Whether springs, stops or servos distinguish a configuration from itself after revolutions."""
    units = equations.loops.units[:, None]
    revolutions = REVOLUTION * units * np.round((q.values - start.values) / (REVOLUTION * units))
    # a stop distinguishes angles that differ by revolutions
    limited = np.isfinite(limits).any(0) & revolutions.any(1)
    if limited.any() or revolutions[[*equations.sprung.values()]].any():
        return True
    return not equal_forces(equations, start, start.values + revolutions, tangent[:, None])


def equal_forces(equations: EquationsOfMotion, q: Coordinates, values: Array, basis: Array) -> bool:
    """Whether forces along a basis of rates (free, dof) are equal at values (count, 1) after revolutions."""
    if not basis.size:
        return True
    first, second = (reduced_forces(equations, each, basis[None]) for each in (q, replace(q, values=values)))
    change = np.abs(second.force - first.force).max(initial=0.0)
    return bool(change <= SAME_FORCE * np.abs(first.stiffness).max(initial=0.0) + first.rounding.max())


def tangents_next_to(equations: EquationsOfMotion, q: Coordinates, reference: Array) -> tuple[Array, Array]:
    """Return the unit tangents nearest to given ones, (n, free), and the cosines of the angles between."""
    _, bases = null_directions(equations, q)
    tangents = (bases @ (np.swapaxes(bases, 1, 2) @ reference[..., None]))[..., 0]
    sizes = np.linalg.norm(tangents, axis=1)
    return tangents / np.where(sizes > 0.0, sizes, 1.0)[:, None], sizes


def equilibria_on(curve: EquilibriumCurve) -> Coordinates | None:
    """Return the configurations of a curve without generalised force, one of a stretch; None without any."""
    interval, ends = np.arange(len(curve.lengths)), np.stack([np.zeros_like(curve.lengths), curve.lengths])
    force, derivative = curve.forces_at_ends()
    largest = np.abs(force[np.isfinite(force)]).max(initial=0.0)
    located: list[tuple[NDArray[np.intp], Array]] = []
    without_force: list[tuple[NDArray[np.intp], Array]] = []
    for _ in range(HALVINGS):
        if not len(interval):
            break
        middle = ends.mean(0)
        middle_force, middle_derivative, rounding = curve.forces(interval, middle)
        empty, monotonic = _resolved(ends[1] - ends[0], force, derivative, middle_force, middle_derivative)
        still = (np.abs(np.stack([*force, middle_force])) <= rounding).all(0)
        crossed = monotonic & (force[0] * force[1] <= 0.0) & ~still
        without_force.append((interval[still], ends[:, still]))
        located.append(
            (interval[crossed], _roots(curve, interval[crossed], ends[:, crossed], force[0, crossed]))
        )
        # beyond the domain of a spring's expression
        undefined = np.isnan(np.stack([*force, middle_force])).all(0)
        remaining = ~(empty | monotonic | still | undefined)
        interval = np.tile(interval[remaining], 2)
        ends, force, derivative = (
            np.concatenate([np.stack([pair[0], value]), np.stack([value, pair[1]])], 1)
            for pair, value in (
                (ends[:, remaining], middle[remaining]),
                (force[:, remaining], middle_force[remaining]),
                (derivative[:, remaining], middle_derivative[remaining]),
            )
        )
    defined = np.isfinite(force).all(0)
    located.append((interval[defined], ends.mean(0)[defined]))
    pieces, limits = (np.concatenate(values, -1) for values in zip(*without_force, strict=True))
    located.append(_one_of_each_stretch(curve, pieces, limits))
    intervals, u = (np.concatenate(values) for values in zip(*located, strict=True))
    if not len(u):
        return None
    # a force that grows without bound, as of a gas spring of length zero, changes its sign without a root
    bounded = np.abs(curve.forces(intervals, u)[0]) <= largest
    return curve.configurations(intervals[bounded], u[bounded]) if bounded.any() else None


def _one_of_each_stretch(
    curve: EquilibriumCurve, interval: NDArray[np.intp], ends: Array
) -> tuple[NDArray[np.intp], Array]:
    """Return the middle of the middle one of each row of adjacent parts of a curve, such as a cam's dwell.

    Args:
        curve: the curve.
        interval: the interval of each part, (n,).
        ends: displacements of its ends, (2, n).
    """
    if not len(interval):
        return interval, ends[0]
    low, high = np.sort([curve.positions(interval, u) for u in ends], axis=0)
    order = np.argsort(low)
    starts = np.flatnonzero(low[order][1:] - high[order][:-1] > SHORTEST_STEP) + 1
    middle = low + high
    chosen = [
        row[np.argmin(np.abs(middle[row] - low[row[0]] - high[row[-1]]))] for row in np.split(order, starts)
    ]
    return interval[chosen], ends.mean(0)[chosen]


def _resolved(
    length: Array, force: Array, derivative: Array, middle_force: Array, middle_derivative: Array
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return in which of n intervals the force has no root, and in which it is monotonic.

    Args:
        length: of the intervals, (n,).
        force: at their ends, (2, n).
        derivative: by the displacement, at their ends, (2, n).
        middle_force: in their middles, (n,).
        middle_derivative: there, (n,).
    """
    t = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    steep, chord = derivative * length, force[1] - force[0]
    cubic = force[0] + t * (steep[0] + t * (3.0 * chord - 2.0 * steep[0] - steep[1]))
    cubic = cubic + t**3 * (steep[0] + steep[1] - 2.0 * chord)
    rise = steep[0] + 2.0 * t * (3.0 * chord - 2.0 * steep[0] - steep[1])
    rise = rise + 3.0 * t**2 * (steep[0] + steep[1] - 2.0 * chord)
    half = SAMPLES // 2
    resolved = [
        (np.abs(np.sign(values).sum(0)) == SAMPLES)
        & (np.abs(values).min(0) > SAFETY * np.abs(values[half] - exact))
        for values, exact in ((cubic, middle_force), (rise, middle_derivative * length))
    ]
    return resolved[0], resolved[1]


def _roots(curve: EquilibriumCurve, interval: NDArray[np.intp], ends: Array, first: Array) -> Array:
    """Return the roots between two displacements (2, n) by Newton's method, or by bisection where it leaves.

    Args:
        curve: the curve.
        interval: intervals of the curve, (n,).
        ends: displacements with forces of opposite signs.
        first: forces at the first of them, (n,).
    """
    (low, high), u = ends.copy(), ends.mean(0)
    for _ in range(ITERATIONS if len(u) else 0):
        force, derivative, rounding = curve.forces(interval, u)
        before = force * first > 0.0
        low, high = np.where(before, u, low), np.where(before, high, u)
        newton = u - force / np.where(derivative == 0.0, 1.0, derivative)
        inside = (newton > low) & (newton < high) & (derivative != 0.0)
        moved = np.where(np.abs(force) <= rounding, u, np.where(inside, newton, 0.5 * (low + high)))
        converged = np.abs(moved - u).max() <= 2.0**-50 * STEP
        u = moved
        if converged:
            break
    return u
