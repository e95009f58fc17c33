"""Forward dynamics of any mechanism: its motion in time from an initial state under forces.

An explicit Runge-Kutta method of order 8 with dense output (DOP853) integrates the equations of motion;
Radau's method of order 5 does where they are stiff. After every step the state is projected onto the loop
constraints, so that they do not drift. Coulomb friction sticks and slides; stops of joints are hit with a
coefficient of restitution. Events end a step exactly.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), section II.5,
and II (1996), section IV.8; E. Eich, Convergence results for a coordinate projection method applied to
mechanical systems with algebraic constraints, SIAM Journal on Numerical Analysis 30 (1993) 1467-1482.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import Dynamics, EquationsOfMotion, Kinematics
from mechsim.analytic.dynamics.initial_state import projected
from mechsim.analytic.dynamics.linearization import null_space
from mechsim.analytic.dynamics.singular_crossing import collocated
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.vector_method.rotations import cross
from mechsim.errors import AssemblyError
from mechsim.model.finding import Outcome
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import root

# steps of the integrator in one run: about ten minutes
MOST_STEPS = 200_000
# events at one instant, and in one run, before the run counts as chattering
MOST_CHANGES, MOST_EVENTS = 50, 10_000
# fraction of the fastest rate so far below which a coordinate under friction is at rest
REST = 1e-9
# a stop that is approached more slowly than this fraction of the fastest rate is touched, not hit
SOFT_IMPACT = 1e-7
# fraction by which a friction force may exceed its size: rounding of a balance
BALANCED = 1e-9

# instants within a step at which events are looked for
SAMPLES = 6

# a configuration whose constraint Jacobian has a smallest singular value below this fraction of that at the
# start is too near a singular one for explicit steps: accelerations lose digits there
SINGULAR = 2e-2
# decays of the fastest rate during a run above which an implicit method is used: the explicit one needs about
# a step for every three
MOST_DECAYS = 2e4
# relative error of an implicit step, and step of its forward differences
IMPLICIT_TOLERANCE, FORWARD_STEP = 1e-11, 1e-7
# rates are not scaled to balance energy where the kinetic energy is below this fraction of the largest
SLOW = 1e-2
# a singular configuration is crossed from within this many times that distance
CLOSE = 4.0
# tries to find the far side of a singular configuration, each 1.5 times as far
CROSSINGS = 12
# factor on the distance where no singular configuration is crossed: the path only passes near one
NEARER = 0.1

# state -> a number that is zero at the event
EventFunction = Callable[[Kinematics, float], float]


@dataclass(frozen=True, slots=True)
class Stop:
    """A joint coordinate's limit: its index in the tree, the limit in units, and +1 (upper) or -1 (lower)."""

    index: int
    limit: float
    side: float


@dataclass(slots=True)
class ContactMode:
    """Which frictions slide (direction) or stick, and which stops are in contact."""

    sliding: Array
    stuck: list[int] = field(default_factory=list[int])
    contacts: list[int] = field(default_factory=list[int])


