"""Contacts: Coulomb friction that sticks or slides, and impacts and contacts at joint limits.

Source: F. Pfeiffer and C. Glocker, Multibody Dynamics with Unilateral Contacts (1996), section 5.4 (Newton's
law of impact).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import Dynamics, EquationsOfMotion, Kinematics
from mechsim.analytic.dynamics.link_forces import constrained_acceleration
from mechsim.model.joint_kinds import KINDS
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import null_spaces

# largest number of changes of sticking, sliding and contact at one instant
MAX_CHANGES = 50
# rate of a coordinate with friction, relative to the fastest rate so far, below which it is at rest
REST = 1e-9
# approach rate to a stop, relative to the fastest rate, below which there is contact without an impact
SOFT_IMPACT = 1e-7
# acceleration of a sticking friction's rate, relative to the square of the fastest rate, that is no rounding
REVERSAL = 1e-6
# relative excess of a friction force over its limit that counts as rounding
BALANCED = 1e-9
# friction of a unit combination of redundant constraint forces, in [N] or [N m], that is rounding
NO_FRICTION = 1e-9

# n states and times (n,) in [s] -> numbers (n,) that are zero at the event
EventFunction = Callable[[Kinematics, Array], Array]


@dataclass(frozen=True, slots=True)
class Stop:
    """A joint coordinate's limit: its index in the tree, the limit in units, and +1 (upper) or -1 (lower)."""

    index: int
    limit: float
    side: float


@dataclass(frozen=True, slots=True)
class ContactMode:
    """The frictions that slide (with direction) or stick, and the stops in contact."""

    sliding: Array
    stuck: list[int] = field(default_factory=list[int])
    contacts: list[int] = field(default_factory=list[int])


