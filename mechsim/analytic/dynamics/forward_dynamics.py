"""Forward dynamics of any mechanism: its motion in time from an initial state under forces.

An explicit Runge-Kutta method of order 8 with dense output (DOP853) integrates the equations of motion;
Radau's method of order 5 does where they are stiff. After every step the state is projected onto the loop
constraints, so that they do not drift. Coulomb friction sticks and slides; stops of joints are hit with a
coefficient of restitution. Events end a step exactly.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), section II.5,
and II (1996), section IV.8; E. Eich, Convergence results for a coordinate projection method applied to
mechanical systems with algebraic constraints, SIAM Journal on Numerical Analysis 30 (1993) 1467-1482.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.analytic.dynamics.contacts import REST, ContactMode, Contacts, EventFunction, Stop
from mechsim.analytic.dynamics.equations_of_motion import (
    EquationsOfMotion,
    Kinematics,
    conditionings,
)
from mechsim.analytic.dynamics.initial_state import projected
from mechsim.analytic.dynamics.linearization import null_space
from mechsim.analytic.dynamics.link_forces import kinetic_energy
from mechsim.analytic.dynamics.singular_crossing import collocated
from mechsim.analytic.dynamics.state_layout import StateLayout
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.errors import AssemblyError
from mechsim.model.finding import Outcome
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import root

# steps of the integrator in one run: about ten minutes
MOST_STEPS = 200_000
# events in one run before it counts as chattering
MOST_EVENTS = 10_000
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
        self.contacts = Contacts(equations, stops, restitution)
        self.layout = StateLayout(equations)
        self.time, self.state = 0.0, self.layout.pack(q, rates, 0.0, 0.0)
        self.mode = ContactMode(np.zeros(len(equations.frictions)))
        self.fastest = float(np.abs(rates).max(initial=0.0))
        self.pieces: list[Piece] = []
        self.events: list[float] = []
        self.steps = 0
        self.regular = self.nearest = SINGULAR * self._conditioning(self.state)
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
            self.mode = self.contacts.choose(self._kinematics(self.state), self.time, self.fastest)
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
            if self.blocked and self._approaches_singular():
                return self._cross(solver.t_bound)
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                return "diverged", f"the integrator found no step at {self.time:.6g} s ({message})"
            if self.steps > MOST_STEPS:
                return (
                    "failed",
                    f"{MOST_STEPS:,} steps reach {self.time:.6g} s only: the equations are too stiff",
                )
            after = float(solver.t)
            kind = self._accept(solver.dense_output(), after, solver.y)
            if kind is not None:
                return self._after_event(kind)
            if self.nearest < self.regular and self._conditioning(self.state) > CLOSE * self.regular:
                self.nearest = self.regular
            solver.y = self.state.copy()
            solver.f = self._derivative(after, self.state)
        return None

    def _accept(self, solution: Callable[[float], Array], after: float, state: Array) -> str | None:
        """Continue from an instant, where the state is known, or from the first event before it.

        Return the kind of the event.
        """
        event = self._first_event(solution, self.time, after)
        last = after if event is None else event[0]
        self.pieces.append(Piece(self.time, last, solution, self.mode, self.contacts.indices(self.mode)))
        self.time = last
        q, rates, work, lost = self.layout.unpack(state if event is None else solution(last))
        q, rates = projected(self.equations, q, rates, np.array([last]))
        rates = self._balanced(q, rates, work - lost)
        self.fastest = max(self.fastest, float(np.abs(rates).max(initial=0.0)))
        self.state = self.layout.pack(q, rates, work, lost)
        return None if event is None else event[1]

    def _after_event(self, kind: str) -> tuple[Outcome, str] | None:
        """Change rates and mode at an event; the outcome where the run ends."""
        if kind != "mode":
            return "done", ""
        self.events.append(self.time)
        if len(self.events) > MOST_EVENTS:
            return "stopped", f"{MOST_EVENTS:,} impacts and changes of friction by {self.time:.6g} s"
        self._impact()
        self.mode = self.contacts.choose(self._kinematics(self.state), self.time, self.fastest)
        return self._at_rest()

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

    def _conditioning(self, state: Array) -> float:
        """Return the smallest singular value of the loop constraints at a state."""
        return float(conditionings(self.equations, self._kinematics(state))[0])

    def _kinematics(self, state: Array) -> Kinematics:
        q, rates, _, _ = self.layout.unpack(state)
        return self.equations.kinematics(q, rates)

    def _derivative(self, time: float, state: Array) -> Array:
        return self._derivatives(np.array([time]), state[None])[0]

    def _derivatives(self, times: Array, states: Array) -> Array:
        """Return the derivatives of n states; not a number where one is too near a singular configuration."""
        if not np.isfinite(states).all():
            return np.full_like(states, np.nan)
        q, rates = self.layout.unpack_states(states)
        kinematics = self.equations.kinematics(q, rates)
        if self.stepping and (conditionings(self.equations, kinematics) < self.nearest).any():
            # the integrator then rejects the step
            self.blocked = True
            return np.full_like(states, np.nan)
        dynamics = self.contacts.accelerate(kinematics, times, self.mode)
        return self.layout.derivatives(states, kinematics, dynamics)

    def _approaches_singular(self) -> bool:
        """Return whether the last piece comes near a singular configuration."""
        if not self.pieces:
            return False
        conditioning, before = self._conditioning(self.state), self._conditioning_before()
        return conditioning <= CLOSE * self.nearest and before > conditioning

    def _conditioning_before(self) -> float:
        """Return the smallest singular value of the loop constraints where the last piece begins."""
        piece = self.pieces[-1]
        return self._conditioning(piece.solution(piece.first))

    def _cross(self, duration: float) -> tuple[Outcome, str] | None:
        """Cross a singular configuration, or allow steps nearer to it where the path only passes near one.

        Return the outcome where the run ends on the way, at the latest after a duration in [s].
        """
        crossing = self._crossing()
        if crossing is None:
            self.nearest *= NEARER
            return None
        solution, last = crossing
        last = min(last, duration)
        self.nearest = self.regular
        kind = self._accept(solution, last, solution(last))
        return None if kind is None else self._after_event(kind)

    def _crossing(self) -> tuple[Callable[[float], Array], float] | None:
        """Return the solution across the next singular configuration, and when it ends in [s]."""
        piece = self.pieces[-1]
        conditioning, before = self._conditioning(self.state), self._conditioning_before()
        distance = 2.0 * (piece.last - piece.first) * conditioning / (before - conditioning)
        for _ in range(CROSSINGS):
            beyond = self._conditioning(piece.solution(self.time + distance))
            if beyond > conditioning:
                # the smallest singular value is proportional to the distance on both sides
                distance *= 2.0 * conditioning / (conditioning + beyond)
                solution = collocated(self._on_loops, self.time, self.state, distance, piece.solution)
                return None if solution is None else (solution, self.time + distance)
            distance *= 1.5
        return None

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
        dynamics = self.contacts.accelerate(kinematics, np.array([self.time]), self.mode)
        acceleration = dynamics.acceleration
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
        functions += [("mode", function) for function in self.contacts.end_functions(self.mode)]
        return first_event(functions, lambda time: self._kinematics(dense(time)), before, after)

    def _impact(self) -> None:
        """Reverse the rate of every joint that hits its stop, by an impulse on all coordinates."""
        q, rates, work, lost = self.layout.unpack(self.state)
        state = self.equations.kinematics(q, rates)
        after = self.contacts.rates_after_impact(state, self.mode, self.fastest)
        mass = self.equations.mass(state)
        free = self.equations.free
        before, new = (kinetic_energy(mass, value[free].T)[0] for value in (rates, after))
        self.state = self.layout.pack(q, after, work, lost + float(before - new))

    def _at_rest(self) -> tuple[Outcome, str] | None:
        """Return the outcome where friction holds everything for good; None where something moves."""
        if not (self.mode.stuck or self.mode.contacts) or not self.equations.steady:
            return None
        state, fastest = self._kinematics(self.state), max(self.fastest, 1e-9)
        dynamics = self.contacts.accelerate(state, np.array([self.time]), self.mode)
        still = np.abs(state.rates).max(initial=0.0) <= 10.0 * REST * fastest
        if still and np.abs(dynamics.acceleration).max(initial=0.0) <= 1e-9 * fastest**2:
            return "stopped", f"friction holds the mechanism at rest from {self.time:.6g} s on"
        return None


def first_event(
    functions: Sequence[tuple[str, EventFunction]],
    state_at: Callable[[float], Kinematics],
    before: float,
    after: float,
) -> tuple[float, str] | None:
    """Return the first event between two instants in [s]: its instant and kind; None without one.

    Functions of kind "until" may cross zero either way, others fall through it.
    """
    if not functions:
        return None
    times = np.linspace(before, after, SAMPLES + 1)
    states = [state_at(float(time)) for time in times]
    first: tuple[float, str] | None = None
    for kind, function in functions:
        values = [function(state, float(time)) for state, time in zip(states, times, strict=True)]
        for k in range(SAMPLES):
            low, high = values[k], values[k + 1]
            falling = low > 0.0 >= high
            if not (falling or (kind == "until" and low < 0.0 <= high)):
                continue
            instant = root(
                lambda time, function=function: function(state_at(time), time),
                float(times[k]),
                float(times[k + 1]),
            )
            if first is None or instant < first[0]:
                first = (instant, kind)
            break
    return first