@dataclass(frozen=True, slots=True)
class Piece:
    """A smooth piece of the solution: instants, dense output, mode, and coordinates contacts by stops."""

    first: float
    last: float
    solution: Callable[[float], Array]
    mode: ContactMode
    contacts: list[int]


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The solution of a run.

    Attributes:
        pieces: steps of the integrator with dense output, in order.
        end: time of the end in [s].
        outcome: "done", "stopped" (at rest for good), "diverged" or "dead centre".
        reason: one sentence where the outcome is not "done".
        steps: taken by the integrator.
        events: instants of impacts and of changes between sticking and sliding, in [s].
        drift: energy by which steps were corrected, summed, at its largest, in [J].
    """

    pieces: tuple[Piece, ...]
    end: float
    outcome: Outcome
    reason: str
    steps: int
    events: tuple[float, ...]
    drift: float


class Integration:
    """One run as it proceeds.

    Args:
        equations: of motion.
        q: initial coordinates.
        rates: initial rates in units, (count, 1).
        tolerance: relative error of a step.
        stops: limits of joints.
        restitution: rate after an impact divided by the rate before it, 0 to 1.
    """

    def __init__(
        self,
        equations: EquationsOfMotion,
        q: Coordinates,
        rates: Array,
        tolerance: float,
        stops: tuple[Stop, ...] = (),
        restitution: float = 0.0,
    ) -> None:
        self.equations, self.tolerance = equations, tolerance
        self.stops, self.restitution = stops, restitution
        self.layout = StateLayout(equations)
        self.time, self.state = 0.0, self.layout.pack(q, rates, 0.0, 0.0)
        self.mode = ContactMode(np.zeros(len(equations.frictions)))
        self.fastest = float(np.abs(rates).max(initial=0.0))
        self.pieces: list[Piece] = []
        self.events: list[float] = []
        self.steps = 0
        self.regular = self.nearest = SINGULAR * equations.conditioning(equations.kinematics(q, rates))
        self.blocked = self.stepping = self.implicit = False
        self.ends: list[tuple[str, EventFunction]] = []
        self.energy: float | None = None
        self.largest_kinetic = self.correction = 0.0
        self.corrections = [0.0]
        self._balanced(q, rates, 0.0)

    def run(self, duration: float, until: EventFunction | None = None) -> Trajectory:
        """Integrate until a duration in [s] or an event, and return the trajectory."""
        outcome: Outcome = "done"
        reason = ""
        self.ends = [] if until is None else [("until", until)]
        try:
            self._choose_mode()
            self.implicit = self._is_stiff(duration)
            while self.time < duration:
                ended = self._smooth_motion(self._solver(duration))
                if ended is not None:
                    outcome, reason = ended
                    break
        except AssemblyError as error:
            outcome, reason = "dead centre", str(error)
        return self._trajectory(outcome, reason)

    def _trajectory(self, outcome: Outcome, reason: str) -> Trajectory:
        drift = max(self.corrections)
        return Trajectory(
            tuple(self.pieces), self.time, outcome, reason, self.steps, tuple(self.events), drift
        )

    def _solver(self, duration: float) -> Any:
        """Return the integrator of smooth motion: DOP853, or Radau's method where it is stiff."""
        from scipy.integrate import DOP853, Radau

        if not self.implicit:
            options: dict[str, Any] = {"rtol": self.tolerance, "atol": self._atol()}
            return DOP853(self._derivative, self.time, self.state, duration, **options)
        tolerance = max(self.tolerance, IMPLICIT_TOLERANCE)
        options = {"rtol": tolerance, "atol": self._atol() * (tolerance / self.tolerance)}
        return Radau(self._derivative, self.time, self.state, duration, jac=self._jacobian, **options)

    def _is_stiff(self, horizon: float) -> bool:
        """Return whether the fastest decay of a rate is too short for explicit steps over a time in [s]."""
        basis = null_space(self.equations, self.layout.unpack(self.state)[0])
        jacobian = self._jacobian(self.time, self.state)
        rates = slice(self.layout.positions, self.layout.positions + self.layout.count)
        free = self.equations.free
        derivative = basis.T @ jacobian[rates, rates][np.ix_(free, free)] @ basis
        decay = float(np.abs(np.linalg.eigvals(derivative)).max(initial=0.0))
        return decay * horizon > MOST_DECAYS

    def _jacobian(self, time: float, state: Array) -> Array:
        """Return the derivative of the right-hand side by the state, by forward differences."""
        layout = self.layout
        count = layout.positions + layout.count
        scale = layout.scale(max(self.fastest, 1.0))[:count] * FORWARD_STEP
        moved = state + np.concatenate([np.diag(scale), np.zeros((count, 2))], 1)
        values = self._derivatives(np.full(count + 1, time), np.concatenate([state[None], moved]))
        jacobian = np.zeros((len(state), len(state)))
        jacobian[:, :count] = (values[1:] - values[0]).T / scale
        return jacobian

    def _smooth_motion(self, solver: Any) -> tuple[Outcome, str] | None:
        """Step until an event changes the mode or the run ends; None where it goes on."""
        while solver.status == "running":
            self.blocked = False
            self.stepping = True
            message = solver.step()
            # stages between the ends of an accepted step, for its dense output, may be nearer
            self.stepping = False
            self.steps += 1
            if self.blocked and self._cross():
                return None
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                return "diverged", f"the integrator found no step at {self.time:.6g} s ({message})"
            if self.steps > MOST_STEPS:
                return (
                    "failed",
                    f"{MOST_STEPS:,} steps reach {self.time:.6g} s only: the equations are too stiff",
                )
            dense = solver.dense_output()
            before, after = self.time, float(solver.t)
            event = self._first_event(dense, before, after)
            last = after if event is None else event[0]
            self.pieces.append(Piece(before, last, dense, self.mode, self._contact_indices()))
            self.time = last
            q, rates, work, lost = self.layout.unpack(solver.y if event is None else dense(last))
            q, rates = projected(self.equations, q, rates, np.array([last]))
            rates = self._balanced(q, rates, work - lost)
            self.fastest = max(self.fastest, float(np.abs(rates).max(initial=0.0)))
            self.state = self.layout.pack(q, rates, work, lost)
            if event is not None:
                if event[1] != "mode":
                    return "done", ""
                self.events.append(last)
                if len(self.events) > MOST_EVENTS:
                    return "stopped", f"{MOST_EVENTS:,} impacts and changes of friction by {last:.6g} s"
                self._impact()
                self._choose_mode()
                return self._at_rest()
            if (
                self.nearest < self.regular
                and self.equations.conditioning(self._kinematics(self.state)) > CLOSE * self.regular
            ):
                self.nearest = self.regular
            solver.y = self.state.copy()
            solver.f = self._derivative(after, self.state)
        return None

    def _balanced(self, q: Coordinates, rates: Array, gained: float) -> Array:
        """Return rates scaled so that energy balances, and count the correction.

        Source: E. Hairer, C. Lubich and G. Wanner, Geometric Numerical Integration (2006), section IV.4
        (projection onto invariants).
        """
        kinetic, potential = self.equations.energy(self.equations.kinematics(q, rates))
        if self.energy is None:
            self.energy = kinetic + potential - gained
        self.largest_kinetic = max(self.largest_kinetic, kinetic)
        target = self.energy + gained - potential
        if self.implicit or self.equations.prescribed:
            return rates
        if kinetic < SLOW * self.largest_kinetic or not 0.5 * kinetic < target < 2.0 * kinetic:
            return rates
        self.correction += target - kinetic
        self.corrections.append(abs(self.correction))
        return rates * np.sqrt(target / kinetic)

    def _kinematics(self, state: Array) -> Kinematics:
        q, rates, _, _ = self.layout.unpack(state)
        return self.equations.kinematics(q, rates)

    def _accelerate(self, state: Kinematics, time: float, mode: ContactMode) -> Dynamics:
        contacts = [self.stops[i].index for i in mode.contacts]
        return self.equations.accelerate(state, np.array([time]), mode.sliding, mode.stuck, contacts)

    def _contact_indices(self) -> list[int]:
        return [self.stops[i].index for i in self.mode.contacts]

    def _derivative(self, time: float, state: Array) -> Array:
        return self._derivatives(np.array([time]), state[None])[0]

    def _derivatives(self, times: Array, states: Array) -> Array:
        """Return the derivatives of n states; not a number where one is too near a singular configuration."""
        if not np.isfinite(states).all():
            return np.full_like(states, np.nan)
        q, rates = self.layout.unpack_states(states)
        kinematics = self.equations.kinematics(q, rates)
        if self.stepping and (self.equations.conditionings(kinematics) < self.nearest).any():
            # the integrator then rejects the step
            self.blocked = True
            return np.full_like(states, np.nan)
        mode, contacts = self.mode, self._contact_indices()
        dynamics = self.equations.accelerate(kinematics, times, mode.sliding, mode.stuck, contacts)
        return self.layout.derivatives(states, kinematics, dynamics)

    def _cross(self) -> bool:
        """Cross a singular configuration, or allow steps nearer to it where the path only passes near one.

        False where none is near.
        """
        if not self.pieces:
            return False
        piece = self.pieces[-1]
        conditioning = self.equations.conditioning(self._kinematics(self.state))
        before = self.equations.conditioning(self._kinematics(piece.solution(piece.first)))
        if conditioning > CLOSE * self.nearest or not before > conditioning:
            return False
        distance = 2.0 * (piece.last - piece.first) * conditioning / (before - conditioning)
        for _ in range(CROSSINGS):
            beyond = self.equations.conditioning(self._kinematics(piece.solution(self.time + distance)))
            if beyond > conditioning:
                # the smallest singular value is proportional to the distance on both sides
                distance *= 2.0 * conditioning / (conditioning + beyond)
                crossing = collocated(self._on_loops, self.time, self.state, distance, piece.solution)
                if crossing is None:
                    break
                self._accept_crossing(self.time + distance, crossing)
                return True
            distance *= 1.5
        self.nearest *= NEARER
        return True

    def _accept_crossing(self, time: float, solution: Callable[[float], Array]) -> None:
        """Continue from the far side of a singular configuration."""
        q, rates, work, lost = self.layout.unpack(solution(time))
        q, rates = projected(self.equations, q, rates, np.array([time]))
        rates = self._balanced(q, rates, work - lost)
        self.pieces.append(Piece(self.time, time, solution, self.mode, self._contact_indices()))
        self.time, self.state = time, self.layout.pack(q, rates, work, lost)
        self.nearest = self.regular

    def _on_loops(self, time: float, state: Array) -> tuple[Array, float]:
        """Return the derivative at the nearest state that satisfies the loops, and the distance to it."""
        q, rates, work, lost = self.layout.unpack(state)
        q, rates = projected(self.equations, q, rates, np.array([time]))
        nearest = self.layout.pack(q, rates, work, lost)
        positions = self.layout.positions
        return self._derivative(time, nearest), float(np.abs((nearest - state)[:positions]).max())

    def _atol(self) -> Array:
        """Absolute tolerances: of coordinates 1, of rates the fastest, of energies none."""
        kinematics = self._kinematics(self.state)
        acceleration = self._accelerate(kinematics, self.time, self.mode).acceleration
        rate = max(self.fastest, float(np.sqrt(np.abs(acceleration).max(initial=0.0))), 1e-6)
        scale = self.layout.scale(rate)
        if self.implicit:
            scale[-2:] = float(np.trace(self.equations.mass(kinematics)[0])) * rate**2
        return self.tolerance * scale

    def _first_event(
        self, dense: Callable[[float], Array], before: float, after: float
    ) -> tuple[float, str] | None:
        """Return the first event within a step: its instant and kind."""
        functions = [*self.ends]
        functions += [("mode", function) for function in self._mode_functions()]
        if not functions:
            return None
        times = np.linspace(before, after, SAMPLES + 1)
        states = [self._kinematics(dense(float(time))) for time in times]
        first: tuple[float, str] | None = None
        for kind, function in functions:
            values = [function(state, float(time)) for state, time in zip(states, times, strict=True)]
            for k in range(SAMPLES):
                low, high = values[k], values[k + 1]
                falling = low > 0.0 >= high
                if not (falling or (kind == "until" and low < 0.0 <= high)):
                    continue
                instant = root(
                    lambda time, function=function: function(self._kinematics(dense(time)), time),
                    float(times[k]),
                    float(times[k + 1]),
                )
                if first is None or instant < first[0]:
                    first = (instant, kind)
                break
        return first

    def _mode_functions(self) -> list[EventFunction]:
        """Return functions that fall through zero where the mode ends."""
        functions: list[EventFunction] = []
        mode = self.mode
        for i in np.flatnonzero(mode.sliding):
            functions.append(
                lambda state, _, i=int(i): float(self._friction_rate(state, i) * mode.sliding[i])
            )
        for i in mode.stuck:
            functions.append(lambda state, time, i=i: self._reserve(self._accelerate(state, time, mode), i))
        for i, stop in enumerate(self.stops):
            if i in mode.contacts:
                functions.append(
                    lambda state, time, i=i: float(self._pressing(self._accelerate(state, time, mode), i))
                )
            else:
                functions.append(lambda state, _, stop=stop: self._clearance(state, stop))
        return functions

    def _friction_rate(self, state: Kinematics, index: int) -> float:
        return float(self.equations.friction_rates(state)[index, 0])

    def _reserve(self, dynamics: Dynamics, index: int) -> float:
        """Return by how much a sticking friction exceeds what it must hold, in [N m] or [N]."""
        magnitude = self.equations.frictions[index].magnitude
        return magnitude * (1.0 + BALANCED) - abs(float(dynamics.holding[index, 0]))

    def _pressing(self, dynamics: Dynamics, index: int) -> float:
        """Return the force with which a stop is pressed; negative where the joint would have to be pulled."""
        return -self.stops[index].side * float(dynamics.contact[self.mode.contacts.index(index), 0])

    def _clearance(self, state: Kinematics, stop: Stop) -> float:
        value = float(state.q.values[stop.index, 0]) / self.equations.loops.units[stop.index]
        return stop.side * (stop.limit - value)

    def _impact(self) -> None:
        """Reverse the rate of every joint that hits its stop, by an impulse on all coordinates."""
        q, rates, work, lost = self.layout.unpack(self.state)
        state = self.equations.kinematics(q, rates)
        hit = [
            stop
            for i, stop in enumerate(self.stops)
            if i not in self.mode.contacts
            and abs(self._clearance(state, stop)) < 1e-9
            and stop.side * rates[stop.index, 0] > SOFT_IMPACT * self.fastest
        ]
        if hit:
            after = self.equations.impact(state, [stop.index for stop in hit], self.restitution)
            before, new = (self.equations.kinetic_energy(state, value) for value in (rates, after))
            self.state = self.layout.pack(q, after, work, lost + before - new)

    def _choose_mode(self) -> None:
        """Choose sticking, sliding and contact so that friction forces and pressures are admissible."""
        state = self._kinematics(self.state)
        rates = self.equations.friction_rates(state)[:, 0]
        threshold = REST * max(self.fastest, 1e-9)
        at_rest = np.abs(rates) <= threshold
        sliding = np.where(at_rest, 0.0, np.sign(rates))
        tree_rates = state.rates[:, 0]
        contacts = [
            i
            for i, stop in enumerate(self.stops)
            if self._clearance(state, stop) <= 1e-9
            and abs(tree_rates[stop.index]) <= SOFT_IMPACT * max(self.fastest, 1e-9)
        ]
        mode = ContactMode(sliding, [int(i) for i in np.flatnonzero(at_rest)], contacts)
        for _ in range(MOST_CHANGES):
            dynamics = self._accelerate(state, self.time, mode)
            self.mode = mode
            sizes = [friction.magnitude for friction in self.equations.frictions]
            loads = {i: abs(float(dynamics.holding[i, 0])) / sizes[i] for i in mode.stuck}
            slipping = max(loads, key=lambda i: loads[i], default=None)
            pulled = [i for i in mode.contacts if self._pressing(dynamics, i) < 0.0]
            if slipping is not None and loads[slipping] > 1.0 + BALANCED:
                direction = mode.sliding.copy()
                direction[slipping] = -np.sign(float(dynamics.holding[slipping, 0]))
                mode = ContactMode(direction, [i for i in mode.stuck if i != slipping], mode.contacts)
            elif pulled:
                mode = ContactMode(mode.sliding, mode.stuck, [i for i in mode.contacts if i not in pulled])
            else:
                return
        self.mode = mode

    def _at_rest(self) -> tuple[Outcome, str] | None:
        """Return the outcome where friction holds everything for good; None where something moves."""
        if not (self.mode.stuck or self.mode.contacts) or not self.equations.steady:
            return None
        if self._is_still():
            return "stopped", f"friction holds the mechanism at rest from {self.time:.6g} s on"
        return None

    def _is_still(self) -> bool:
        state = self._kinematics(self.state)
        dynamics = self._accelerate(state, self.time, self.mode)
        still = np.abs(state.rates).max(initial=0.0) <= 10.0 * REST * max(self.fastest, 1e-9)
        return bool(still and np.abs(dynamics.acceleration).max(initial=0.0) <= self._small_acceleration())

    def _small_acceleration(self) -> float:
        return 1e-9 * max(self.fastest, 1e-9) ** 2


