"""Contacts: Coulomb friction that sticks or slides, impacts and contacts at joint limits, soft stops.

The gaps g of the stops that are closed satisfy one complementarity problem, with their Jacobian W and the
inverse mass matrix P on the loops. Impacts: v+ = v- + P W' L, 0 <= L, W v+ + e W v- >= 0, L' (W v+ + e W v-)
= 0. Contacts at rest: the same with forces, and accelerations of the gaps instead of W v+ + e W v-. The
energy of an impact changes by -(1 - e) / (1 + e) L' W P W' L / 2: one coefficient e for all stops never adds
energy. Friction is finite and has no impulse.

Source: C. Glocker, Set-Valued Force Laws (2001); F. Pfeiffer and C. Glocker, Multibody Dynamics with
Unilateral Contacts (1996), section 5.4 (Newton's law of impact).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mechsim.errors import FrictionError, MechsimError
from mechsim.kinetics.equations_of_motion import Dynamics, EquationsOfMotion, Kinematics
from mechsim.kinetics.gaps import gap_limits, gaps_of
from mechsim.kinetics.link_forces import constrained_acceleration, responses
from mechsim.mechanism.joint_friction import Friction
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.nonlinear_springs import Phases, SpringLaw, phases_of
from mechsim.numerics.arrays import Array
from mechsim.numerics.complementarity import complementary, least_in_box
from mechsim.numerics.newton import root
from mechsim.numerics.rank import null_space, pseudo_inverse

# share of a friction's direction that prescribed motion leaves open, which is rounding
DETERMINED = 1e-9
# largest number of changes of sticking, sliding and contact at one instant
MAX_CHANGES = 50
# rate of a coordinate with friction, relative to the fastest rate so far, below which it is at rest
REST = 1e-9
# multiple of it at which a friction at rest has departed
DEPARTED = 10.0
# approach rate to a stop, relative to the fastest rate, below which there is contact without an impact: the
# impacts that would follow have 1e-14 of the energy
SOFT_IMPACT = 1e-7
# rate of a closed gap, relative to the fastest rate, that is rounding
NO_APPROACH = 1e-12
# gap, in [rad] or characteristic lengths, that is closed, and the negative one that rounding of closed loops
# leaves
CLOSED_GAP = 1e-9
# gap in the same units that a stop must exceed to count as open: the rounding of a step is 1e-15
OPEN_GAP = 1e-13
# height of a rebound relative to this gap, below which there is none
REBOUND = 4.0
# largest number of successive impacts at one instant; the last has no restitution
MAX_IMPACTS = 100
# acceleration of a coordinate by a unit force, relative to that of the total mass, below which it cannot
# move: the square of its share in the motion
IMMOBILE = 1e-9
# acceleration of a sticking friction's rate, relative to the square of the fastest rate, that is no rounding
REVERSAL = 1e-6
# acceleration that a friction at rest permits, relative to that by its limit, that is rounding
STARTED = 1e-9
# relative excess of a friction force over its limit that counts as rounding
BALANCED = 1e-9
# displacement in [rad] or characteristic lengths after which a joint at a dead centre moves visibly
AHEAD = 1e-4
# rate in [rad/s] or characteristic lengths per second that is rounding of zero at the start of a motion
NO_RATE = 1e-30
# smallest limit of a friction by the load, in [N] or [N m]: that of a joint without a load is zero
NO_LIMIT = 1e-200
# limit of a friction, and force on it, relative to the largest one that are rounding
NO_LOAD = 1e-12
# friction of a unit combination of redundant constraint forces, in [N] or [N m], that is rounding
NO_FRICTION = 1e-9

# n states and times (n,) in [s] -> numbers (n,), or rows (k, n), that are zero at the event
EventFunction = Callable[[Kinematics, Array], Array]


@dataclass(frozen=True, slots=True)
class Stop:
    """A joint coordinate's limit: its index in the tree, the limit in units, and +1 (upper) or -1 (lower).

    `restitution` is its coefficient of restitution; None for that of the run.
    """

    index: int
    limit: float
    side: float
    restitution: float | None = None


class JammedError(MechsimError):
    """A joint that prescribed motion drives beyond its stop, or impacts that add energy."""


@dataclass(frozen=True, slots=True)
class ContactMode:
    """The frictions that slide (with direction) or stick, and the stops in contact.

    Attributes:
        sliding: direction of each friction's rate, (frictions,) of -1, 0, 1; 0 also at a rate that prescribed
            motion keeps at zero, where the friction is taken as zero.
        stuck: indices of the sticking frictions.
        contacts: indices of the stops in contact.
        adhesion: tensile force of each contact that is rounding, in [N m] or [N] times the coordinate's unit.
        phases: phase of each nonlinear spring.
        slowest: rate of a friction, against its direction or without one, that is no rounding.
    """

    sliding: Array
    stuck: list[int] = field(default_factory=list[int])
    contacts: list[int] = field(default_factory=list[int])
    adhesion: Array = field(default_factory=lambda: np.zeros(0))
    phases: Phases = ()
    slowest: float = 0.0

    def locked(self, equations: EquationsOfMotion, contacts: Sequence[int]) -> list[int] | None:
        """Return the coordinates that stops, at indices `contacts`, and sticking frictions hold.

        It is None if a friction acts on a motion that is not a coordinate of the tree.
        """
        locked, index_of = [*contacts], equations.loops.tree.index_of
        for i in self.stuck:
            joint, k = equations.frictions[i].joint, equations.frictions[i].coordinate
            if not (k < len(joint.coordinates) and joint.coordinates[k] in index_of):
                return None
            locked.append(index_of[joint.coordinates[k]])
        return locked


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
        return self.equations.accelerate(
            state, times, mode.sliding, mode.stuck, self.indices(mode), mode.phases
        )

    def end_functions(self, mode: ContactMode) -> list[EventFunction]:
        """Return functions of which a row crosses zero downwards where a contact mode ends."""
        functions: list[EventFunction] = []
        moving = np.flatnonzero(mode.sliding)
        if len(moving):
            functions.append(
                lambda state, _: (
                    self.equations.friction_rates(state)[moving] * mode.sliding[moving, None] - NO_RATE
                )
            )
        if len(mode.sliding) > len(mode.stuck):
            # prescribed motion may take a friction at rest in either direction
            functions.append(lambda state, _: self._as_chosen(state, mode))
        if mode.stuck:
            # positive for a balance to rounding
            functions.append(lambda state, times: 1.0 + BALANCED - self._friction_load(state, times, mode))
        if mode.contacts:
            functions.append(lambda state, times: self._pressing(state, times, mode) + mode.adhesion[:, None])
        for k, phase in enumerate(mode.phases):
            functions.append(lambda state, _, k=k, phase=phase: self._phase_left(state, k, phase) + OPEN_GAP)
        return functions

    def _as_chosen(self, state: Kinematics, mode: ContactMode) -> Array:
        """Return by how much the rates of the frictions that do not stick agree with their directions."""
        loose = np.setdiff1d(np.arange(len(mode.sliding)), mode.stuck)
        rates, directions = self.equations.friction_rates(state)[loose], mode.sliding[loose, None]
        return np.where(directions == 0.0, -np.abs(rates), rates * directions) + mode.slowest

    def _friction_load(self, state: Kinematics, times: Array, mode: ContactMode) -> Array:
        """Return the largest sticking friction relative to its limit at n states, (n,).

        If more frictions stick than the motion needs, their forces are not unique: those of the smallest
        largest load count, since the frictions hold if any distribution of the forces is admissible. Loads
        that depend on the distribution count as in impending motion.
        """
        equations = self.equations
        varies = any(equations.frictions[i].friction.varies for i in mode.stuck)
        if varies and len(mode.stuck) > 1 and not mode.contacts and len(equations.free) - equations.rank == 1:
            return self._impending_load(state, times, mode)
        dynamics = self.accelerate(state, times, mode)
        limits = np.maximum(dynamics.limits[mode.stuck], NO_LIMIT)
        holding = dynamics.holding[mode.stuck] / limits
        loads = np.abs(holding).max(0)
        last = dynamics.rows.shape[1] - len(mode.contacts)
        # forces that are admissible hold, and need no other distribution
        for k in np.flatnonzero((loads > 1.0) & (len(limits) > 1)):
            unloaded = null_space(dynamics.rows[k].T).T[last - len(limits) : last]
            combinations, sizes, _ = np.linalg.svd(unloaded, full_matrices=False)
            redundant = combinations[:, sizes > NO_FRICTION]
            loads[k] = least_load(dynamics.holding[mode.stuck, k], redundant, limits[:, k])
        return loads

    def _impending_load(self, state: Kinematics, times: Array, mode: ContactMode) -> Array:
        """Return what moves the only degree of freedom relative to the friction at rest against it, (n,)."""
        sticking = [self.equations.frictions[i].friction for i in mode.stuck]
        (along,) = null_space(state.jacobian[0])
        rates = self.equations.friction_directions(state)[:, 0] @ along
        signs = np.where(np.abs(rates) > REST * np.abs(rates).max(), np.sign(rates), 0.0)

        def moving(contacts: Contacts, sliding: Array) -> Array:
            released = contacts.accelerate(state, times, replace(mode, sliding=sliding, stuck=[]))
            return np.einsum("i,nij,jn->n", along, state.mass, released.acceleration[self.equations.free])

        driving, loads = moving(self, 0.0 * signs), np.zeros(len(times))
        for side in (1.0, -1.0):
            try:
                friction = side * (driving - moving(self._at_rest(sticking), side * signs))
            except FrictionError as error:
                if error.outcome != "jammed":
                    raise
                continue
            loads = np.maximum(loads, side * driving / np.maximum(friction, NO_LIMIT))
        return loads

    def _phase_left(self, state: Kinematics, k: int, phase: float) -> Array:
        """Return what is left of the phase of a nonlinear spring, in units, (n,)."""
        spring, mechanism = self.equations.model.forces.nonlinear_springs[k], self.equations.model.mechanism
        turning = isinstance(spring.ends, str) and mechanism.unit(spring.ends) == "rad"
        lengths, rates = self.equations.spring_lengths(state)
        remaining = spring.law.remaining(phase, lengths[k], rates[k])
        return remaining / (1.0 if turning else mechanism.characteristic_length)

    def beyond_tables(self, state: Kinematics) -> str:
        """Return which spring of one state is beyond its table, in words; empty for none."""
        springs = self.equations.model.forces.nonlinear_springs
        if not any(isinstance(spring.law, SpringLaw) and spring.law.table for spring in springs):
            return ""
        rows = zip(springs, *self.equations.spring_lengths(state), strict=True)
        return next((text for spring, length, rate in rows if (text := spring.law.beyond(length, rate))), "")

    def phases(self, state: Kinematics, before: Phases = ()) -> Phases:
        """Return the phases of the nonlinear springs in one state, after other phases."""
        springs = self.equations.model.forces.nonlinear_springs
        lengths, rates = (values[:, 0] for values in self.equations.spring_lengths(state))
        return phases_of(springs, lengths, rates, before)

    def _pressing(self, state: Kinematics, times: Array, mode: ContactMode) -> Array:
        """Return the forces of the stops in contact, (contacts, n); negative for a tensile force."""
        return -self._sides(mode.contacts)[:, None] * self.accelerate(state, times, mode).contact

    def _sides(self, stops: Sequence[int]) -> Array:
        return np.array([self.stops[i].side for i in stops])

    def _rows(self, stops: Sequence[int]) -> Array:
        """Return the rows (k, free) of the coordinates of stops."""
        indices = [self.stops[i].index for i in stops]
        return np.eye(self.equations.loops.tree.count)[indices][:, self.equations.free]

    def gaps(self, values: Array) -> Array:
        """Return the gaps of the stops, (stops, n), at coordinates in units, (count, n)."""
        return np.array([stop.side * (stop.limit - values[stop.index]) for stop in self.stops])

    def gap_rates(self, rates: Array) -> Array:
        """Return the rates of the gaps, (stops, n), at rates of the coordinates in units, (count, n)."""
        return np.array([-stop.side * rates[stop.index] for stop in self.stops])

    def _closed(self, state: Kinematics) -> list[int]:
        """Return the stops with a closed gap in one state."""
        gaps = self.gaps(state.q.values / self.equations.loops.units[:, None])
        return [int(i) for i in np.flatnonzero(gaps[:, 0] <= CLOSED_GAP)] if len(gaps) else []

    def rates_after_impact(
        self, state: Kinematics, time: float, mode: ContactMode, fastest: float
    ) -> tuple[Array, float]:
        """Return the rates (count, 1) after impacts at all closed gaps, and the work of the drives in them.

        Impacts follow one another until no closed gap approaches. A gap that opens takes no part in an
        impact. A joint that only touches its stop comes to rest there.

        Args:
            state: state before the impact.
            time: in [s].
            mode: contact mode before the impact.
            fastest: largest rate of the run so far.

        Raises:
            JammedError: if prescribed motion closes a gap further.
        """
        closed, rates, still, work = self._closed(state), state.rates, NO_APPROACH * fastest, 0.0
        if not (self.gap_rates(rates)[closed] < -still).any():
            return rates, work
        own = [self.stops[i].restitution for i in closed]
        restitutions = np.array([self.restitution if value is None else value for value in own])
        unheld = replace(mode, stuck=[], contacts=[])
        falling = np.abs(self.accelerate(state, np.array([time]), unheld).acceleration).max()
        slowest = max(SOFT_IMPACT * fastest, float(np.sqrt(2.0 * falling * REBOUND * OPEN_GAP)))
        for number in range(MAX_IMPACTS):
            before = self.gap_rates(rates)[closed, 0]
            if not (before < -still).any():
                break
            rebound = np.maximum(-restitutions * before, 0.0)
            rebound[rebound <= slowest] = 0.0
            last = number == MAX_IMPACTS - 1
            taking_part = np.flatnonzero((before <= still) | last)
            stops, target = [closed[i] for i in taking_part], rebound[taking_part] * (not last)
            opening = before[taking_part] - target
            pressed = self._pressed(state.mass, state.jacobian, stops, opening, still)
            struck = -self._sides(pressed) * target[np.isin(stops, pressed)]
            rates, more = self._after_impulses(state, rates, self._rows(pressed), struck)
            work += more
        return rates, work

    def _after_impulses(
        self, state: Kinematics, rates: Array, rows: Array, target: Array
    ) -> tuple[Array, float]:
        """Return the rates (count, 1) after impulses along rows (k, free) that give these the rates (k,).

        They change no rate that the loops and prescribed motion determine. The second value is the work of
        the impulses that keep prescribed rates.
        """
        free, after, rows = rates[self.equations.free].T[..., None], np.zeros_like(rates), rows[None]
        kept = np.concatenate([(state.jacobian @ free)[..., 0], target[None]], 1)
        rows, momentum = np.concatenate([state.jacobian, rows], 1), (state.mass @ free)[..., 0]
        new, impulses = constrained_acceleration(state.mass, momentum, rows, -kept)
        after[self.equations.free], count = new.T, state.jacobian.shape[1]
        return after, float((impulses * kept)[0, :count].sum())

    def _pressed(
        self, mass: Array, rows: Array, stops: Sequence[int], opening: Array, tolerance: float
    ) -> list[int]:
        """Return the stops that must press so that no gap closes further.

        Args:
            mass: mass matrix, (1, free, free).
            rows: constraint Jacobian without contacts, (1, rows, free).
            stops: stops with a closed gap.
            opening: rate or acceleration of each gap without the stops, less the smallest one admitted.
            tolerance: rounding of it. A gap that opens less remains in contact.

        Raises:
            JammedError: if no forces of the stops prevent it.
        """
        sides, units = self._sides(stops), self._rows(stops)
        moved = responses(mass, units[:, None], rows)[0][:, 0]
        effects, least = units @ moved.T, 1.0 / float(np.trace(mass[0]))
        mobile = np.diag(effects) > IMMOBILE * least
        sizes = np.sqrt(np.where(mobile, np.diag(effects), least))
        matrix = effects * np.outer(mobile * sides / sizes, mobile * sides / sizes)
        for slack in (np.where(mobile, -tolerance, tolerance), tolerance):
            forces = complementary(matrix, (opening + slack) / sizes)
            if forces is not None:
                return [i for i, force in zip(stops, forces, strict=True) if force > 0.0]
        names = {index: name for name, index in self.equations.loops.tree.index_of.items()}
        raise JammedError(
            f"{self.equations.model.mechanism.name}: prescribed motion drives "
            f"{', '.join(names[self.stops[i].index] for i in stops)} beyond a stop"
        )

    def rates_at_rest(self, state: Kinematics, fastest: float) -> Array:
        """Return the rates (count, 1) of which those at rest are zero, with all that they determine.

        At a dead centre they determine much faster ones, which stay as they are.
        """
        mode = self._by_rates(state, fastest)
        if not mode.stuck:
            return state.rates
        rows = self.equations.friction_directions(state)[mode.stuck, 0]
        rates, _ = self._after_impulses(state, state.rates, rows, np.zeros(len(rows)))
        return rates if np.abs(rates - state.rates).max() <= SOFT_IMPACT * fastest else state.rates

    def _by_rates(self, state: Kinematics, fastest: float) -> ContactMode:
        """Return the mode in which all frictions stick whose rates are at rest, without contacts."""
        rates = self.equations.friction_rates(state)[:, 0]
        at_rest = np.abs(rates) <= REST * max(fastest, 1e-9)
        slowest = DEPARTED * REST * max(fastest, 1e-9)
        sliding, stuck = np.where(at_rest, 0.0, np.sign(rates)), np.flatnonzero(at_rest).tolist()
        return ContactMode(sliding, stuck, slowest=slowest)

    def choose(self, state: Kinematics, time: float, fastest: float, before: Phases = ()) -> ContactMode:
        """Return the contact mode with admissible friction and contact forces, after phases of springs.

        Raises:
            JammedError: if prescribed motion drives a joint beyond its stop.
        """
        fastest = max(fastest, 1e-9)
        slow = np.abs(self.gap_rates(state.rates)) <= SOFT_IMPACT * fastest
        resting = [i for i in self._closed(state) if slow[i, 0]]
        mode = replace(self._by_rates(state, fastest), phases=self.phases(state, before))
        mode = self._without_determined(state, time, mode, fastest)
        stuck = mode.stuck
        if not self.equations.frictions:
            return self._touching(state, time, mode, resting)
        sticking = [self.equations.frictions[i].friction for i in stuck]
        if any(friction.varies for friction in sticking):
            together = (
                None if resting else self._at_rest(sticking)._moving_together(state, time, mode, fastest)
            )
            if together is not None and together.stuck in ([], stuck):
                return together
            mode = together or mode
        elif stuck:
            mode = self._started(state, time, mode)
        free = self.accelerate(state, np.array([time]), replace(mode, stuck=[])).acceleration
        least_slip = max(REVERSAL * fastest**2, STARTED * float(np.abs(free).max(initial=0.0)))
        starting = [*stuck]
        for _ in range(MAX_CHANGES):
            mode = self._touching(state, time, mode, resting)
            dynamics = self.accelerate(state, np.array([time]), mode)
            # at a dead centre the joint reverses whatever the friction
            reversing = max(mode.stuck, key=lambda i: abs(float(dynamics.slip[i, 0])), default=None)
            if reversing is not None and abs(slip := float(dynamics.slip[reversing, 0])) > least_slip:
                mode = self._sliding(mode, reversing, slip)
                continue
            limits = np.maximum(dynamics.limits[:, 0], NO_LIMIT)
            loads = {i: abs(float(dynamics.holding[i, 0])) / limits[i] for i in mode.stuck}
            slipping = max(loads, key=lambda i: loads[i], default=None)
            # smaller than the excess that ends sticking: the friction slides at that instant
            load = 0.0 if slipping is None else self._friction_load(state, np.array([time]), mode)[0]
            if slipping is not None and load > 1.0 + 0.5 * BALANCED:
                mode = self._sliding(mode, slipping, -float(dynamics.holding[slipping, 0]))
                continue
            against = self._started_against(state, dynamics, mode, starting, least_slip)
            if against is None:
                break
            # it sticks once more, and slides the other way if it cannot
            starting.remove(against)
            sliding = np.where(np.arange(len(mode.sliding)) == against, 0.0, mode.sliding)
            mode = replace(mode, sliding=sliding, stuck=sorted([*mode.stuck, against]))
        return mode

    def _started_against(
        self, state: Kinematics, dynamics: Dynamics, mode: ContactMode, starting: list[int], least: float
    ) -> int | None:
        """Return which of the frictions that start from rest accelerates most against its direction.

        Contacts, which `_started` does not know, may turn it. None for accelerations up to `least`.
        """
        changes = self.equations.friction_accelerations(state, dynamics.acceleration)[:, 0]
        balls = [KINDS[self.equations.frictions[i].joint.kind].ball for i in starting]
        along = {i: mode.sliding[i] * changes[i] for i, ball in zip(starting, balls, strict=True) if not ball}
        most = min(along, key=lambda i: along[i], default=None)
        return most if most is not None and along[most] < -least else None

    def _without_determined(
        self, state: Kinematics, time: float, mode: ContactMode, fastest: float
    ) -> ContactMode:
        """Return a mode without those sticking frictions whose rates prescribed motion determines.

        They slide as it accelerates them. Without acceleration they have no direction until they move.
        """
        if not (self.equations.prescribed and mode.stuck):
            return mode
        rows = self.equations.friction_directions(state)[mode.stuck, 0]
        remaining = np.abs(rows @ null_space(state.jacobian[0]).T).max(1, initial=0.0)
        determined = np.array(mode.stuck)[remaining <= DETERMINED * np.abs(rows).max(1, initial=0.0)]
        if not len(determined):
            return mode
        loose = replace(mode, sliding=np.zeros_like(mode.sliding), stuck=[])
        acceleration = self.accelerate(state, np.array([time]), loose).acceleration
        changes = self.equations.friction_accelerations(state, acceleration)[determined, 0]
        moving = np.abs(changes) > REVERSAL * fastest**2
        sliding = mode.sliding.copy()
        sliding[determined] = np.where(moving, np.sign(changes), 0.0)
        return replace(mode, sliding=sliding, stuck=[i for i in mode.stuck if i not in determined])

    def _pushed(self, state: Kinematics, mode: ContactMode, resting: Sequence[int]) -> ContactMode | None:
        """Return a mode in which the sticking friction slides that stops with a closed gap push most.

        None if they push no sticking friction.
        """
        if not mode.stuck:
            return None
        outwards = -self._sides(resting)[:, None] * self._rows(resting)
        moved = responses(state.mass, outwards[:, None], state.jacobian)[0][:, 0]
        rates = self.equations.friction_directions(state)[mode.stuck, 0] @ moved.T
        most = np.unravel_index(np.abs(rates).argmax(), rates.shape)
        least = IMMOBILE / float(np.trace(state.mass[0]))
        return self._sliding(mode, mode.stuck[most[0]], rates[most]) if abs(rates[most]) > least else None

    def _touching(self, state: Kinematics, time: float, mode: ContactMode, resting: list[int]) -> ContactMode:
        """Return a mode with those stops in contact that must press, of those with a closed gap at rest.

        A sticking friction that they push slides.
        """
        mode = replace(mode, contacts=[], adhesion=np.zeros(0))
        if not resting:
            return mode
        times, mass = np.array([time]), state.mass
        apart = self.accelerate(state, times, mode)
        # friction that holds a mechanism balances its forces to rounding
        friction = np.abs(apart.holding).max(initial=0.0) / float(np.trace(mass[0]))
        rounding = BALANCED * float(np.abs(apart.acceleration).max(initial=friction))
        opening = self.gap_rates(apart.acceleration)[resting, 0]
        try:
            contacts = self._pressed(mass, apart.rows, resting, opening, 0.5 * rounding)
        except JammedError:
            pushed = self._pushed(state, mode, resting)
            if pushed is None:
                raise
            return self._touching(state, time, pushed, resting)
        touching = replace(mode, contacts=contacts)
        forces = self._pressing(state, times, touching)[:, 0]
        adhesion = rounding * float(np.trace(mass[0])) + 2.0 * np.maximum(-forces, 0.0)
        return replace(touching, adhesion=adhesion)

    def _started(self, state: Kinematics, time: float, mode: ContactMode) -> ContactMode:
        """Return a mode in which those frictions at rest slide whose rates change, without contacts.

        Their forces f minimise f' A f / 2 + f' s within their limits, with the accelerations s of the rates
        without them and their change A by unit forces. `mode` has them sticking. Source: Glocker, section
        5.3 (the principle of least constraint with friction of given limits).
        """
        equations, times, stuck = self.equations, np.array([time]), mode.stuck
        free = self.accelerate(state, times, replace(mode, stuck=[]))
        limits = free.limits[stuck, 0]
        unit = equations.friction_directions(state)[stuck, 0] * limits[:, None]
        moved = responses(state.mass, unit[:, None], free.rows)[0][:, 0]
        changes = limits * equations.friction_accelerations(state, free.acceleration)[stuck, 0]
        effects = unit @ moved.T
        changes = changes + effects @ least_in_box(effects, changes)
        moving = np.abs(changes) > STARTED * np.abs(effects).max()
        for i, change in zip(np.array(stuck)[moving].tolist(), changes[moving].tolist(), strict=True):
            mode = self._sliding(mode, i, change)
        return mode

    def _at_rest(self, sticking: Sequence[Friction]) -> "Contacts":
        """Return these contacts with the friction at rest of those frictions that have more of it."""
        model, static = self.equations.model, [friction for friction in sticking if friction.static]
        friction = tuple(each.at_rest if each in static else each for each in model.forces.friction)
        stronger = model.with_forces(replace(model.forces, friction=friction))
        return replace(self, equations=replace(self.equations, model=stronger)) if static else self

    def _moving_together(
        self, state: Kinematics, time: float, mode: ContactMode, fastest: float
    ) -> ContactMode | None:
        """Return the mode in which all frictions slide whose joints the forces move, or all stick.

        Just after the instant they slide as the forces without them tend to move the joints. If they then
        reverse this motion, they hold it, provided that there is only one: of several motions, some may
        continue, and the answer is None. `mode` has them sticking; those of joints without motion stick.
        """
        equations, times = self.equations, np.array([time])
        tendency = self.accelerate(state, times, replace(mode, stuck=[])).acceleration
        largest = float(np.abs(tendency).max())
        if not largest > 0.0:
            return mode
        seconds = 0.1 * REST * fastest / largest
        q = equations.loops.displaced(state.q, seconds * state.rates)
        after = equations.kinematics(q, state.rates + seconds * tendency, state.activation)
        rates = equations.friction_rates(after)[:, 0]
        resting = np.isin(np.arange(len(rates)), mode.stuck)
        moving = resting & (np.abs(rates) > REST * np.abs(rates[resting]).max())
        # what remains of a motion may reverse without friction
        change, signs = equations.friction_accelerations(after, tendency)[:, 0], np.sign(rates)
        balls = np.array([KINDS[friction.joint.kind].ball for friction in equations.frictions])
        signs = np.where((signs * change < 0.0) & ~balls, -signs, signs)
        # at a dead centre a joint moves only ahead of it
        step = AHEAD / np.abs(after.rates).max() * after.rates
        ahead = equations.kinematics(equations.loops.displaced(state.q, step), after.rates, state.activation)
        free = after.rates[equations.free, 0]
        free = free - pseudo_inverse(ahead.jacobian[0]) @ (ahead.jacobian - after.jacobian)[0] @ free
        later = equations.friction_directions(ahead)[:, 0] @ free
        at_dead_centre = resting & ~moving & (np.abs(later) > REST * np.abs(later).max())
        directions = np.where(at_dead_centre, np.sign(later), mode.sliding)
        sliding = replace(
            mode,
            sliding=np.where(moving, signs, directions),
            stuck=np.flatnonzero(resting & ~moving & ~at_dead_centre).tolist(),
        )
        try:
            acceleration = self.accelerate(after, times, sliding).acceleration
        except FrictionError as error:
            if error.outcome != "jammed":
                raise
            # no friction permits this motion, as in a self-locking drive
            return None
        growth = signs * equations.friction_accelerations(after, acceleration)[:, 0]
        # a friction that balances the forces to rounding holds
        growth -= 0.5 * BALANCED * np.abs(change)
        if (growth[moving] <= 0.0).all():
            return mode if len(equations.free) - equations.rank == 1 else None
        return sliding if (growth[moving] > 0.0).all() else None

    def _sliding(self, mode: ContactMode, index: int, direction: float) -> ContactMode:
        """Return a mode in which a sticking friction slides in a direction; that of a ball is positive."""
        sliding, ball = mode.sliding.copy(), KINDS[self.equations.frictions[index].joint.kind].ball
        sliding[index] = 1.0 if ball else np.sign(direction)
        return replace(mode, sliding=sliding, stuck=[i for i in mode.stuck if i != index])


def closing_instant(
    gap: Callable[[Array], Array], rate: Callable[[Array], Array], times: Array
) -> float | None:
    """Return the first instant in [s] at which a gap closes, also between the instants; None if it does not.

    A gap that is closed at the first instant closes again where it falls by `OPEN_GAP`, or once it was open.

    Args:
        gap: instants (n,) in [s] -> gap, (n,).
        rate: the same for its rate.
        times: instants, (n,) in [s], one a fraction of the gap's variations from the next.
    """
    values, rates = gap(times), rate(times)
    # a minimum between two instants
    turns = (rates[:-1] < 0.0) & (rates[1:] > 0.0) & (values[:-1] > 0.0) & (values[1:] > 0.0)
    lowest = [_root_of(rate, times[k], times[k + 1]) for k in np.flatnonzero(turns)]
    times = np.sort(np.append(times, lowest))
    values = gap(times)
    opened = np.maximum.accumulate(values) > OPEN_GAP
    offsets = np.where(opened, 0.0, OPEN_GAP + max(0.0, -float(values[0])))
    crosses = (values[:-1] + offsets[:-1] > 0.0) & (values[1:] + offsets[:-1] <= 0.0)
    if not crosses.any():
        return None
    k = int(np.argmax(crosses))
    return _root_of(lambda instants: gap(instants) + offsets[k], times[k], times[k + 1])


def _root_of(function: Callable[[Array], Array], low: float, high: float) -> float:
    return root(lambda time: float(function(np.array([time]))[0]), float(low), float(high))


def least_load(holding: Array, redundant: Array, limits: Array) -> float:
    """Return the least largest load of frictions (m,), by limits (m,), plus a combination of columns (m, k).

    A friction of negligible limit, in a joint without a load, holds as little as it can.
    """
    weak = limits <= NO_LOAD * limits.max()
    if weak.any():
        holding = holding - redundant @ pseudo_inverse(redundant[weak]) @ holding[weak]
        redundant = redundant @ null_space(redundant[weak]).T
        holding = np.where(weak & (np.abs(holding) <= NO_LOAD * np.abs(holding).max()), 0.0, holding)
        redundant = np.where(weak[:, None], 0.0, redundant)
    return _least_largest(holding / limits, redundant / limits[:, None])


def _least_largest(values: Array, directions: Array) -> float:
    """Return the least largest magnitude of values (m,) plus a combination of the columns (m, k).

    If that of the least sum of squares is at most 1, it is returned instead.
    """
    values = values - directions @ np.linalg.lstsq(directions, values, rcond=None)[0]
    if not directions.size or np.abs(values).max() <= 1.0:
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


def gap_indices(equations: EquationsOfMotion) -> dict[int, str]:
    """Return the indices in the tree of the gaps of one-sided contacts and ropes, with their names."""
    return {equations.loops.tree.index_of[name]: name for name in gaps_of(equations.model.mechanism)}


def stops_of(equations: EquationsOfMotion) -> tuple[Stop, ...]:
    """Return the stops of closed gaps, and of joints with a range, if the tree has their coordinate."""
    solver, index_of = equations.model.solver, equations.loops.tree.index_of
    rows = [*gap_limits(equations.model.mechanism).items(), *solver.ranges.items()]
    return tuple(
        Stop(index, limit / equations.loops.units[index], side, solver.restitution.get(name))
        for name, limits in rows
        if (index := index_of.get(name)) is not None and index in equations.free
        for limit, side in zip(limits, (-1.0, 1.0), strict=True)
        if abs(limit) < np.inf
    )
