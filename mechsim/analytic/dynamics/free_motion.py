"""Free motion of a crank: pieces of DOP853 solutions between rests, reversals and the end."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.dynamics.applied_forces import dry_sizes
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.reduced_equation import CrankTable
from mechsim.errors import AssemblyError, InputError
from mechsim.model.finding import Outcome
from mechsim.model.force_record import FreeRun
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import root

# time limit of a run that has a number of revolutions but no duration, relative to its estimated time
PATIENCE = 1000.0
# largest number of rests in a run
MAX_RESTS = 10_000
# net torque relative to its largest term below which it is rounding
BALANCED = 1e-12
# distance from the start beyond which a trial step is rejected: revolutions past the requested ones, and
# [rad] for a run without them
PAST, BEYOND_RUN = 2.0, 1e9
# number of the motor's time constants per revolution above which the equation is stiff: stability then limits
# the step of an explicit method
STIFF = 2e4
# Newton steps from an approximate event time to the exact one
LANDINGS = 3
# instants at which a crank at rest under loads over time is tested for a start
PROBES = 512


class Runner:
    """State of a free run: pieces of solution between events."""

    def __init__(
        self, model: DynamicModel, angle: float, speed: float, turns: float | None, tolerance: float
    ) -> None:
        forces = model.forces
        self.model, self.forces = model, forces
        self.chart = CrankTable(model)
        joints = {joint.name: joint for joint in model.mechanism.joints}
        self.dry = np.array(
            [
                magnitude
                for friction in forces.friction
                for magnitude in dry_sizes(joints[friction.joint], friction)
            ]
        )
        self.pushes = [
            *(load.force for load in forces.loads),
            *(friction.moment for friction in forces.couples),
        ]
        self.steady = not any(course.over == "time" for course in forces.load_profiles)
        self.start, self.turns, self.tolerance = angle, turns, tolerance
        self.reach = BEYOND_RUN if turns is None else REVOLUTION * (PAST + abs(turns))
        self.time, self.state = 0.0, np.array([angle, speed, 0.0, 0.0])
        self.from_rest = speed == 0.0
        self.barred: float | None = None
        self.bar = ""
        self.pieces: list[tuple[float, float, float, Callable[[Array], Array]]] = []

    def terms(self, time: float, angle: float, speed: float) -> tuple[float, ...]:
        """Return J, J', static torque, damping, Coulomb friction, and driving torque at a state."""
        row = self.chart.evaluate(angle)
        inertia, derivative, static, _, damping = row[:5].tolist()
        k = len(self.dry)
        dry = float(np.abs(row[5 : 5 + k]) @ self.dry) if k else 0.0
        torque = 0.0
        if self.forces.motor is not None:
            torque += float(self.forces.motor.torque(speed))
        if self.forces.crank_torque is not None:
            torque += float(self.forces.crank_torque.evaluate(angle, time)[0])
        for i, push in enumerate(self.pushes):
            torque += float(push.evaluate(angle, time)[0] @ row[5 + k + 3 * i : 8 + k + 3 * i])
        return inertia, derivative, static, damping, dry, torque

    def rates(self, sign: float) -> Callable[[float, Array], Array]:
        """Return the right-hand side for one direction of crank motion."""

        def rate(time: float, state: Array) -> Array:
            angle, speed = float(state[0]), float(state[1])
            beyond = self.barred is not None and (angle - self.barred) * sign >= 0.0
            if beyond or not np.isfinite(state).all() or abs(angle - self.start) > self.reach:
                return np.full(4, np.nan)
            try:
                inertia, derivative, static, damping, dry, torque = self.terms(time, angle, speed)
            except AssemblyError as error:
                # the integrator then shortens its step until it ends before the dead centre
                self.barred, self.bar = angle, str(error)
                return np.full(4, np.nan)
            force = static - damping * speed - sign * dry + torque
            acceleration = (force - 0.5 * derivative * speed**2) / inertia
            return np.array([speed, acceleration, torque * speed, (damping * speed + sign * dry) * speed])

        return rate

    def jacobian(self, sign: float) -> Callable[[float, Array], Array]:
        """Return the Jacobian of the right-hand side by the state, for an implicit method.

        Derivatives by the speed, which the motor makes large, are exact. Derivatives by the angle include the
        change of inertia only, which suffices for Newton's method. Derivatives by work and losses are zero;
        for them scipy's own finite differences enlarge the increment until it overflows.
        """

        def derivatives(_: float, state: Array) -> Array:
            time, angle, speed = self.time, float(state[0]), float(state[1])
            inertia, derivative, static, damping, dry, torque = self.terms(time, angle, speed)
            motor = self.forces.motor
            steeper = 0.0 if motor is None else float(motor.derivative)
            force = static - damping * speed - sign * dry + torque - 0.5 * derivative * speed**2
            matrix = np.zeros((4, 4))
            matrix[0, 1] = 1.0
            matrix[1, 1] = (steeper - damping - derivative * speed) / inertia
            matrix[1, 0] = -force * derivative / inertia**2
            matrix[2, 1] = torque + steeper * speed
            matrix[3, 1] = 2.0 * damping * speed + sign * dry
            return matrix

        return derivatives

    def run(self, duration: float | None) -> tuple[Outcome, str]:
        """Run until an end; return the outcome and reason."""
        try:
            end = self._patience() if duration is None else duration
            for _ in range(MAX_RESTS):
                over = self._piece(end)
                if over is not None:
                    return over
        except AssemblyError as error:
            return "dead centre", str(error)
        return "stopped", f"the crank came to rest {MAX_RESTS} times; give fewer turns or less time"

    def _piece(self, end: float) -> tuple[Outcome, str] | None:
        """Run to the next rest or end; None if the run continues."""
        sign = float(np.sign(self.state[1]))
        if sign == 0.0:
            sign = self._direction(end)
            if sign == 0.0:
                return self._at_rest(end)
        if self.time >= end:
            return self._timed_out(end)
        events: list[Any] = [_event(1, 0.0, -sign)]
        if self.turns is not None:
            events.append(_event(0, self.start + REVOLUTION * self.turns, float(np.sign(self.turns))))
            events.append(_event(0, self.start - REVOLUTION * self.turns, -float(np.sign(self.turns))))
        inertia, *_ = self.terms(self.time, float(self.state[0]), float(self.state[1]))
        speed = max(abs(float(self.state[1])), 1.0)
        floor = self.tolerance * np.array([1.0, speed, inertia * speed**2, inertia * speed**2])
        finished = self._solved(sign, end, floor, events, inertia)
        if len(finished.t) > 1:
            self.pieces.append((self.time, float(finished.t[-1]), sign, finished.sol))
        self.time, self.state = float(finished.t[-1]), finished.y[:, -1].copy()
        if finished.status < 0:
            return "dead centre", self.bar or f"the crank cannot be followed beyond {self.time:.6g} s"
        if self.turns is not None and len(finished.t_events[1]):
            self._land(finished.sol, self.start + REVOLUTION * self.turns)
            return "done", ""
        if self.turns is not None and len(finished.t_events[2]):
            made = f"the crank made {self.turns:g} turns the other way round"
            reason = f"{made}; give a drive of the other sign, or {-self.turns:g} turns"
            return ("cannot start" if self.from_rest else "turned back"), reason
        if len(finished.t_events[0]):
            self.state[1] = 0.0
            return self._turning_back(sign)
        return self._timed_out(end)

    def _land(self, solution: Any, end: float) -> None:
        """Set the time at which the crank reaches its final angle.

        The event time is exact to 1e-15 s, which may be a large fraction of a run under an oversized motor.
        """
        first, _, sign, _ = self.pieces[-1]
        for _ in range(LANDINGS):
            if self.state[1] != 0.0:
                self.time += (end - float(self.state[0])) / float(self.state[1])
                self.state = solution(self.time)
        self.pieces[-1] = first, self.time, sign, solution

    def _solved(self, sign: float, end: float, floor: Array, events: list[Any], inertia: float) -> Any:
        """Return the solution up to the next event, by DOP853, or by Radau's method if it is stiff."""
        from scipy.integrate import solve_ivp

        def by(method: str, **more: Any) -> Any:
            return solve_ivp(
                self.rates(sign),
                (self.time, end),
                self.state,
                method=method,  # pyright: ignore[reportArgumentType]
                rtol=self.tolerance,
                atol=floor,
                dense_output=True,
                events=events,
                **more,
            )

        if self._is_stiff(inertia):
            # an implicit method raises ValueError for NaN beyond a dead centre and does not shorten its step
            with suppress(ValueError):
                return by("Radau", jac=self.jacobian(sign))
        return by("DOP853")

    def _is_stiff(self, inertia: float) -> bool:
        motor = self.forces.motor
        if motor is None or motor.derivative == 0.0:
            return False
        return (
            abs(motor.derivative) / inertia * REVOLUTION / max(abs(motor.no_load), abs(float(self.state[1])))
            > STIFF
        )

    def _direction(self, end: float) -> float:
        """Return the sign of the motion from rest; 0 if Coulomb friction or equilibrium prevents motion.

        Under loads over time the crank stays at rest until they move it, or until the end.
        """
        angle = float(self.state[0])

        def excess(time: float) -> float:
            _, _, static, _, dry, torque = self.terms(time, angle, 0.0)
            small = BALANCED * max(abs(static), abs(torque), dry)
            return abs(static + torque) - dry - small

        _, _, static, _, _, torque = self.terms(self.time, angle, 0.0)
        if excess(self.time) > 0.0:
            return float(np.sign(static + torque))
        if self.steady:
            return 0.0
        before = self.time
        for later in np.linspace(self.time, end, PROBES)[1:]:
            if excess(float(later)) > 0.0:
                waited = excess(before) < 0.0
                self._rest_condition(root(excess, before, float(later)) if waited else before)
                _, _, static, _, _, torque = self.terms(float(later), angle, 0.0)
                return float(np.sign(static + torque))
            before = float(later)
        return 0.0

    def _rest_condition(self, until: Any) -> None:
        """Stay at rest until an instant."""
        state, until = self.state.copy(), float(until)
        self.pieces.append((self.time, until, 0.0, lambda times: np.tile(state[:, None], len(times))))
        self.time = until

    def _at_rest(self, end: float) -> tuple[Outcome, str]:
        """Return the outcome and reason of a run that ends at permanent rest."""
        angle = float(self.state[0])
        _, _, static, _, dry, torque = self.terms(self.time, angle, 0.0)
        if self.turns is None:
            self._rest_condition(end)
        reason = (
            f"at crank angle {angle:.6g} rad the drive and loads give {torque:.6g} N m and weight and "
            f"springs {static:.6g}, and dry friction holds up to {dry:.6g} N m"
        )
        if self.from_rest and angle == self.start:
            return "cannot start", reason
        return "stopped", reason

    def _turning_back(self, sign: float) -> tuple[Outcome, str] | None:
        """Return the outcome after a reversal; without forces over time the crank never passes that angle."""
        if self.turns is None or not self.steady or sign * self.turns < 0.0:
            return None
        if not self._direction(self.time):
            return None
        made = (float(self.state[0]) - self.start) / REVOLUTION
        reason = (
            f"the crank turns back at {self.state[0]:.6g} rad, {made:.3g} turns from its start; "
            "nothing it loses on the way comes back, so that it never gets beyond: give more torque or speed"
        )
        return ("cannot start" if self.from_rest else "turned back"), reason

    def _timed_out(self, end: float) -> tuple[Outcome, str]:
        if self.turns is None:
            return "done", ""
        made = (float(self.state[0]) - self.start) / REVOLUTION
        return "time over", f"{made:.6g} of {self.turns:g} turns in {end:.6g} s"

    def _patience(self) -> float:
        """Return a time limit far above the time of the requested revolutions."""
        assert self.turns is not None
        inertia, _, static, _, _, torque = self.terms(0.0, self.start, float(self.state[1]))
        speed = max(abs(float(self.state[1])), float(np.sqrt((abs(static) + abs(torque)) / inertia)))
        motor = self.forces.motor
        if motor is not None:
            speed = min(speed, abs(motor.no_load))
        return PATIENCE * REVOLUTION * (1.0 + abs(self.turns)) / max(speed, 1e-6)

    def sample(self, times: Array) -> tuple[Array, Array, Array, Array]:
        """Return the states of the run at instants (n,) in [s], from 0 to its end.

        Returns:
            Angle, speed, work and losses, (4, n); crank acceleration, inertia and potential energy, (n,)
            each; all in SI.
        """
        states = np.tile(self.state[:, None], len(times))
        signs = np.zeros(len(times))
        for first, last, sign, solution in self.pieces:
            within = (times >= first) & (times <= last)
            if within.any():
                states[:, within] = solution(times[within])
                signs[within] = sign
        rows = [self.chart.evaluate(angle) for angle in states[0].tolist()]
        acceleration = [
            self.rates(sign)(time, state)[1] if sign else 0.0
            for time, state, sign in zip(times.tolist(), states.T, signs.tolist(), strict=True)
        ]
        inertia, energy = np.array([row[0] for row in rows]), np.array([row[3] for row in rows])
        return states, np.array(acceleration), inertia, energy