@dataclass(frozen=True, slots=True)
class Contacts:
    """Frictions and stops of a mechanism.

    Attributes:
        equations: equations of motion.
        stops: limits of joints.
        restitution: coefficient of restitution, rate after an impact divided by that before it, 0 to 1.
    """

    equations: EquationsOfMotion
    stops: tuple[Stop, ...] = ()
    restitution: float = 0.0

    def indices(self, mode: ContactMode) -> list[int]:
        """Return the tree indices of the coordinates that stops constrain."""
        return [self.stops[i].index for i in mode.contacts]

    def accelerate(self, state: Kinematics, times: Array, mode: ContactMode) -> Dynamics:
        """Return the accelerations of n states at times (n,) in [s] in a contact mode."""
        return self.equations.accelerate(state, times, mode.sliding, mode.stuck, self.indices(mode))

    def end_functions(self, mode: ContactMode) -> list[EventFunction]:
        """Return functions that cross zero downwards where a contact mode ends."""

        def dynamics(state: Kinematics, times: Array) -> Dynamics:
            return self.accelerate(state, times, mode)

        functions: list[EventFunction] = []
        for i in np.flatnonzero(mode.sliding):
            functions.append(lambda state, _, i=i: self.equations.friction_rates(state)[i] * mode.sliding[i])
        if mode.stuck:
            # positive for a balance to rounding
            functions.append(
                lambda state, times: 1.0 + BALANCED - self._friction_load(dynamics(state, times), mode)
            )
        for i, stop in enumerate(self.stops):
            if i in mode.contacts:
                functions.append(lambda state, times, i=i: self._pressing(dynamics(state, times), mode, i))
            else:
                functions.append(lambda state, _, stop=stop: self._clearance(state, stop))
        return functions

    def _friction_load(self, dynamics: Dynamics, mode: ContactMode) -> Array:
        """Return the largest sticking friction relative to its limit at n states, (n,).

        If more frictions stick than the motion needs, their forces are not unique: those of the smallest
        largest load count, since the frictions hold if any distribution of the forces is admissible.
        """
        limits = np.array([self.equations.frictions[i].magnitude for i in mode.stuck])[:, None]
        holding = dynamics.holding[mode.stuck] / limits
        loads = np.abs(holding).max(0)
        if len(limits) > 1:
            last = dynamics.rows.shape[1] - len(mode.contacts)
            for k, rows in enumerate(dynamics.rows):
                unloaded = null_spaces(rows)[0][last - len(limits) : last]
                redundant = np.abs(unloaded).max(0, initial=0.0) > NO_FRICTION
                loads[k] = _least_largest(holding[:, k], unloaded[:, redundant] / limits)
        return loads

    def _pressing(self, dynamics: Dynamics, mode: ContactMode, index: int) -> Array:
        """Return the contact force of a stop; negative for a tensile force."""
        return -self.stops[index].side * dynamics.contact[mode.contacts.index(index)]

    def _clearance(self, state: Kinematics, stop: Stop) -> Array:
        value = state.q.values[stop.index] / self.equations.loops.units[stop.index]
        return stop.side * (stop.limit - value)

    def rates_after_impact(self, state: Kinematics, mode: ContactMode, fastest: float) -> Array:
        """Return the rates (count, 1) after impacts at all joint stops, by impulses on all coordinates.

        A joint that only touches its stop comes to rest there.

        Args:
            state: state before the impact.
            mode: contact mode before the impact; stops in contact have no impact.
            fastest: largest rate of the run so far.
        """
        slow = SOFT_IMPACT * fastest
        hit = [
            stop.index
            for i, stop in enumerate(self.stops)
            if i not in mode.contacts
            and abs(float(self._clearance(state, stop)[0])) < 1e-9
            and stop.side * state.rates[stop.index, 0] > -slow
        ]
        equations, before = self.equations, state.rates[self.equations.free].T
        if not hit:
            return state.rates
        mass = equations.mass(state)
        kept = np.concatenate([np.zeros_like(state.gamma), state.rates[equations.prescribed_indices].T], 1)
        none = np.zeros((len(equations.frictions), 1, len(equations.free)))
        rows, _ = equations.constraint_rows(state, kept, none, (), hit)
        rebound = -self.restitution * state.rates[hit]
        target = np.concatenate([kept, np.where(np.abs(rebound) > slow, rebound, 0.0).T], 1)
        after = np.zeros_like(state.rates)
        momentum = (mass @ before[..., None])[..., 0]
        after[equations.free] = constrained_acceleration(mass, momentum, rows, -target)[0].T
        return after

    def choose(self, state: Kinematics, time: float, fastest: float) -> ContactMode:
        """Return the contact mode with admissible friction and contact forces."""
        rates, fastest = self.equations.friction_rates(state)[:, 0], max(fastest, 1e-9)
        at_rest = np.abs(rates) <= REST * fastest
        contacts = [
            i
            for i, stop in enumerate(self.stops)
            if float(self._clearance(state, stop)[0]) <= 1e-9
            and abs(float(state.rates[stop.index, 0])) <= SOFT_IMPACT * fastest
        ]
        stuck = [int(i) for i in np.flatnonzero(at_rest)]
        mode = ContactMode(np.where(at_rest, 0.0, np.sign(rates)), stuck, contacts)
        together = None if contacts or not stuck else self._moving_together(state, time, mode, fastest)
        if together is not None:
            return together
        least_slip = REVERSAL * fastest**2
        sizes = [friction.magnitude for friction in self.equations.frictions]
        for _ in range(MAX_CHANGES):
            dynamics = self.accelerate(state, np.array([time]), mode)
            # at a dead centre the joint reverses whatever the friction
            reversing = max(mode.stuck, key=lambda i: abs(float(dynamics.slip[i, 0])), default=None)
            if reversing is not None and abs(slip := float(dynamics.slip[reversing, 0])) > least_slip:
                mode = self._sliding(mode, reversing, slip)
                continue
            loads = {i: abs(float(dynamics.holding[i, 0])) / sizes[i] for i in mode.stuck}
            slipping = max(loads, key=lambda i: loads[i], default=None)
            pulled = [i for i in mode.contacts if float(self._pressing(dynamics, mode, i)[0]) < 0.0]
            # smaller than the excess that ends sticking: the friction slides at that instant
            if slipping is not None and self._friction_load(dynamics, mode)[0] > 1.0 + 0.5 * BALANCED:
                mode = self._sliding(mode, slipping, -float(dynamics.holding[slipping, 0]))
            elif pulled:
                mode = replace(mode, contacts=[i for i in mode.contacts if i not in pulled])
            else:
                break
        return mode

    def _moving_together(
        self, state: Kinematics, time: float, mode: ContactMode, fastest: float
    ) -> ContactMode | None:
        """Return the mode in which all frictions at rest slide, or all stick; None if neither is certain.

        Just after the instant they slide as the forces without them tend to move the joints. If they then
        reverse this motion, they hold it, provided that there is only one: of several motions, some may
        continue. `mode` has them sticking.
        """
        equations, times = self.equations, np.array([time])
        tendency = self.accelerate(state, times, replace(mode, stuck=[])).acceleration
        largest = float(np.abs(tendency).max())
        if not largest > 0.0:
            return mode
        seconds = 0.1 * REST * fastest / largest
        q = equations.loops.displaced(state.q, seconds * state.rates)
        after = equations.kinematics(q, state.rates + seconds * tendency)
        rates = equations.friction_rates(after)[:, 0]
        resting = np.isin(np.arange(len(rates)), mode.stuck)
        moving = resting & (np.abs(rates) > REST * np.abs(rates[resting]).max())
        sliding = replace(mode, sliding=np.where(moving, np.sign(rates), mode.sliding), stuck=[])
        acceleration = self.accelerate(after, times, sliding).acceleration
        growth = np.sign(rates) * equations.friction_accelerations(after, acceleration)[:, 0]
        # a friction that balances the forces to rounding holds
        growth -= 0.5 * BALANCED * np.abs(equations.friction_accelerations(after, tendency)[:, 0])
        if (growth[moving] <= 0.0).all():
            return mode if len(equations.free) - equations.rank == 1 else None
        return sliding if (growth[moving] > 0.0).all() else None

    def _sliding(self, mode: ContactMode, index: int, direction: float) -> ContactMode:
        """Return a mode in which a sticking friction slides in a direction; that of a ball is positive."""
        sliding, ball = mode.sliding.copy(), KINDS[self.equations.frictions[index].joint.kind].ball
        sliding[index] = 1.0 if ball else np.sign(direction)
        return replace(mode, sliding=sliding, stuck=[i for i in mode.stuck if i != index])


def _least_largest(values: Array, directions: Array) -> float:
    """Return the least largest magnitude of values (m,) plus a combination of the columns (m, k)."""
    if not directions.size:
        return float(np.abs(values).max())
    from scipy.optimize import linprog

    bounded = -np.ones((len(values), 1))
    result = linprog(
        np.append(np.zeros(directions.shape[1]), 1.0),
        A_ub=np.block([[directions, bounded], [-directions, bounded]]),
        b_ub=np.concatenate([-values, values]),
        bounds=(None, None),
    )
    return float(result.fun)


def stops_of(equations: EquationsOfMotion, ranges: Mapping[str, tuple[float, float]]) -> tuple[Stop, ...]:
    """Return the stops of joints with a range in [m] or [rad], if the tree has their coordinate."""
    stops: list[Stop] = []
    for name, limits in ranges.items():
        index = equations.loops.tree.index_of.get(name)
        if index is None:
            continue
        for limit, side in zip(limits, (-1.0, 1.0), strict=True):
            if abs(limit) < np.inf:
                stops.append(Stop(index, limit / equations.loops.units[index], side))
    return tuple(stops)
