"""The coefficients of the reduced equation as functions of the crank angle, to rounding and fast.

Each arc of the crank is represented by its exact values at Chebyshev points, solved in one vectorised
call when the crank first comes there; between them by barycentric interpolation, on arcs so short
that the last coefficients are rounding.
"""

from dataclasses import dataclass, field

import numpy as np

from mechsim.analytic.dynamics.applied import applied
from mechsim.analytic.dynamics.machines import Machine
from mechsim.analytic.dynamics.reduced_equation import coefficients, load_leverage
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import AssemblyError
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array

# points on an arc, the longest arc, and the shortest before the crank is said to be at a dead centre
POINTS = 20
PLACES = 24
ARC = TURN / PLACES
SHORTEST = 1e-5
# times arcs are halved when a whole turn is charted at once
HALVINGS = 5
# the last coefficients may be this part of the largest values: rounding of a closed form, and of poses
# assembled by Newton's method; near a dead centre rounding grows as the inverse square of the conditioning,
# and an arc this many times shorter than the longest is taken with less, one that can hardly be halved again
# with least: a crank passes dead centres that lie a part of 1e-9 of the size beside its path
RESOLVED, ASSEMBLED, NOISY, SHORTER = 3e-14, 1e-12, 1e-11, 16.0
ROUGH, HARDLY = 1e-8, 16.0

_K = np.arange(POINTS)
NODES = -np.cos(np.pi * _K / (POINTS - 1))
WEIGHTS = np.where((_K == 0) | (_K == POINTS - 1), 0.5, 1.0) * (-1.0) ** _K
# values at the nodes -> Chebyshev coefficients
_TRANSFORM = np.linalg.inv(np.polynomial.chebyshev.chebvander(NODES, POINTS - 1))