def _event(index: int, level: float, direction: float) -> Any:
    def crossing(time: float, state: Array) -> float:
        return float(state[index]) - level

    crossing.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    crossing.direction = direction  # pyright: ignore[reportFunctionMemberAccess]
    return crossing


# relative tolerance of DOP853. At 1e-12 the error estimate of a step happens to vanish in 2 of 12 runs of the
# squeezer that differ by rounding; the step is then too long and costs one digit of ten. At 3e-13 none does
TOLERANCE = 3e-13


def free_run(
    model: DynamicModel,
    *,
    angle: float | str | None = None,
    speed: float | str = 0.0,
    turns: float | None = None,
    duration: float | str | None = None,
    times: ArrayLike | None = None,
    samples: int = 721,
    tolerance: float = TOLERANCE,
) -> FreeRun:
    """Integrate the free motion of a crank from an angle and speed, in SI or as text, such as "600rpm".

    Coulomb friction holds a crank at rest until the driving torque exceeds it. Every rest and reversal is an
    event that ends a step.

    Args:
        model: the dynamic model.
        angle: initial crank angle in [rad]; the default is that of the assembled mechanism.
        speed: initial crank speed in [rad/s].
        turns: number of crank revolutions at which the run ends; negative for backwards.
        duration: time in [s] after which the run ends; give `duration`, `turns` or `times`.
        times: instants to record in [s], increasing from 0; None records `samples` evenly spaced instants.
        samples: number of recorded instants if no times are given.
        tolerance: relative tolerance of DOP853.

    Raises:
        InputError: if no end is given.

    Accuracy: crank angle about 1e-11 rad per revolution at the default tolerance; `energy_error` is the error
        of the energy balance.
    """
    model.forces.require_no_controllers(model.mechanism.name)
    angle, speed = units.si(angle, "rad", "the start angle"), units.si(speed, "rad/s", "the speed")
    duration = units.si(duration, "s", "the duration")
    instants = None if times is None else np.asarray(times, dtype=np.float64)
    if instants is not None:
        if len(instants) < 2 or instants[0] != 0.0 or not (np.diff(instants) > 0.0).all():
            raise InputError("instants of a free run must be two or more that rise from 0; give such")
        duration = float(instants[-1])
    for what, value in (("turns", turns), ("duration", duration), ("speed", speed)):
        if value is not None and not abs(value) < np.inf:
            raise InputError(f"{what} of a free run is {value}; give a finite number")
    if turns is None and (duration is None or not duration > 0.0):
        raise InputError("a free run needs turns of the crank, or a duration above 0, after which to end")
    first = model.mechanism.start if angle is None else angle
    model = model.starting_at([first], speed or turns or 1.0)
    runner = Runner(model, first, speed, turns, tolerance)
    outcome, reason = runner.run(duration)
    instants_to_record = np.linspace(0.0, runner.time, samples) if instants is None else instants
    times = instants_to_record[instants_to_record <= runner.time]
    (crank, rate, work, lost), acceleration, inertia, potential = runner.sample(times)
    return FreeRun(
        time=times,
        angle=crank,
        speed=rate,
        acceleration=acceleration,
        kinetic=0.5 * inertia * rate**2,
        potential=potential,
        work=work,
        lost=lost,
        motor=model.forces.motor_torque(rate),
        outcome=outcome,
        reason=reason,
    )