class StateLayout:
    """Packing of coordinates, quaternions of balls, rates, work and loss into one vector.

    Args:
        equations: whose states.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.tree = equations.loops.tree
        self.units = equations.loops.units
        self.count, self.balls = self.tree.count, len(self.tree.balls)
        self.positions = self.count + 4 * self.balls

    def pack(self, q: Coordinates, rates: Array, work: float, lost: float) -> Array:
        """Return the vector of one state."""
        quaternions = [quaternion(rotation[..., 0]) for rotation in q.turns]
        return np.concatenate([q.values[:, 0] / self.units, *quaternions, rates[:, 0], [work, lost]])

    def unpack(self, state: Array) -> tuple[Coordinates, Array, float, float]:
        """Return coordinates, rates (count, 1), work done and energy lost of a vector."""
        q, rates = self.unpack_states(state[None])
        return q, rates, float(state[-2]), float(state[-1])

    def unpack_states(self, states: Array) -> tuple[Coordinates, Array]:
        """Return coordinates and rates (count, n) of n vectors."""
        n, positions = self.count, self.positions
        rotations = np.zeros((self.balls, 3, 3, len(states)))
        for i, rotation in enumerate(rotations):
            for k, state in enumerate(states):
                rotation[..., k] = rotation_matrix(state[n + 4 * i : n + 4 * i + 4])
        q = Coordinates(states[:, :n].T * self.units[:, None], rotations)
        return q, states[:, positions : positions + n].T.copy()

    def derivatives(self, states: Array, kinematics: Kinematics, dynamics: Dynamics) -> Array:
        """Return the derivatives of n vectors by time, (n, size)."""
        values = kinematics.rates.copy()
        values[self.tree.ball_indices] = 0.0
        turning: list[Array] = []
        for i, ball in enumerate(self.tree.balls):
            rate = kinematics.rates[ball.first_angle : ball.first_angle + 3]
            first = self.count + 4 * i
            quaternions = states[:, first : first + 4]
            turning.append(
                np.array([quaternion_rate(*pair) for pair in zip(quaternions, rate.T, strict=True)]).T
            )
        powers = dynamics.power_in[None], dynamics.power_lost[None]
        return np.concatenate([values, *turning, dynamics.acceleration, *powers]).T

    def scale(self, rate: float) -> Array:
        """Return characteristic magnitudes of the vector's components at a characteristic rate."""
        return np.concatenate([np.ones(self.positions), np.full(self.count, rate), np.full(2, 1e300)])


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(rotation).as_quat(), 1)


def rotation_matrix(quaternion: Array) -> Array:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length."""
    w, x, y, z = quaternion / np.sqrt((quaternion**2).sum())
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def quaternion_rate(quaternion: Array, angular_velocity: Array) -> Array:
    """Return the rate of a quaternion at an angular velocity (3,) in the fixed frame."""
    w, vector = quaternion[0], quaternion[1:]
    return 0.5 * np.concatenate(
        [[-angular_velocity @ vector], w * angular_velocity + cross(angular_velocity, vector)]
    )


def stops_of(equations: EquationsOfMotion, ranges: Mapping[str, tuple[float, float]]) -> tuple[Stop, ...]:
    """Return the stops of joints with a range in [m] or [rad], of those whose coordinate the tree has."""
    stops: list[Stop] = []
    for name, limits in ranges.items():
        index = equations.loops.tree.index_of.get(name)
        if index is None:
            continue
        for limit, side in zip(limits, (-1.0, 1.0), strict=True):
            if abs(limit) < np.inf:
                stops.append(Stop(index, limit / equations.loops.units[index], side))
    return tuple(stops)
