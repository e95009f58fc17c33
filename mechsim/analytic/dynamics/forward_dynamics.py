"""Forward dynamics of any mechanism: its motion in time from an initial state under forces.

Gauss-Legendre collocation integrates the equations of motion, all nodes of a step at once; Radau's method of
order 5 does where they are stiff. After every step the state is projected onto the loop constraints, so that
they do not drift. Coulomb friction sticks and slides; stops of joints are hit with a coefficient of
restitution. Events end a step exactly.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), section II.7,
and II (1996), section IV.8; E. Eich, Convergence results for a coordinate projection method applied to
mechanical systems with algebraic constraints, SIAM Journal on Numerical Analysis 30 (1993) 1467-1482.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.analytic.dynamics.contacts import REST, ContactMode, Contacts, EventFunction, Stop
from mechsim.analytic.dynamics.energy_balance import EnergyBalance
from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.analytic.dynamics.link_forces import kinetic_energy
from mechsim.analytic.dynamics.right_hand_side import RightHandSide
from mechsim.analytic.dynamics.singular_crossing import crossing
from mechsim.analytic.dynamics.state_layout import StateLayout
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.errors import AssemblyError
from mechsim.model.finding import Outcome
from mechsim.numerics.arrays import Array
from mechsim.numerics.gauss_collocation import GaussCollocation, StepSolution
from mechsim.numerics.newton import root

# steps of the integrator in one run: about ten minutes
MAX_STEPS = 50_000
# steps of a run under forces over time, at least: their 24 nodes notice what lasts 1/300 of the run
LEAST_STEPS = 20
# events in one run before it counts as chattering
MAX_EVENTS = 10_000
# instants within a step at which events are looked for: evenly, and ever closer to its start, where a stop
# that was just hit may be hit again
INSTANTS = np.concatenate([[0.0], np.geomspace(1e-7, 1e-2, 10), np.linspace(0.0, 1.0, 33)[1:]])

# a configuration whose constraint Jacobian has a smallest singular value below this fraction of that at the
# start is too near a singular one for explicit steps: accelerations lose digits there
SINGULAR = 2e-2
# decays of the fastest rate during a run above which an implicit method is used: the iteration of collocation
# needs about a step for every four
MAX_DECAYS = 1e4
# relative error of an implicit step
IMPLICIT_TOLERANCE = 1e-11
# a singular configuration is crossed from within this many times that distance
CLOSE = 4.0
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

    def ahead(self, times: Array) -> Array:
        """Return extrapolated states (n, size) at times (n,) in [s] after the piece."""
        if isinstance(self.solution, StepSolution):
            return self.solution.beyond(times)
        return np.array([self.solution(time) for time in times.tolist()])


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
        mode = ContactMode(np.zeros(len(equations.frictions)))
        self.right = RightHandSide(equations, self.contacts, self.layout, mode)
        self.fastest = float(np.abs(rates).max(initial=0.0))
        self.pieces: list[Piece] = []
        self.events: list[float] = []
        self.steps = 0
        self.regular = self.nearest = SINGULAR * self.right.conditioning(self.state)
        self.implicit, self.duration = False, np.inf
        self.ends: list[tuple[str, EventFunction]] = []
        self.balance = EnergyBalance(equations, q, rates)

    def run(self, duration: float, until: EventFunction | None = None) -> Trajectory:
        """Integrate until a duration in [s] or an event, and return the trajectory."""
        outcome: Outcome = "done"
        reason = ""
        self.ends = [] if until is None else [("until", until)]
        self.duration = duration
        try:
            self._choose_mode()
            rest = self._at_rest()
            decay = self.right.fastest_decay(0.0, self.state, max(self.fastest, 1.0))
            self.implicit = decay * duration > MAX_DECAYS
            while self.time < duration:
                ended = self._smooth_motion(self._solver(duration))
                if ended is not None:
                    outcome, reason = ended
                    break
            else:
                outcome, reason = rest or (outcome, reason)
        except AssemblyError as error:
            outcome, reason = "dead centre", str(error)
        events = tuple(self.events)
        return Trajectory(
            tuple(self.pieces), self.time, outcome, reason, self.steps, events, self.balance.drift
        )

    def _solver(self, duration: float) -> Any:
        """Return the integrator of smooth motion: collocation, or Radau's method where it is stiff."""
        scale = self._scale()
        if not self.implicit:
            # forces over time may be brief
            longest = np.inf if self.equations.steady else self.duration / LEAST_STEPS
            return GaussCollocation(
                self.right.derivatives, self.time, self.state, duration, self.tolerance, scale, longest
            )
        from scipy.integrate import Radau

        tolerance = max(self.tolerance, IMPLICIT_TOLERANCE)
        options: dict[str, Any] = {"rtol": tolerance, "atol": tolerance * scale}
        return Radau(self.right.derivative, self.time, self.state, duration, jac=self._jacobian, **options)

    def _jacobian(self, time: float, state: Array) -> Array:
        return self.right.jacobian(time, state, max(self.fastest, 1.0))

    def _smooth_motion(self, solver: Any) -> tuple[Outcome, str] | None:
        """Step until an event changes the mode or the run ends; None where it goes on."""
        while solver.status != "finished":
            self.right.blocked, self.right.nearest = False, self.nearest
            message = solver.step()
            self.right.nearest = 0.0
            self.steps += 1
            if self.right.blocked and self._approaches_singular():
                return self._cross(solver.t_bound)
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                return "diverged", f"the integrator found no step at {self.time:.6g} s ({message})"
            if self.steps > MAX_STEPS:
                return (
                    "failed",
                    f"{MAX_STEPS:,} steps reach {self.time:.6g} s only; give a shorter duration",
                )
            after = float(solver.t)
            kind = self._accept(solver.dense_output(), after, solver.y)
            if kind is not None:
                return self._after_event(kind)
            if self.nearest < self.regular and self.right.conditioning(self.state) > CLOSE * self.regular:
                self.nearest = self.regular
            solver.y = self.state.copy()
            if self.implicit:
                solver.f = self.right.derivative(after, self.state)
        return None

    def _accept(self, solution: Callable[[float], Array], after: float, state: Array) -> str | None:
        """Continue from an instant, where the state is known, or from the first event before it.

        Return the kind of the event.
        """
        event, mode = self._first_event(solution, self.time, after), self.right.mode
        last = after if event is None else event[0]
        self.pieces.append(Piece(self.time, last, solution, mode, self.contacts.indices(mode)))
        self.time = last
        state = state if event is None else solution(last)
        state = self.right.nearest_on_loops(np.array([last]), state[None])[0]
        q, rates, work, lost = self.layout.unpack(state)
        if not (self.implicit or self.equations.prescribed):
            rates = self.balance.balanced(q, rates, work - lost)
        self.fastest = max(self.fastest, float(np.abs(rates).max(initial=0.0)))
        self.state = self.layout.replaced(state[None], q, rates)[0]
        return None if event is None else event[1]

    def _after_event(self, kind: str) -> tuple[Outcome, str] | None:
        """Change rates and mode at an event; the outcome where the run ends."""
        if kind != "mode":
            return "done", ""
        self.events.append(self.time)
        if len(self.events) > MAX_EVENTS:
            return "stopped", f"{MAX_EVENTS:,} impacts and changes of friction by {self.time:.6g} s"
        self._impact()
        self._choose_mode()
        return self._at_rest()

    def _choose_mode(self) -> None:
        self.right.mode = self.contacts.choose(self._kinematics(), self.time, self.fastest)

    def _kinematics(self) -> Kinematics:
        return self.right.kinematics(self.state[None])

    def _approaches_singular(self) -> bool:
        """Return whether the last piece comes near a singular configuration."""
        if not self.pieces:
            return False
        conditioning, before = self.right.conditioning(self.state), self._conditioning_before()
        return conditioning <= CLOSE * self.nearest and before > conditioning

    def _conditioning_before(self) -> float:
        """Return the smallest singular value of the loop constraints where the last piece begins."""
        piece = self.pieces[-1]
        return self.right.conditioning(piece.solution(piece.first))

    def _cross(self, duration: float) -> tuple[Outcome, str] | None:
        """Cross a singular configuration, or allow steps nearer to it where the path only passes near one.

        Return the outcome where the run ends on the way, at the latest after a duration in [s].
        """
        piece, conditioning = self.pieces[-1], self.right.conditioning(self.state)
        approach = (piece.last - piece.first) * conditioning / (self._conditioning_before() - conditioning)
        solution = crossing(self.right, self.time, self.state, approach, piece.ahead)
        if solution is None:
            self.nearest *= NEARER
            return None
        last = min(self.time + solution.duration, duration)
        kind = self._accept(solution, last, solution(last))
        self.nearest = min(self.regular, self.right.conditioning(self.state) / CLOSE)
        return None if kind is None else self._after_event(kind)

    def _scale(self) -> Array:
        """Return the scale of a state: of coordinates 1, of rates the fastest; energies count where stiff."""
        kinematics = self._kinematics()
        acceleration = self.contacts.accelerate(
            kinematics, np.array([self.time]), self.right.mode
        ).acceleration
        # at rest without forces, what moves a unit during the run
        slow = 1.0 / self.duration
        rate = max(self.fastest, float(np.sqrt(np.abs(acceleration).max(initial=0.0))), slow)
        scale = self.layout.scale(rate)
        if self.implicit:
            scale[-2:] = float(np.trace(self.equations.mass(kinematics)[0])) * rate**2
        return scale

    def _first_event(
        self, dense: Callable[[float], Array], before: float, after: float
    ) -> tuple[float, str] | None:
        """Return the first event within a step: its instant and kind."""
        functions = [*self.ends]
        functions += [("mode", function) for function in self.contacts.end_functions(self.right.mode)]

        def states_at(times: Array) -> Kinematics:
            return self.right.kinematics(np.array([dense(time) for time in times.tolist()]))

        return first_event(functions, states_at, before, after)

    def _impact(self) -> None:
        """Reverse the rate of every joint that hits its stop, by an impulse on all coordinates."""
        q, rates, work, lost = self.layout.unpack(self.state)
        state = self.equations.kinematics(q, rates)
        after = self.contacts.rates_after_impact(state, self.right.mode, self.fastest)
        mass = self.equations.mass(state)
        free = self.equations.free
        before, new = (kinetic_energy(mass, value[free].T)[0] for value in (rates, after))
        self.state = self.layout.pack(q, after, work, lost + float(before - new))

    def _at_rest(self) -> tuple[Outcome, str] | None:
        """Return the outcome where friction holds everything for good; None where something moves."""
        mode = self.right.mode
        if not (mode.stuck or mode.contacts) or not self.equations.steady:
            return None
        state, fastest = self._kinematics(), max(self.fastest, 1e-9)
        dynamics = self.contacts.accelerate(state, np.array([self.time]), mode)
        still = np.abs(state.rates).max(initial=0.0) <= 10.0 * REST * fastest
        if still and np.abs(dynamics.acceleration).max(initial=0.0) <= 1e-9 * fastest**2:
            solution, contacts = self.state.copy(), self.contacts.indices(mode)
            self.pieces.append(Piece(self.time, self.time, lambda _: solution, mode, contacts))
            return "stopped", f"{_holding(mode)} the mechanism at rest from {self.time:.6g} s on"
        return None


def _holding(mode: ContactMode) -> str:
    """Return what holds a mechanism at rest, with its verb."""
    if mode.stuck and mode.contacts:
        return "friction and stops hold"
    return "friction holds" if mode.stuck else "stops hold"


def first_event(
    functions: Sequence[tuple[str, EventFunction]],
    states_at: Callable[[Array], Kinematics],
    before: float,
    after: float,
) -> tuple[float, str] | None:
    """Return the first event between two instants in [s]: its instant and kind; None without one.

    Functions of kind "until" may cross zero either way, others fall through it.
    """
    if not functions:
        return None
    times = before + (after - before) * INSTANTS
    states, first = states_at(times), None
    for kind, function in functions:
        low, high = (values := function(states, times))[:-1], values[1:]
        crosses = (low > 0.0) & (high <= 0.0)
        if kind == "until":
            crosses |= (low < 0.0) & (high >= 0.0)
        if not crosses.any():
            continue
        k = int(np.argmax(crosses))
        instant = root(
            lambda time, function=function: float(function(states_at(np.array([time])), np.array([time]))[0]),
            float(times[k]),
            float(times[k + 1]),
        )
        if first is None or instant < first[0]:
            first = (instant, kind)
    return first
