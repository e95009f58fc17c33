"""Forward dynamics of any mechanism: its motion in time from an initial state under forces.

Gauss-Legendre collocation integrates the equations of motion and evaluates all nodes of a step at once. If
they are stiff, Newton's method solves the equations of a step. Each state is projected onto the loop
constraints after its step, which prevents drift. Coulomb friction sticks or slides. Joint stops have a
coefficient of restitution. A step ends exactly at an event.

Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), section II.7,
and II (1996), section IV.8; E. Eich, Convergence results for a coordinate projection method applied to
mechanical systems with algebraic constraints, SIAM Journal on Numerical Analysis 30 (1993) 1467-1482.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from mechsim.errors import AssemblyError, FrictionError, MissingToolError, OutputError, several
from mechsim.kinetics.compiled_model import CompiledModel, NotCompiledError, compiled_model
from mechsim.kinetics.compiled_motion import (
    BLOCKED,
    FAILED,
    NOTHING,
    DenseSteps,
    StepSettings,
    StepsInC,
    Watched,
    agreed_pivot,
    evaluated,
    integrated,
    scale_of,
)
from mechsim.kinetics.contacts import (
    CLOSED_GAP,
    REST,
    ContactMode,
    Contacts,
    EventFunction,
    JammedError,
    Stop,
    closing_instant,
)
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.kinetics.initial_state import StateLayout
from mechsim.kinetics.link_forces import kinetic_energy
from mechsim.kinetics.right_hand_side import RightHandSide, crossing
from mechsim.mechanism.finding import Outcome
from mechsim.mechanism.load_profile import Interpolated
from mechsim.numerics.arrays import Array
from mechsim.numerics.gauss_collocation import STIFF_NODES, GaussCollocation, StepSolution
from mechsim.numerics.newton import root
from mechsim.numerics.resources import Progress, no_progress

# what evaluates the equations of motion
Executed = Literal["C", "numpy"]
# kinetic energy relative to the largest below which rates are not scaled
SLOW = 1e-2
# the same relative to the potential energy, whose rounding, 2e-16, is then near the tolerance of a step
ROUNDED = 1e-3
# acceleration at rest, relative to that without sticking friction and contacts, that is rounding; root of the
# squares weighted by the masses
AT_REST = 1e-12


class EnergyBalance:
    """Energy of a run and its numerical drift.

    Args:
        equations: equations of motion.
        start: initial state.

    Attributes:
        initial: energy at the start of the run, in [J].
        correction: sum of the corrections, in [J].
        largest: largest kinetic energy, in [J].
        drift: largest magnitude of the summed energy corrections, in [J].
    """

    def __init__(self, equations: EquationsOfMotion, start: Kinematics) -> None:
        self.drift = 0.0
        self.largest, potential = equations.energy(start)
        self.initial, self.correction = self.largest + potential, 0.0

    def balanced(self, rates: Array, kinetic: float, potential: float, gained: float) -> Array:
        """Return rates of two energies scaled to the initial energy plus the energy gained, in [J]."""
        self.largest = max(self.largest, kinetic)
        target = self.initial + gained - potential
        least = max(SLOW * self.largest, ROUNDED * (abs(self.initial) + abs(potential)))
        if kinetic < least or not 0.5 * kinetic < target < 2.0 * kinetic:
            return rates
        self.correction += target - kinetic
        self.drift = max(self.drift, abs(self.correction))
        return rates * np.sqrt(target / kinetic)


# relative rounding of the kinetic energy after an impact
IMPACT_ROUNDING = 1e-9
# names of events: end of a contact mode, and an end of the run at which both directions of crossing count
MODE, UNTIL = "mode", "until"
# work budget: largest number of states that a run evaluates. A step or an impact takes 170 to 300, all of
# them about a minute with few links
BUDGET = 500_000
# states after which a run ends if at its pace it needs more than `HOPELESS` budgets: four seconds with few
# links, and more than a hundred impacts
EARLY, HOPELESS = 20_000, 20.0
# number of rows of load tables above which a run that spends its budget names it
MANY_ROWS = 1_000
# smallest number of steps of a run under forces over time: their 24 nodes resolve forces that last 1/300 of
# the run
LEAST_STEPS = 20
# the same in C, whose steps have half as many nodes and are a quarter as long
LEAST_STEPS_IN_C = 80
# instant, relative to the run's duration, at which C and numpy are compared besides all rates: none at which
# usual forces over time vanish
WITHIN_RUN = 0.37
# factor on the tolerance of a step where a link turns on a ball, whose rates are those in the frame of its
# side a: errors of its rotation change its angular momentum. Euler's top near its unstable axis, 10 s: the
# error is 3e-9 without it and 6e-11 with it, for 1.5 times the steps; and the least tolerance, above rounding
TURNING, LEAST_TURNING = 0.03, 3e-15
# instants within a step at which events are searched, relative to its duration: evenly spaced, and denser
# towards the start, where a stop may be hit again right after an impact
INSTANTS = np.concatenate([[0.0], np.geomspace(1e-7, 1e-2, 10), np.linspace(0.0, 1.0, 33)[1:]])

# the same within each step in C, which is a tenth as long: one instant per variation of the dense output; and
# within one by collocation
WITHIN, WITHIN_STIFF = 4, 16
# numbers of steps that C takes before events are searched: those beyond an event are lost, few where contacts
# change, some where the run may end
FEW_STEPS, SOME_STEPS, MANY_STEPS = 8, 16, 512
# difference of the instants of simultaneous events, relative to the longest interval of the search: rounding
SIMULTANEOUS = 1e-10

# smallest singular value of the constraint Jacobian, relative to that at the start, below which explicit
# steps are rejected: accelerations lose significance near a singular configuration
SINGULAR = 2e-2
# number of time constants of the fastest decay within a run above which an implicit method is used: the
# iteration of collocation needs about one step for every four
MAX_DECAYS = 1e3
# the same in C: twice as fast as explicit steps for four_bar whose motor decays 500 times in eight turns
MAX_DECAYS_IN_C = 3e2
# the same above which the motion is not computed, since the decay multiplies the rounding of the rates: the
# energy lost by a creeping rod is correct to 1e-5 at 1e11, and wrong at 1e12
# (tests/kinetics/cases.toml)
MAX_STIFFNESS = 1.5e11
# rate relative to that of Stribeck's curve up to which friction differs from that in motion: by 2e-16 of it.
# A step within this range changes the rate by that of the curve, one towards it by half of the way
STRIBECK_RANGE = 6.0
# number of halvings of a step to its last instant with unique frictions, and the part of that instant by
# which a record ends before it, since rounding decides there
HALVINGS, SOLVED = 40, 1e-12
# smallest singular value, relative to the limit of explicit steps, below which a crossing of a singular
# configuration is tried, and above which that limit is restored
CLOSE = 4.0
# factor on the limit of explicit steps if the path only passes near a singular configuration
NEARER = 0.1


@dataclass(frozen=True, slots=True)
class Piece:
    """A smooth piece of the solution: instants, dense output, mode, and coordinates in contact with stops."""

    first: float
    last: float
    solution: StepSolution | DenseSteps
    mode: ContactMode
    contacts: list[int]


@dataclass(frozen=True, slots=True)
class Trajectory:
    """The solution of a run.

    Attributes:
        pieces: integration steps with dense output, in order; many steps in one piece if C took them.
        end: time of the end in [s].
        outcome: "done", "stopped" (permanently at rest), "diverged", "dead centre", "failed" (a joint beyond
            its stop), "too stiff" or "work budget spent".
        reason: one sentence if the outcome is not "done".
        steps: number of integration steps.
        events: instants of impacts and of changes between sticking and sliding, in [s].
        event: name of the event that ended the run; empty for another end.
        drift: largest magnitude of the summed energy corrections, in [J].
        executed: what evaluated the equations of motion.
        note: why it was not C.
        compiled: the model in C; None without one.
    """

    pieces: tuple[Piece, ...]
    end: float
    outcome: Outcome
    reason: str
    steps: int
    events: tuple[float, ...]
    event: str
    drift: float
    executed: Executed = "numpy"
    note: str = ""
    compiled: CompiledModel | None = None


class Integration:
    """The state of a run during integration.

    Args:
        start: initial coordinates and rates.
        tolerance: relative error of a step.
        stops: limits of joints.
        restitution: rate after an impact divided by the rate before it, 0 to 1.
        progress: called after each step with a text and the finished fraction.
        budget: largest number of evaluated states.
        displacement: largest displacement that is expected, in units.
    """

    def __init__(
        self,
        start: Kinematics,
        tolerance: float,
        stops: tuple[Stop, ...] = (),
        restitution: float = 0.0,
        progress: Progress = no_progress,
        budget: int = BUDGET,
        displacement: float = 1.0,
    ) -> None:
        self.equations, self.progress = start.equations, progress
        equations = self.equations
        turning = bool(equations.loops.tree.balls)
        self.tolerance = max(TURNING * tolerance, LEAST_TURNING) if turning else tolerance
        self.budget, self.displacement = budget, displacement
        self.contacts = Contacts(equations, stops, restitution)
        self.layout = StateLayout(equations)
        self.time, self.state = 0.0, self.layout.pack(start.q, start.rates, 0.0, 0.0)
        self.origin = self.layout.origin(self.state)
        if len(self.layout.start):
            start = replace(start, activation=self.layout.activation(self.state[None]))
        self.at_state = self.state, start
        mode = ContactMode(np.zeros(len(equations.frictions)), phases=self.contacts.phases(start))
        self.right = RightHandSide(equations, self.contacts, self.layout, mode)
        self.fastest = float(np.abs(start.rates).max(initial=0.0))
        self.pieces: list[Piece] = []
        self.events: list[float] = []
        self.steps = 0
        self.regular = self.nearest = SINGULAR * float(start.conditioning[0])
        self.implicit, self.duration, self.decay = False, np.inf, 0.0
        # the model in C, and the same while it integrates
        self.in_c: CompiledModel | None = None
        self.compiled: CompiledModel | None = None
        self.pivot = 1.0
        # whether numpy passes a configuration that is too close to a singular one for the C code
        self.passing, self.note = False, ""
        self.executed: Executed = "numpy"
        self.ends: dict[str, EventFunction] = {}
        self.watched = NOTHING
        self.event = ""
        self.balance = EnergyBalance(equations, start)

    def run(
        self,
        duration: float,
        ends: Mapping[str, EventFunction] | None = None,
        expected: float | None = None,
        watched: Watched = NOTHING,
    ) -> Trajectory:
        """Integrate up to a duration or an event, and return the trajectory.

        Args:
            duration: latest end in [s].
            ends: name of an event that ends the run -> function that falls through zero there.
            expected: expected end in [s]; the default is the duration.
            watched: index of a component of states, and its values in units beyond which an end lies.
        """
        outcome: Outcome = "done"
        reason = ""
        self.ends, self.duration = dict(ends or {}), expected or duration
        self.watched = watched
        try:
            if self._impact():
                self.events.append(self.time)
            self._choose_mode()
            ended = self._at_rest()
            if ended is not None:
                # integrated rounding would move a light link
                self.time = duration
                self.pieces[-1] = replace(self.pieces[-1], last=duration)
            else:
                self._compile(self.duration)
                self._find_stiffness(self.duration)
                ended = self._too_stiff()
            while ended is None and self.time < duration:
                locked = None if self.compiled is None or self.passing else self._locked()
                ended = (
                    self._smooth_motion(self._solver(duration))
                    if self.compiled is None or locked is None
                    else self._motion_in_c(self.compiled, locked, duration)
                )
            outcome, reason = ended or (outcome, reason)
        except AssemblyError as error:
            outcome, reason = "dead centre", str(error)
        except FrictionError as error:
            outcome, reason = error.outcome, str(error)
            self._end_where_solved()
        except JammedError as error:
            outcome, reason = "failed", f"{error} at {self.time:.6g} s"
        if not self.pieces:
            constant = StepSolution.constant(self.time, self.state)
            self.pieces.append(Piece(self.time, self.time, constant, self.right.mode, []))
        pieces, events = tuple(self.pieces), tuple(self.events)
        drift, how = self.balance.drift, (self.note, self.in_c)
        return Trajectory(
            pieces, self.time, outcome, reason, self.steps, events, self.event, drift, self.executed, *how
        )

    def _end_where_solved(self) -> None:
        """End the last piece at its last instant with unique frictions."""
        if not self.pieces:
            return
        piece = self.pieces[-1]

        def solved(time: float) -> bool:
            times = np.array([time])
            state = self.right.kinematics(self.right.nearest_on_loops(times, piece.solution(times)))
            try:
                self.contacts.accelerate(state, times, piece.mode)
            except FrictionError:
                return False
            return True

        if solved(piece.last):
            return
        low, high = piece.first, piece.last
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if solved(middle) else (low, middle)
        self.time = low - SOLVED * low
        while len(self.pieces) > 1 and self.pieces[-1].first >= self.time:
            self.pieces.pop()
        self.pieces[-1] = replace(self.pieces[-1], last=self.time)

    def prepared(self, duration: float) -> CompiledModel | None:
        """Return the model in C for runs of a duration in [s]; None if numpy must integrate them."""
        self._compile(duration)
        self._find_stiffness(duration)
        return self.compiled

    def _find_stiffness(self, duration: float) -> None:
        """Set the fastest decay in [1/s], and whether it needs the implicit method."""
        derivatives = self.right.derivatives if self.compiled is None else self._derivatives_in_c
        loops = self.kinematics().jacobian[:, : self.equations.loops.rows]
        rate = max(self.fastest, 1.0)
        self.decay = self.right.fastest_decay(self.time, self.state, loops, rate, derivatives)
        most = MAX_DECAYS if self.compiled is None else MAX_DECAYS_IN_C
        self.implicit = bool(self.decay * duration > most)

    def _derivatives_in_c(self, times: Array, states: Array) -> Array:
        """Return the derivatives of n states."""
        locked = self._locked()
        if self.compiled is None or locked is None:
            return self.right.derivatives(times, states)
        return evaluated(self.compiled, states, times, self.right.mode, locked).derivatives

    @property
    def longest(self) -> float:
        """Longest step in C in [s]."""
        # forces over time may be short pulses
        least = LEAST_STEPS if self.implicit else LEAST_STEPS_IN_C
        return np.inf if self.equations.steady else self.duration / least

    def nearest_pivot(self) -> float:
        """Return the smallest pivot of the loop constraints at which C continues."""
        return SINGULAR * self.pivot * self.nearest / self.regular

    def _compile(self, duration: float) -> None:
        """Let C integrate the motion, unless it does not contain the model, or there is no compiler."""
        try:
            self.compiled = compiled_model(self.equations)
            sample = self.time + WITHIN_RUN * min(duration, 1.0)
            self.pivot = agreed_pivot(self.compiled, self.right, self.state, sample)
            self.in_c = self.compiled
        except NotCompiledError as error:
            self.compiled, self.note = None, f"the C code does not contain {error}"
        except (MissingToolError, OutputError) as error:
            self.note = str(error)

    def _locked(self) -> list[int] | None:
        """Return the coordinates that stops and sticking frictions hold; None if a friction is not one."""
        return self.right.mode.locked(self.equations, self.contacts.indices(self.right.mode))

    def _motion_in_c(
        self, model: CompiledModel, locked: Sequence[int], duration: float
    ) -> tuple[Outcome, str] | None:
        """Step in C as `_smooth_motion`, until an event, the end of the run, or where numpy must continue.

        `locked` are the coordinates that stops and sticking frictions hold.
        """
        self.executed, self.passing = "C", True
        limits, mode = (self.longest, self.equations.rank, self.nearest_pivot()), self.right.mode
        start = evaluated(model, self.state[None], np.array([self.time]), mode, locked)
        scale = scale_of(self.layout, start, self.fastest, self.duration, self.displacement)
        scale, energy = self._with_energies(scale), self.balance.initial
        how = self.tolerance, scale, self.origin, *limits
        settings = StepSettings(*how, mode, locked, self.implicit, self.watched)
        eventful = bool(self.contacts.stops or self.equations.frictions or mode.phases)
        max_steps, length = FEW_STEPS if eventful else SOME_STEPS if self.ends else MANY_STEPS, 0.0
        while self.time < duration:
            balance = (self.balance.correction, self.balance.largest, self.balance.drift, self.fastest)
            steps = integrated(
                model, settings, self.time, self.state, duration, max_steps, energy, balance, length
            )
            self.right.evaluations += steps.evaluations
            if steps.solution is not None:
                kind = self._accept_steps(steps, steps.solution, locked)
                self.progress(f"{self.time:.4g} s", min(1.0, self.time / self.duration))
                if ended := self._beyond_stop() or self._budget_spent():
                    return ended
                if kind is not None:
                    self.passing = False
                    return self._after_event(kind)
            if steps.status in (BLOCKED, FAILED):
                return None
            length, max_steps = steps.length, min(2 * max_steps, MANY_STEPS)
        return None

    def _accept_steps(self, steps: StepsInC, solution: DenseSteps, locked: Sequence[int]) -> str | None:
        """Accept steps in C up to their end or their first event; return the kind of the event."""
        event, mode = self._first_event(solution, self.time, steps.time), self.right.mode
        last, count = (steps.time if event is None else event[0]), len(steps.balances)
        self.pieces.append(Piece(self.time, last, solution, mode, self.contacts.indices(mode)))
        self.time, self.state = last, steps.state
        if event is not None:
            count = max(int(np.searchsorted(solution.starts, last)) - 1, 0)
        self.steps += count
        if count:
            self.balance.correction, self.balance.largest, self.balance.drift, self.fastest = (
                float(value) for value in steps.balances[count - 1]
            )
        if event is None:
            return None
        self._project(solution(last), locked)
        return event[1]

    def _solver(self, duration: float) -> GaussCollocation:
        """Return the integrator of smooth motion."""
        # forces over time may be short pulses
        longest = np.inf if self.equations.steady else self.duration / LEAST_STEPS
        jacobians = self._jacobians if self.implicit else None
        start = self.time, self.state, duration, self.tolerance, self._scale(), self.origin
        return GaussCollocation(self.right.derivatives, *start, longest, jacobians)

    def _resolving(self) -> float:
        """Return the longest step in [s] that resolves Stribeck's curves."""
        curves = np.array([item.friction.stribeck for item in self.equations.frictions])
        if not curves.any():
            return np.inf
        state, times = self.kinematics(), np.array([self.time])
        moved = self.contacts.accelerate(state, times, self.right.mode).acceleration
        changes = np.abs(self.equations.friction_accelerations(state, moved)[:, 0])
        beyond = 0.5 * (np.abs(self.equations.friction_rates(state)[:, 0]) - STRIBECK_RANGE * curves)
        limited = (curves > 0.0) & (changes > 0.0)
        return float((np.maximum(curves, beyond)[limited] / changes[limited]).min(initial=np.inf))

    def _jacobians(self, times: Array, states: Array) -> Array:
        return self.right.jacobians(times, states, max(self.fastest, 1.0))

    def _smooth_motion(self, solver: GaussCollocation) -> tuple[Outcome, str] | None:
        """Step until an event changes the mode or the run ends; None if the run continues."""
        longest = solver.max_step
        while solver.status != "finished":
            self.right.blocked, self.right.nearest = False, self.nearest
            solver.max_step = min(longest, self._resolving())
            message = solver.step()
            self.right.nearest = 0.0
            self.steps += 1
            if self.right.blocked and self._approaches_singular():
                return self._cross(solver.t_bound)
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                if self.right.unsolved is not None:
                    raise self.right.unsolved
                return "diverged", f"the integrator found no step at {self.time:.6g} s ({message})"
            kind = self._accept(solver.dense_output(), float(solver.t), solver.y)
            self.progress(f"{self.time:.4g} s", min(1.0, self.time / self.duration))
            if ended := self._beyond_stop() or self._budget_spent():
                return ended
            if kind is not None:
                return self._after_event(kind)
            if self.nearest < self.regular and self.right.conditioning(self.state) > CLOSE * self.regular:
                self.nearest = self.regular
            if self.passing and self.right.conditioning(self.state) > CLOSE * self.regular:
                self.passing = False
                return None
            solver.y = self.state.copy()
        return None

    def _accept(self, solution: StepSolution, after: float, state: Array) -> str | None:
        """Accept a step up to its end or its first event, and project the state.

        Return the kind of the event; None without an event.
        """
        event, mode = self._first_event(solution, self.time, after), self.right.mode
        last = after if event is None else event[0]
        self.pieces.append(Piece(self.time, last, solution, mode, self.contacts.indices(mode)))
        self.time = last
        self._project(state if event is None else solution(last))
        return None if event is None else event[1]

    def _project(self, state: Array, locked: Sequence[int] | None = None) -> None:
        """Take a state at the present time, projected onto the loops and the balance of energy.

        C does it with the coordinates `locked` that stops and sticking frictions hold, if there are any.
        """
        times, energies = np.array([self.time]), None
        if self.compiled is not None and locked is not None and not self.equations.prescribed:
            in_c = evaluated(self.compiled, state[None], times, self.right.mode, locked, closing=True)
            if np.isfinite(in_c.derivatives).all():
                state, energies = in_c.states[0], (float(in_c.kinetic[0]), float(in_c.potential[0]))
        if energies is None:
            state = self.right.nearest_on_loops(times, state[None])[0]
        q, rates, work, lost = self.layout.unpack(state)
        if not (self.implicit or self.equations.prescribed):
            energies = energies or self.equations.energy(self.equations.kinematics(q, rates))
            rates = self.balance.balanced(rates, *energies, work - lost)
        self.fastest = max(self.fastest, float(np.abs(rates).max(initial=0.0)))
        self.state = self.layout.replaced(state[None], q, rates)[0]

    def _after_event(self, kind: str) -> tuple[Outcome, str] | None:
        """Change rates and mode at an event; return the outcome if the run ends."""
        if kind != MODE:
            self.event = kind
            return "done", ""
        self.events.append(self.time)
        self._impact()
        before = self.right.mode
        self._choose_mode()
        if before.phases != self.right.mode.phases:
            # a stop may have a strong damper
            self._find_stiffness(self.duration)
            return self._too_stiff() or self._at_rest()
        return self._at_rest()

    def _choose_mode(self) -> None:
        before, state = self.right.mode.phases, self.kinematics()
        rates = self.contacts.rates_at_rest(state, self.fastest)
        if rates is not state.rates:
            self.state = self.layout.replaced(self.state[None], state.q, rates)[0]
        self.right.mode = self.contacts.choose(self.kinematics(), self.time, self.fastest, before)
        if self.right.mode.contacts:
            # a contact may be slow instead of at rest
            self.state = self.right.nearest_on_loops(np.array([self.time]), self.state[None])[0]

    def _budget_spent(self) -> tuple[Outcome, str] | None:
        """Return the outcome if the run has evaluated too many states, or would by far."""
        evaluated, remedy = self.right.evaluations, "a larger budget"
        if evaluated <= self.budget:
            needed = evaluated * self.duration / max(self.time, np.finfo(float).tiny)
            # the steps of a start grow threefold each
            growing = self.pieces[len(self.pieces) // 2].first < 0.25 * self.time
            if evaluated < EARLY or needed < HOPELESS * self.budget or growing:
                return None
            remedy = f"weaker forces, since {self.duration:g} s at this pace need {needed:.1g} states"
        states = min(evaluated, self.budget)
        tables = [profile.value for profile in self.equations.model.forces.load_profiles]
        rows = sum(len(each.spline.c) for each in tables if isinstance(each, Interpolated))
        if rows > MANY_ROWS:
            remedy += f", or fewer than the {rows:,} rows of load tables, each of which ends a step"
        events = several(len(self.events), "impact or change", "impacts and changes")
        return "work budget spent", (
            f"{self.steps:,} steps with {events} of friction evaluate "
            f"{states:,} states by {self.time:.6g} s; give a shorter duration or {remedy}"
        )

    def _too_stiff(self) -> tuple[Outcome, str] | None:
        """Return the outcome if friction, dampers or controllers decay too fast."""
        if self.decay * self.duration <= MAX_STIFFNESS:
            return None
        return "too stiff", (
            f"viscous friction, dampers or controllers slow motions down within {1.0 / self.decay:.1g} s, "
            f"below {self.duration / MAX_STIFFNESS:.1g} s, the least in a run of {self.duration:g} s; reduce "
            "them, or lock the joint that they hold"
        )

    def _beyond_stop(self) -> tuple[Outcome, str] | None:
        """Return the outcome if a joint is beyond its stop, or a spring beyond its table."""
        if beyond := self.contacts.beyond_tables(self.kinematics()):
            return "failed", f"{beyond} at {self.time:.6g} s; extend the table"
        gaps = self.contacts.gaps(self.state[: self.layout.count, None])
        if not len(gaps) or gaps.min() >= -CLOSED_GAP:
            return None
        stop = self.contacts.stops[int(gaps.argmin())]
        (name,) = (name for name, i in self.equations.loops.tree.index_of.items() if i == stop.index)
        beyond = -gaps.min() * self.equations.loops.units[stop.index]
        return "failed", f"{name} is {beyond:.3g} beyond its stop at {self.time:.6g} s"

    def kinematics(self) -> Kinematics:
        """Return constraints and links at the present state, which are evaluated once."""
        if self.at_state[0] is not self.state:
            self.at_state = self.state, self.right.kinematics(self.state[None])
        return self.at_state[1]

    def _approaches_singular(self) -> bool:
        """Return whether the last piece approaches a singular configuration."""
        if not self.pieces:
            return False
        conditioning, before = self.right.conditioning(self.state), self._conditioning_before()
        return conditioning <= CLOSE * self.nearest and before > conditioning

    def _conditioning_before(self) -> float:
        """Return the smallest singular value of the loop constraints at the start of the last piece."""
        piece = self.pieces[-1]
        return self.right.conditioning(piece.solution(piece.solution.start))

    def _cross(self, duration: float) -> tuple[Outcome, str] | None:
        """Cross a singular configuration; if the path only passes near one, permit steps closer to it.

        Return the outcome if the run ends during the crossing; a duration in [s] limits it.
        """
        piece, conditioning = self.pieces[-1], self.right.conditioning(self.state)
        approach = (
            (piece.last - piece.solution.start) * conditioning / (self._conditioning_before() - conditioning)
        )
        solution = crossing(self.right, self.time, self.state, approach, piece.solution.beyond)
        if solution is None:
            self.nearest *= NEARER
            return None
        last = min(self.time + solution.duration, duration)
        kind = self._accept(solution, last, solution(last))
        self.nearest = min(self.regular, self.right.conditioning(self.state) / CLOSE)
        return None if kind is None else self._after_event(kind)

    def _scale(self) -> Array:
        """Return the scale of a state: of displacements, rates, and energies if implicit."""
        kinematics = self.kinematics()
        acceleration = self.contacts.accelerate(
            kinematics, np.array([self.time]), self.right.mode
        ).acceleration
        largest = float(np.abs(acceleration).max(initial=0.0))
        rate = self.layout.fastest(self.fastest, largest, self.duration, self.displacement)
        return self._with_energies(self.layout.scale(rate, self.displacement))

    def _with_energies(self, scale: Array) -> Array:
        """Return the scale of a state with that of work and loss, which count unless rates balance them."""
        if self.implicit or self.equations.prescribed:
            rate = float(scale[self.layout.positions])
            scale[-2:] = float(np.trace(self.kinematics().mass[0])) * rate**2
        return scale

    def _first_event(
        self, dense: StepSolution | DenseSteps, before: float, after: float
    ) -> tuple[float, str] | None:
        """Return the instant and kind of the first event between two instants."""
        functions = [*self.ends.items()]
        functions += [(MODE, function) for function in self.contacts.end_functions(self.right.mode)]
        if not (functions or self.contacts.stops):
            return None
        times = search_instants(dense, before, after)
        event = first_event(functions, lambda times: self.right.kinematics(dense(times)), times)
        hit = self._first_hit(dense, times) if self.contacts.stops else None
        if hit is None or (event is not None and event[0] <= hit + _simultaneous(times)):
            return event
        return hit, MODE

    def _first_hit(self, dense: StepSolution | DenseSteps, times: Array) -> float | None:
        """Return the first instant at which a joint hits a stop, searched at instants (n,) in [s]."""
        rates = slice(self.layout.positions, None)
        states = dense(times).T
        speeds = self.contacts.gap_rates(states[rates])
        # a gap that is wider than it changes between two instants stays open
        change = 2.0 * np.abs(speeds).max(-1, initial=0.0) * np.diff(times).max()
        reached = self.contacts.gaps(states).min(-1, initial=np.inf) <= change
        hits = [
            closing_instant(
                lambda instants, i=i: self.contacts.gaps(dense(instants).T)[i],
                lambda instants, i=i: self.contacts.gap_rates(dense(instants)[:, rates].T)[i],
                times,
            )
            for i in np.flatnonzero(reached)
            if i not in self.right.mode.contacts
        ]
        return min((hit for hit in hits if hit is not None), default=None)

    def _impact(self) -> bool:
        """Apply the impacts of the joints that hit their stops; return whether there are any."""
        state = self.kinematics()
        q, rates = state.q, state.rates
        after, work = self.contacts.rates_after_impact(state, self.time, self.right.mode, self.fastest)
        if after is rates:
            return False
        mass = state.mass
        free = self.equations.free
        before, new = (kinetic_energy(mass, value[free].T)[0] for value in (rates, after))
        if new > before * (1.0 + IMPACT_ROUNDING) and not self.equations.prescribed:
            raise JammedError("impacts of joints with different coefficients of restitution add energy")
        self.state = self.layout.replaced(self.state[None], q, after)[0]
        self.state[-2:] += work, float(before - new) + work
        return True

    def _at_rest(self) -> tuple[Outcome, str] | None:
        """Return the outcome if friction and stops hold the mechanism permanently at rest; else None."""
        mode = self.right.mode
        if not (mode.stuck or mode.contacts) or not self.equations.steady:
            return None
        state, fastest = self.kinematics(), max(self.fastest, 1e-9)
        resting, released = (
            self.contacts.accelerate(state, np.array([self.time]), other).acceleration[:, 0]
            for other in (mode, ContactMode(mode.sliding, phases=mode.phases))
        )
        # rounding of the same force accelerates a light link more: accelerations count by the masses
        mass, index = state.mass, self.equations.free
        rounding, free = (kinetic_energy(mass, each[index][None])[0] for each in (resting, released))
        still = np.abs(state.rates).max(initial=0.0) <= 10.0 * REST * fastest
        if still and (np.abs(resting).max(initial=0.0) <= 1e-9 * fastest**2 or rounding < AT_REST**2 * free):
            constant = StepSolution.constant(self.time, self.state)
            self.pieces.append(Piece(self.time, self.time, constant, mode, self.contacts.indices(mode)))
            holding = ["friction"] * bool(mode.stuck) + ["stops"] * bool(mode.contacts)
            cause = " and ".join(holding) + (" holds" if holding == ["friction"] else " hold")
            return "stopped", f"{cause} the mechanism at rest from {self.time:.6g} s on"
        return None


def search_instants(solution: StepSolution | DenseSteps, before: float, after: float) -> Array:
    """Return the instants between two instants in [s] at which events of a solution are searched, (n,)."""
    if isinstance(solution, StepSolution):
        return before + (after - before) * INSTANTS
    knots = solution.knots
    within = WITHIN if solution.degree < STIFF_NODES else WITHIN_STIFF
    inner = knots[:-1, None] + np.diff(knots)[:, None] * np.arange(1, within + 1) / within
    early = knots[0] + (knots[1] - knots[0]) * INSTANTS[: int(np.searchsorted(INSTANTS, 1.0 / within))]
    return np.clip(np.concatenate([early, inner.ravel()]), before, after)


def _simultaneous(times: Array) -> float:
    """Return the difference in [s] of simultaneous events that are searched between instants."""
    return SIMULTANEOUS * float(np.diff(times).max())


def first_event(
    functions: Sequence[tuple[str, EventFunction]], states_at: Callable[[Array], Kinematics], times: Array
) -> tuple[float, str] | None:
    """Return the instant in [s] and kind of the first event; None without an event.

    It is searched between instants (n,) in [s].

    Functions of kind `UNTIL` may cross zero in both directions, others only downwards. Of simultaneous events
    the first of the functions counts.
    """
    if not functions:
        return None
    states, first = states_at(times), None
    for kind, function in functions:
        values = np.atleast_2d(function(states, times))
        low, high = values[:, :-1], values[:, 1:]
        crosses = (low > 0.0) & (high <= 0.0)
        if kind == UNTIL:
            crosses |= (low < 0.0) & (high >= 0.0)
        earliest = np.argmax(crosses, 1)
        for row in sorted(np.flatnonzero(crosses.any(1)).tolist(), key=lambda row: earliest[row]):
            around = slice(earliest[row], earliest[row] + 2)
            before, after = times[around].tolist()
            if first is not None and before > first[0]:
                break
            samples = dict(zip((before, after), values[row, around].tolist(), strict=True))

            def value(time: float, function: Any = function, row: int = row, samples: Any = samples) -> float:
                if time in samples:
                    return samples[time]
                instants = np.array([time])
                return float(np.atleast_2d(function(states_at(instants), instants))[row, 0])

            instant = _zero_between(value, before, after)
            if first is None or instant < first[0] - _simultaneous(times):
                first = (instant, kind)
    return first


def _zero_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero between two instants; the one with the smaller value if rounding changes its sign."""
    values = function(low), function(high)
    if values[0] * values[1] < 0.0:
        return root(function, low, high)
    return low if abs(values[0]) <= abs(values[1]) else high