@dataclass(frozen=True, slots=True)
class Arc:
    """One arc from `low` to `high` in [rad] and the values at its nodes, (POINTS, columns)."""

    low: float
    high: float
    values: Array

    def at(self, angle: float) -> Array:
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
    """Columns inertia, slope, static, energy, damping, joint rates with dry friction, load leverage.

    Attributes:
        machine: whose.
        arcs: those charted so far, by place.
        periodic: whether an arc was found to be the same one turn on; then one turn is enough.
        ahead: whether the arcs of a turn were tried to be charted all at once.
        coarse: ends of arcs that must be shorter.
    """

    machine: Machine
    arcs: dict[int, list[Arc]] = field(default_factory=dict)
    periodic: bool = False
    ahead: bool = False
    coarse: set[tuple[float, float]] = field(default_factory=set)

    def at(self, angle: float) -> Array:
        """Return all columns at a crank angle in [rad].

        Raises:
            AssemblyError: where the loops do not close, or the crank cannot pass.
        """
        if self.periodic:
            angle = angle % TURN
        place = int(np.floor(angle / ARC))
        if isinstance(self.machine.drive, LoopForm) and not self.ahead:
            self.ahead = True
            self._look_ahead(place)
            return self.at(angle)
        for arc in self.arcs.setdefault(place, []):
            if arc.low <= angle <= arc.high:
                return arc.at(angle)
        low, high = place * ARC, (place + 1) * ARC
        while True:
            arc = None if (low, high) in self.coarse else self._charted(low, high)
            if arc is not None:
                self.arcs[place].append(arc)
                self._compare(place)
                return arc.at(angle)
            self.coarse.add((low, high))
            middle = 0.5 * (low + high)
            low, high = (low, middle) if angle <= middle else (middle, high)
            if high - low < SHORTEST:
                raise AssemblyError(
                    f"{self.machine.mechanism.name}: the reduced equation has no smooth coefficients at "
                    f"crank angle {angle:.6g} rad: a dead centre, or as near to one as rounding tells, or a "
                    "spring whose joint passes half a turn"
                )

    def _compare(self, place: int) -> None:
        """See whether a new arc repeats the one a turn away; then keep all in the first turn."""
        new = self.arcs[place][-1]
        for other in (place - PLACES, place + PLACES):
            for old in self.arcs.get(other, ()):
                apart = (other - place) * ARC
                if abs(old.low - new.low - apart) + abs(old.high - new.high - apart) > 1e-9:
                    continue
                if _alike(old, new):
                    self.periodic, self.arcs = True, {}
                    return

    def _look_ahead(self, place: int) -> None:
        """Chart the turn around a place, all arcs in few calls: loop equations cost by the call.

        Arcs that need be shorter than a few halvings make them are left until the crank comes there, and
        so is everything where the crank cannot make the turn.
        """
        ends = [(k * ARC, (k + 1) * ARC) for k in range(place - PLACES // 2, place + PLACES // 2)]
        for _ in range(HALVINGS):
            try:
                values = columns(self.machine, np.concatenate([_nodes(*end) for end in ends]))
            except AssemblyError:
                return
            shorter = []
            for end, part in zip(ends, np.split(values, len(ends)), strict=True):
                arc = self._resolved(*end, part)
                if arc is not None:
                    self.arcs.setdefault(int(np.floor(sum(end) / 2.0 / ARC)), []).append(arc)
                else:
                    middle = 0.5 * sum(end)
                    shorter += [(end[0], middle), (middle, end[1])]
            ends = shorter
            if not shorter:
                break
        self._wrap(place - PLACES // 2)

    def _wrap(self, first: int) -> None:
        """Keep the arcs of a turn, which begins at a place, for all turns if its first repeats after it."""
        for old in self.arcs.get(first, ()):
            new = self._charted(old.low + TURN, old.high + TURN)
            if new is None or not _alike(old, new):
                return
        arcs = [arc for some in self.arcs.values() for arc in some]
        self.periodic, self.arcs = True, {}
        for arc in arcs:
            turns = TURN * np.floor(0.5 * (arc.low + arc.high) / TURN)
            moved = Arc(arc.low - turns, arc.high - turns, arc.values)
            self.arcs.setdefault(int(np.floor(0.5 * (moved.low + moved.high) / ARC)), []).append(moved)

    def _charted(self, low: float, high: float) -> Arc | None:
        """Return an arc if its points resolve every column; None if it must be shorter."""
        try:
            return self._resolved(low, high, columns(self.machine, _nodes(low, high)))
        except AssemblyError:
            return None

    def _resolved(self, low: float, high: float, values: Array) -> Arc | None:
        """Return an arc with values at its points if they resolve every column."""
        tail = np.abs(_TRANSFORM[-3:] @ values).max(0)
        largest = np.abs(values).max(0)
        # what a slope is off by counts by what it adds up to over the arc, beside the inertia
        largest[1] = max(largest[1], largest[0] / (high - low))
        largest[2:4] = largest[2:4].max()
        largest[2:] = np.maximum(largest[2:], _floors(self.machine, len(largest) - 2))
        exact = ASSEMBLED if isinstance(self.machine.drive, LoopForm) else RESOLVED
        least = exact if high - low > ARC / SHORTER else NOISY if high - low > HARDLY * SHORTEST else ROUGH
        return Arc(low, high, values) if (tail <= least * largest).all() else None


def _floors(machine: Machine, count: int) -> Array:
    """Return below what the columns from the static torque on are rounding of nought, (count,).

    As of a planar linkage's way out of its plane, or of a joint that never turns.
    """
    size, forces = machine.mechanism.size, machine.forces
    lever = min(1.0, size)
    masses = sum(link.inertia.mass for link in machine.mechanism.links if link.inertia is not None)
    weight = masses * size * float(np.linalg.norm(forces.gravity))
    damping = lever**2 * sum(one.viscous + one.viscous_turn for one in forces.friction)
    damping += size**2 * sum(spring.damping for spring in forces.springs)
    loads, couples = [size] * 3 * len(forces.loads), [1.0] * 3 * len(forces.couples)
    dry = [lever] * (count - 3 - len(loads) - len(couples))
    return np.array([weight, weight, damping, *dry, *loads, *couples])


def _alike(one: Arc, other: Arc) -> bool:
    """Say whether two arcs a turn apart are the same."""
    return bool((np.abs(one.values - other.values) <= 1e-9 * np.abs(one.values).max(0)).all())


def _nodes(low: float, high: float) -> Array:
    """Return the points of an arc, (POINTS,)."""
    return 0.5 * (low + high) + 0.5 * (high - low) * NODES


def columns(machine: Machine, angles: Array) -> Array:
    """Return all columns at crank angles, (n, columns)."""
    unit = machine.unit_motion(angles)
    acting = applied(machine, unit)
    part = coefficients(unit, acting, machine.forces.flywheel)
    rates = [one.rate for one in acting.dry]
    leverage = load_leverage(machine, unit).reshape(len(unit), -1)
    fixed = (part.inertia, part.slope, part.static, part.energy, part.damping)
    return np.column_stack([*fixed, *rates, leverage])
