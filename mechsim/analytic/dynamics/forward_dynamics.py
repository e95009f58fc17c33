"""Forward dynamics of any mechanism: its motion in time from an initial state under forces.

An explicit Runge-Kutta method of order 8 with dense output (DOP853) integrates the equations of motion.
After every step the state is projected onto the loop constraints, so that they do not drift. Coulomb friction
sticks and slides; stops of joints are hit with a coefficient of restitution. Events end a step exactly.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), section II.5;
E. Eich, Convergence results for a coordinate projection method applied to mechanical systems with algebraic
constraints, SIAM Journal on Numerical Analysis 30 (1993) 1467-1482.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mechsim.analytic.dynamics.equations_of_motion import Dynamics, EquationsOfMotion, Kinematics
from mechsim.analytic.dynamics.initial_state import projected
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
# start is too near a singular one: accelerations lose digits there. Extrapolation crosses it; its error is of
# order eight in the time it takes (validation/published/forward_dynamics.py, problem A02)
SINGULAR = 1e-2
# rates are not scaled to balance energy where the kinetic energy is below this fraction of the largest
SLOW = 1e-2
# a singular configuration is crossed from within this many times that distance
CLOSE = 4.0
# tries to find the far side of a singular configuration, each 1.5 times as far
CROSSINGS = 12

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
        self.nearest = SINGULAR * equations.conditioning(equations.kinematics(q, rates))
        self.blocked = self.stepping = False
        self.energy: float | None = None
        self.largest_kinetic = self.correction = 0.0
        self.corrections = [0.0]
        self._balanced(q, rates, 0.0)

    def run(self, duration: float, until: EventFunction | None = None) -> Trajectory:
        """Integrate until a duration in [s] or an event, and return the trajectory."""
        from scipy.integrate import DOP853

        outcome, reason = "done", ""
        try:
            self._choose_mode()
            while self.time < duration:
                solver = DOP853(
                    self._derivative,
                    self.time,
                    self.state,
                    duration,
                    rtol=self.tolerance,
                    atol=self._atol(),  # pyright: ignore[reportArgumentType]
                )
                ended = self._smooth_motion(solver, until)
                if ended is not None:
                    outcome, reason = ended
                    break
        except AssemblyError as error:
            outcome, reason = "dead centre", str(error)
        drift = max(self.corrections)
        return Trajectory(
            tuple(self.pieces), self.time, outcome, reason, self.steps, tuple(self.events), drift
        )

    def _smooth_motion(self, solver: Any, until: EventFunction | None) -> tuple[Outcome, str] | None:
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
            if not np.isfinite(solver.y).all():
                return "diverged", f"the integrator found no step at {self.time:.6g} s ({message})"
            if self.steps > MOST_STEPS:
                return (
                    "failed",
                    f"{MOST_STEPS:,} steps reach {self.time:.6g} s only: the equations are too stiff",
                )
            dense = solver.dense_output()
            before, after = self.time, float(solver.t)
            event = self._first_event(dense, before, after, until)
            last = after if event is None else event[0]
            self.pieces.append(Piece(before, last, dense, self.mode, self._contact_indices()))
            self.time = last
            q, rates, work, lost = self.layout.unpack(solver.y if event is None else dense(last))
            q, rates = projected(self.equations, q, rates)
            rates = self._balanced(q, rates, work - lost)
            self.fastest = max(self.fastest, float(np.abs(rates).max(initial=0.0)))
            self.state = self.layout.pack(q, rates, work, lost)
            if event is not None:
                if event[1] == "until":
                    return "done", ""
                self.events.append(last)
                if len(self.events) > MOST_EVENTS:
                    return "stopped", f"{MOST_EVENTS:,} impacts and changes of friction by {last:.6g} s"
                self._impact()
                self._choose_mode()
                return self._at_rest()
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
        if not np.isfinite(state).all():
            return np.full_like(state, np.nan)
        kinematics = self._kinematics(state)
        if self.stepping and self.equations.conditioning(kinematics) < self.nearest:
            # the integrator then rejects the step
            self.blocked = True
            return np.full_like(state, np.nan)
        dynamics = self._accelerate(kinematics, time, self.mode)
        return self.layout.derivative(state, kinematics, dynamics)

    def _cross(self) -> bool:
        """Cross a singular configuration by extrapolating the last step; False where none is near."""
        if not self.pieces:
            return False
        piece = self.pieces[-1]
        conditioning = self.equations.conditioning(self._kinematics(self.state))
        before = self.equations.conditioning(self._kinematics(piece.solution(piece.first)))
        if conditioning > CLOSE * self.nearest or not before > conditioning:
            return False
        distance = 2.0 * (piece.last - piece.first) * conditioning / (before - conditioning)
        for _ in range(CROSSINGS):
            time = self.time + distance
            q, rates, work, lost = self.layout.unpack(piece.solution(time))
            if self.equations.conditioning(self.equations.kinematics(q, rates)) > conditioning:
                q, rates = projected(self.equations, q, rates)
                self.pieces.append(Piece(self.time, time, piece.solution, self.mode, self._contact_indices()))
                self.time, self.state = time, self.layout.pack(q, rates, work, lost)
                return True
            distance *= 1.5
        return False

    def _atol(self) -> Array:
        """Absolute tolerances: of coordinates 1, of rates the fastest, of energies none."""
        kinematics = self._kinematics(self.state)
        acceleration = self._accelerate(kinematics, self.time, self.mode).acceleration
        rate = max(self.fastest, float(np.sqrt(np.abs(acceleration).max(initial=0.0))), 1e-6)
        return self.tolerance * self.layout.scale(rate)

    def _first_event(
        self, dense: Callable[[float], Array], before: float, after: float, until: EventFunction | None
    ) -> tuple[float, str] | None:
        """Return the first event within a step: its instant and kind."""
        functions: list[tuple[str, EventFunction]] = [] if until is None else [("until", until)]
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
        state = self._kinematics(self.state)
        dynamics = self._accelerate(state, self.time, self.mode)
        still = np.abs(state.rates).max(initial=0.0) <= 10.0 * REST * max(self.fastest, 1e-9)
        if still and np.abs(dynamics.acceleration).max(initial=0.0) <= 1e-9 * max(self.fastest, 1e-9) ** 2:
            return "stopped", f"friction holds the mechanism at rest from {self.time:.6g} s on"
        return None


class StateLayout:
    """Packing of coordinates, quaternions of balls, rates, work and loss into one vector.

    Args:
        equations: whose states.
    """

    def __init__(self, equations: EquationsOfMotion) -> None:
        self.tree = equations.loops.tree
        self.units = equations.loops.units
        self.count, self.balls = self.tree.count, len(self.tree.balls)

    def pack(self, q: Coordinates, rates: Array, work: float, lost: float) -> Array:
        """Return the vector of one state."""
        quaternions = [quaternion(rotation[..., 0]) for rotation in q.turns]
        return np.concatenate([q.values[:, 0] / self.units, *quaternions, rates[:, 0], [work, lost]])

    def unpack(self, state: Array) -> tuple[Coordinates, Array, float, float]:
        """Return coordinates, rates (count, 1), work done and energy lost of a vector."""
        n, b = self.count, 4 * self.balls
        rotations = np.zeros((self.balls, 3, 3, 1))
        for i, rotation in enumerate(rotations):
            rotation[..., 0] = rotation_matrix(state[n + 4 * i : n + 4 * i + 4])
        q = Coordinates((state[:n] * self.units)[:, None], rotations)
        return q, state[n + b : 2 * n + b, None].copy(), float(state[-2]), float(state[-1])

    def derivative(self, state: Array, kinematics: Kinematics, dynamics: Dynamics) -> Array:
        """Return the derivative of a vector by time."""
        values = kinematics.rates[:, 0].copy()
        values[self.tree.ball_indices] = 0.0
        turning: list[Array] = []
        for i, ball in enumerate(self.tree.balls):
            rate = kinematics.rates[ball.first_angle : ball.first_angle + 3, 0]
            first = self.count + 4 * i
            turning.append(quaternion_rate(state[first : first + 4], rate))
        powers = [dynamics.power_in[0], dynamics.power_lost[0]]
        return np.concatenate([values, *turning, dynamics.acceleration[:, 0], powers])

    def scale(self, rate: float) -> Array:
        """Return characteristic magnitudes of the vector's components at a characteristic rate."""
        positions = self.count + 4 * self.balls
        return np.concatenate([np.ones(positions), np.full(self.count, rate), np.full(2, 1e300)])


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
