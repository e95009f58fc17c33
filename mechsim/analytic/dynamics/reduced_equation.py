"""Coefficients of the reduced equation as functions of the crank angle, interpolated to rounding.

Each arc of the crank is represented by exact values at Chebyshev points. One vectorised call solves them when
the crank first reaches the arc. Barycentric interpolation gives the values in between. Arcs are so short that
the last Chebyshev coefficients are rounding.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.dynamics.applied_forces import Applied, applied, power
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.vector_method.rotations import dot
from mechsim.errors import AssemblyError
from mechsim.model.motion import short_repr
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import size_of

# points on an arc, arcs in a revolution, and length in [rad] below which the crank is at a dead centre
POINTS = 20
NODE_COUNT = 24
ARC = REVOLUTION / NODE_COUNT
SHORTEST = 1e-5
# times that arcs are halved when all arcs of a revolution are solved at once
HALVINGS = 5
# limit of the last Chebyshev coefficients relative to the largest values: rounding of a closed form
# (`RESOLVED`), and of poses assembled by Newton's method (`ASSEMBLED`). Near a dead centre rounding grows as
# the inverse square of the conditioning. `NOISY` applies to arcs shorter than the longest divided by
# `SHORTER`, and `INTERPOLATION_ERROR` to arcs shorter than `HARDLY` times the shortest. A crank then passes a
# dead centre at a distance of 1e-9 characteristic lengths from its path
RESOLVED, ASSEMBLED, NOISY, SHORTER = 3e-14, 1e-12, 1e-11, 16.0
INTERPOLATION_ERROR, HARDLY = 1e-8, 16.0

_K = np.arange(POINTS)
NODES = -np.cos(np.pi * _K / (POINTS - 1))
WEIGHTS = np.where((_K == 0) | (_K == POINTS - 1), 0.5, 1.0) * (-1.0) ** _K
# values at the nodes -> Chebyshev coefficients
_TRANSFORM = np.linalg.inv(np.polynomial.chebyshev.chebvander(NODES, POINTS - 1))


@dataclass(frozen=True, slots=True)
class Arc:
    """An arc from `low` to `high` in [rad] and the values at its nodes, (POINTS, columns)."""

    low: float
    high: float
    values: Array

    def evaluate(self, angle: float) -> Array:
        """Return the interpolated columns at one crank angle."""
        x = (2.0 * angle - self.low - self.high) / (self.high - self.low)
        gaps = x - NODES
        hit = np.flatnonzero(gaps == 0.0)
        if hit.size:
            return self.values[hit[0]]
        shares = WEIGHTS / gaps
        return shares @ self.values / shares.sum()


@dataclass(slots=True)
class CrankTable:
    """Columns inertia, its derivative, static, energy, damping, rates with Coulomb friction, load leverage.

    Attributes:
        model: mechanism with masses and forces.
        arcs: arcs solved so far, by index.
        periodic: whether arcs repeat after one revolution; one revolution then suffices.
        ahead: whether solving all arcs of a revolution at once was tried.
        coarse: ends of arcs that must be shorter.
    """

    model: DynamicModel
    arcs: dict[int, list[Arc]] = field(default_factory=dict)
    periodic: bool = False
    ahead: bool = False
    coarse: set[tuple[float, float]] = field(default_factory=set)

    def evaluate(self, angle: float) -> Array:
        """Return all columns at a crank angle in [rad].

        Raises:
            AssemblyError: if the loops do not close, or the crank cannot pass.
        """
        if self.periodic:
            angle = angle % REVOLUTION
        index = int(np.floor(angle / ARC))
        if isinstance(self.model.solver, LoopForm) and not self.ahead:
            self.ahead = True
            self._look_ahead(index)
            return self.evaluate(angle)
        for arc in self.arcs.setdefault(index, []):
            if arc.low <= angle <= arc.high:
                return arc.evaluate(angle)
        low, high = index * ARC, (index + 1) * ARC
        while True:
            arc = None if (low, high) in self.coarse else self._charted(low, high)
            if arc is not None:
                self.arcs[index].append(arc)
                self._compare(index)
                return arc.evaluate(angle)
            self.coarse.add((low, high))
            middle = 0.5 * (low + high)
            low, high = (low, middle) if angle <= middle else (middle, high)
            if high - low < SHORTEST:
                raise AssemblyError(
                    f"{self.model.mechanism.name}: the reduced equation has no smooth coefficients at "
                    f"crank angle {angle:.6g} rad: a dead centre, or one within rounding, or a "
                    "spring whose joint passes half a turn"
                )

    def _compare(self, index: int) -> None:
        """Compare a new arc with the one a revolution away; if they agree, keep one revolution of arcs."""
        new = self.arcs[index][-1]
        for other in (index - NODE_COUNT, index + NODE_COUNT):
            for old in self.arcs.get(other, ()):
                apart = (other - index) * ARC
                if abs(old.low - new.low - apart) + abs(old.high - new.high - apart) > 1e-9:
                    continue
                if _alike(old, new):
                    self.periodic, self.arcs = True, {}
                    return

    def _look_ahead(self, index: int) -> None:
        """Solve the arcs of the revolution around an index in few calls: loop equations have a cost per call.

        Arcs that a few halvings do not resolve are left until the crank reaches them; so are all arcs if the
        crank cannot make the revolution.
        """
        ends = [(k * ARC, (k + 1) * ARC) for k in range(index - NODE_COUNT // 2, index + NODE_COUNT // 2)]
        for _ in range(HALVINGS):
            try:
                values = columns(self.model, np.concatenate([_nodes(*end) for end in ends]))
            except AssemblyError:
                return
            shorter = []
            for end, chunk in zip(ends, np.split(values, len(ends)), strict=True):
                arc = self._resolved(*end, chunk)
                if arc is not None:
                    self.arcs.setdefault(int(np.floor(sum(end) / 2.0 / ARC)), []).append(arc)
                else:
                    middle = 0.5 * sum(end)
                    shorter += [(end[0], middle), (middle, end[1])]
            ends = shorter
            if not shorter:
                break
        self._wrap(index - NODE_COUNT // 2)

    def _wrap(self, first: int) -> None:
        """Use the arcs of a revolution for all revolutions if its first arc repeats after it."""
        for old in self.arcs.get(first, ()):
            new = self._charted(old.low + REVOLUTION, old.high + REVOLUTION)
            if new is None or not _alike(old, new):
                return
        arcs = [arc for resolved in self.arcs.values() for arc in resolved]
        self.periodic, self.arcs = True, {}
        for arc in arcs:
            turns = REVOLUTION * np.floor(0.5 * (arc.low + arc.high) / REVOLUTION)
            moved = Arc(arc.low - turns, arc.high - turns, arc.values)
            self.arcs.setdefault(int(np.floor(0.5 * (moved.low + moved.high) / ARC)), []).append(moved)

    def _charted(self, low: float, high: float) -> Arc | None:
        """Return an arc if its points resolve every column; None if it must be shorter."""
        try:
            return self._resolved(low, high, columns(self.model, _nodes(low, high)))
        except AssemblyError:
            return None

    def _resolved(self, low: float, high: float, values: Array) -> Arc | None:
        """Return an arc with values at its points; None if they do not resolve every column."""
        tail = np.abs(_TRANSFORM[-3:] @ values).max(0)
        largest = np.abs(values).max(0)
        # an error of the inertia derivative counts by its integral over the arc, relative to the inertia
        largest[1] = max(largest[1], largest[0] / (high - low))
        largest[2:4] = largest[2:4].max()
        largest[2:] = np.maximum(largest[2:], _floors(self.model, len(largest) - 2))
        exact = ASSEMBLED if isinstance(self.model.solver, LoopForm) else RESOLVED
        least = (
            exact
            if high - low > ARC / SHORTER
            else NOISY
            if high - low > HARDLY * SHORTEST
            else INTERPOLATION_ERROR
        )
        return Arc(low, high, values) if (tail <= least * largest).all() else None


def _floors(model: DynamicModel, count: int) -> Array:
    """Return the smallest scales, (count,), of the columns from the static torque on.

    A column far below its scale is rounding of zero, such as the motion of a planar linkage out of its plane
    or the rate of a joint that never rotates.
    """
    length, forces = model.mechanism.characteristic_length, model.forces
    lever = min(1.0, length)
    masses = sum(link.inertia.mass for link in model.mechanism.links if link.inertia is not None)
    weight = masses * length * float(np.linalg.norm(forces.gravity))
    damping = lever**2 * sum(friction.viscous + friction.viscous_turn for friction in forces.friction)
    damping += length**2 * sum(spring.damping for spring in forces.springs)
    loads, couples = [length] * 3 * len(forces.loads), [1.0] * 3 * len(forces.couples)
    dry = [lever] * (count - 3 - len(loads) - len(couples))
    return np.array([weight, weight, damping, *dry, *loads, *couples])


def _alike(arc: Arc, other: Arc) -> bool:
    """Return whether two arcs a revolution apart agree."""
    return bool((np.abs(arc.values - other.values) <= 1e-9 * np.abs(arc.values).max(0)).all())


def _nodes(low: float, high: float) -> Array:
    """Return the points of an arc, (POINTS,)."""
    return 0.5 * (low + high) + 0.5 * (high - low) * NODES


def columns(model: DynamicModel, angles: Array) -> Array:
    """Return all columns at crank angles, (n, columns)."""
    unit = model.unit_motion(angles)
    acting = applied(model, unit)
    reduced = coefficients(unit, acting, model.forces.flywheel)
    rates = [friction.rate for friction in acting.dry]
    leverage = load_leverage(model, unit).reshape(len(unit), -1)
    fixed = (reduced.inertia, reduced.inertia_derivative, reduced.static, reduced.energy, reduced.damping)
    return np.column_stack([*fixed, *rates, leverage])


@dataclass(frozen=True, slots=True)
class Reduced:
    """Coefficients of the reduced equation at n crank angles.

    With crank speed w: Q = static - damping w - coulomb sign(w) + loads + torque on the crank.

    Attributes:
        angle: crank angle, (n,) in [rad].
        inertia: reduced inertia J, flywheel included, (n,) in [kg m2].
        inertia_derivative: J' = dJ/dangle, (n,) in [kg m2/rad].
        static: torque of gravity and springs, (n,) in [N m].
        damping: damping coefficient, (n,) in [N m s], 0 or more.
        coulomb: torque of Coulomb friction, (n,) in [N m], 0 or more.
        energy: potential energy of gravity and springs, (n,) in [J]; static is minus its derivative.
    """

    angle: Array
    inertia: Array
    inertia_derivative: Array
    static: Array
    damping: Array
    coulomb: Array
    energy: Array

    __repr__ = short_repr

    def force(self, speed: ArrayLike) -> Array:
        """Return Q of all forces that depend on angle and speed only, (n,) in [N m]."""
        w = np.asarray(speed, dtype=np.float64)
        return self.static - self.damping * w - self.coulomb * np.sign(w)

    def torque(self, speed: ArrayLike, acceleration: ArrayLike = 0.0) -> Array:
        """Return the crank torque that a motion requires without loads, (n,) in [N m]."""
        w, e = np.asarray(speed, dtype=np.float64), np.asarray(acceleration, dtype=np.float64)
        return self.inertia * e + 0.5 * self.inertia_derivative * w**2 - self.force(w)


def reduced(model: DynamicModel, angles: ArrayLike) -> Reduced:
    """Return the coefficients of the reduced equation at crank angles (n,) in [rad].

    Accuracy: a few ulp times the condition number of the loop equations; no finite differences are used.
    """
    unit = model.unit_motion(angles)
    return coefficients(unit, applied(model, unit), model.forces.flywheel)


def coefficients(unit: UnitMotion, acting: Applied, flywheel: float) -> Reduced:
    """Return the coefficients of the reduced equation from a unit motion and a flywheel in [kg m2]."""
    inertia, derivative = generalised_inertia(unit)
    friction = np.zeros(len(unit))
    for dry in acting.dry:
        friction = friction + dry.magnitude * size_of(dry.rate)
    return Reduced(
        unit.angle,
        inertia + flywheel,
        derivative,
        power(unit, acting.gravity + acting.springs),
        -power(unit, acting.damping),
        friction,
        acting.energy,
    )


def generalised_inertia(unit: UnitMotion) -> tuple[Array, Array]:
    """Return J = sum m v.v + omega.I omega at unit crank speed, and J' = 2 sum m v.a + omega.I alpha.

    The rotation of the inertia matrices adds nothing to J': omega.(omega x I omega) = 0.

    Returns:
        (n,) in [kg m2] and (n,) in [kg m2/rad].
    """
    unity, none = np.ones(len(unit)), np.zeros(len(unit))
    momenta = unit.inertial(none, unity)  # J's wrenches are those of unit acceleration at rest
    derivative = 2.0 * power(unit, unit.inertial(unity, none))
    return power(unit, momenta), derivative


def load_leverage(model: DynamicModel, unit: UnitMotion) -> Array:
    """Return the derivatives by crank angle along which loads and couples act, (n, loads, 3).

    For a load this is the derivative of its point in [m/rad], for a couple the spin of its link.
    """
    rates = [unit.locate(load.location)[2] for load in model.forces.loads]
    rates += [unit.spin(couple.link) for couple in model.forces.couples]
    return np.stack(rates, 1) if rates else np.zeros((len(unit), 0, 3))


def kinetic_energy(unit: UnitMotion, speed: Array, flywheel: float = 0.0) -> Array:
    """Return sum m v2 / 2 + omega.I omega / 2 over the links, an alternative to J w2 / 2, (n,) in [J]."""
    w = speed[:, None, None] * unit.twist
    centre = w[..., :3] + np.cross(w[..., 3:], unit.centres)
    turning = (unit.moments @ w[..., 3:, None])[..., 0]
    energies = unit.masses * dot(centre, centre) + dot(w[..., 3:], turning)
    return 0.5 * energies.sum(-1) + 0.5 * flywheel * speed**2
