"""Free motion of a crank: a run of forward dynamics that ends after revolutions of the crank."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.dynamics.applied_forces import applied, loads
from mechsim.analytic.dynamics.contacts import EventFunction, gap_stops
from mechsim.analytic.dynamics.dynamic_run import (
    TOLERANCE,
    DynamicRun,
    run_at,
    with_ranges_checked,
)
from mechsim.analytic.dynamics.equations_of_motion import EquationsOfMotion, Kinematics, equations_of_motion
from mechsim.analytic.dynamics.forward_dynamics import BUDGET, Integration, Trajectory
from mechsim.analytic.dynamics.gaps import with_gaps
from mechsim.analytic.dynamics.initial_state import InitialValues, initial_state
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.passive_rotation import with_determined_motion
from mechsim.analytic.dynamics.reduced_equation import reduced_coefficients
from mechsim.errors import InputError
from mechsim.model.bristle_friction import with_bristles
from mechsim.model.finding import Outcome
from mechsim.model.progress import Progress, no_progress
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array

# time limit of a run that has a number of revolutions but no duration, relative to its expected time
PATIENCE = 100.0
# work budget: many revolutions of one crank are asked for by their number
FREE_BUDGET = 20 * BUDGET
# rounding: angle in [rad] of a crank that has not moved, and speed of a crank at rest relative to the mean
MOVED, SLOW = 1e-9, 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeRun(DynamicRun):
    """A run of a free crank at n instants, in SI.

    Attributes:
        motor: torque of the motor on the crank, (n,) in [N m].
        outcome: "done" (made the requested turns or time), "time over" (fewer turns in the time), "cannot
            start" (did not move, or swung back before a full turn), "turned back" (ran, but did not
            make the turns), "stopped" (friction locks it), "dead centre", "diverged",
            "failed", "too stiff" or "work budget spent".
    """

    motor: Array

    @property
    def angle(self) -> Array:
        """Crank angle, not wrapped, (n,) in [rad]."""
        return self.motion.angle

    @property
    def speed(self) -> Array:
        """Crank speed, (n,) in [rad/s]."""
        return self.motion.speed

    @property
    def acceleration(self) -> Array:
        """Crank acceleration, (n,) in [rad/s2]."""
        return self.motion.acceleration

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the run as columns of a table in SI, with the torque of the motor."""
        yield from DynamicRun.columns(self)
        yield "motor", self.motor


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
    budget: int = FREE_BUDGET,
    progress: Progress = no_progress,
) -> FreeRun:
    """Integrate the free motion of a crank from an angle and speed, in SI or as text, such as "600rpm".

    The run ends after a number of revolutions of the crank or after a duration. Coulomb friction holds a
    crank at rest until the driving torque exceeds it.

    Args:
        model: the dynamic model.
        angle: initial crank angle in [rad]; the default is that of the assembled mechanism.
        speed: initial crank speed in [rad/s].
        turns: number of crank revolutions at which the run ends; negative for backwards.
        duration: time in [s] after which the run ends; give `duration`, `turns` or `times`.
        times: instants to record in [s], increasing from 0; None records `samples` evenly spaced instants.
        samples: number of recorded instants if no times are given.
        tolerance: relative error of an integration step.
        budget: largest number of states that the run evaluates; then it ends.
        progress: called after each integration step with a text and the finished fraction.

    Raises:
        InputError: if no end is given, and for forces on a motion that the crank does not determine.

    Accuracy: crank angle about 1e-11 rad per revolution at the default tolerance; `energy_error` is the error
        of the energy balance.
    """
    model.forces.require_no_controllers(model.mechanism.name)
    if with_bristles(model.forces) is not model.forces:
        raise InputError(
            f"{model.mechanism.name}: friction with bristles acts in runs from an initial state; give one "
            "(--initial J.q=VALUE), or leave bristle_stiffness out"
        )
    angle, speed = units.si(angle, "rad", "the start angle"), units.si(speed, "rad/s", "the speed")
    duration = units.si(duration, "s", "the duration")
    instants = None if times is None else _rising(times)
    if instants is not None:
        duration = float(instants[-1])
    _require_end(speed, turns, duration)
    first = model.mechanism.start if angle is None else angle
    model = model.starting_at([first], speed or turns or 1.0)
    name = model.mechanism.crank.name
    _require_determined(model, first)
    model = replace(model, mechanism=with_gaps(model.mechanism))
    equations = equations_of_motion(model, {name: first})
    q, rates = initial_state(equations, InitialValues({name: first}, {name: speed}))
    equations, rates = with_determined_motion(equations, q, rates)
    # the crank keeps away from the limits of joints, or the run fails
    integration = Integration(
        equations, q, rates, tolerance, tuple(gap_stops(equations)), progress=progress, budget=budget
    )
    crank = CrankEnds(equations, first, speed, turns)
    expected = crank.expected_time(integration.kinematics()) if duration is None else duration
    latest = PATIENCE * expected if duration is None else duration
    trajectory = integration.run(latest, crank.functions(expected), expected)
    # without a number of revolutions, a crank at rest is recorded up to the duration
    end = latest if trajectory.outcome == "stopped" and turns is None else trajectory.end
    if instants is None:
        instants = np.linspace(0.0, end, samples)
    run = run_at(equations, trajectory, instants[instants <= end])
    outcome, reason = crank.outcome(trajectory, integration.kinematics(), latest)
    values: dict[str, Any] = {field.name: getattr(run, field.name) for field in fields(run)}
    values |= {"outcome": outcome, "reason": reason}
    result = FreeRun(**values, motor=model.forces.motor_torque(run.motion.speed))
    return with_ranges_checked(result, model.mechanism, model.solver.ranges)


def _require_determined(model: DynamicModel, angle: float) -> None:
    """Raise InputError for forces that act on a motion that the crank does not determine, such as a spin."""
    unit = model.unit_motion([angle])
    applied(model, unit)
    loads(model, unit, np.zeros(1))


def _rising(times: ArrayLike) -> Array:
    """Return instants (n,) in [s]; raise InputError if they do not rise from 0."""
    instants = np.asarray(times, dtype=np.float64)
    if len(instants) < 2 or instants[0] != 0.0 or not (np.diff(instants) > 0.0).all():
        raise InputError("instants of a free run must be two or more that rise from 0; give such")
    return instants


def _require_end(speed: float, turns: float | None, duration: float | None) -> None:
    """Raise InputError for infinite values, or a run without an end."""
    for what, value in (("turns", turns), ("duration", duration), ("speed", speed)):
        if value is not None and not abs(value) < np.inf:
            raise InputError(f"{what} of a free run is {value}; give a finite number")
    if turns is None and (duration is None or not duration > 0.0):
        raise InputError("a free run needs turns of the crank, or a duration above 0, after which to end")


@dataclass(frozen=True, slots=True)
class CrankEnds:
    """Ends of a free run.

    Attributes:
        equations: equations of motion.
        start: initial crank angle in [rad].
        speed: initial crank speed in [rad/s].
        turns: number of revolutions at which the run ends; None for a run that ends by time only.
    """

    equations: EquationsOfMotion
    start: float
    speed: float
    turns: float | None

    @property
    def _crank(self) -> int:
        crank = self.equations.crank
        assert crank is not None
        return crank

    def functions(self, expected: float) -> dict[str, EventFunction]:
        """Return end -> function that falls through zero there; `expected` is the time of the run in [s]."""
        if self.turns is None:
            return {}
        sign, distance = float(np.sign(self.turns)), REVOLUTION * abs(self.turns)

        def travelled(state: Kinematics) -> Array:
            return sign * (state.q.values[self._crank] - self.start)

        ends: dict[str, EventFunction] = {
            "turns": lambda state, _: distance - travelled(state),
            "backwards": lambda state, _: distance + travelled(state),
        }
        if self.equations.steady:
            # the crank never passes its reversal, as lost energy does not come back. A crank that friction
            # holds there never turns back at this speed
            slow = SLOW * distance / expected

            def forwards(state: Kinematics, _: Array) -> Array:
                rate = sign * state.rates[self._crank]
                at_start = (np.abs(travelled(state)) <= MOVED) & (np.abs(rate) <= 10.0 * slow)
                return np.where(at_start, -slow, rate + slow)

            ends["turned back"] = forwards
        return ends

    def expected_time(self, state: Kinematics) -> float:
        """Return the expected time in [s] of the revolutions, from the initial acceleration and the motor."""
        assert self.turns is not None
        none = np.zeros(len(self.equations.frictions))
        acceleration = self.equations.accelerate(state, np.zeros(1), none).acceleration[self._crank]
        speed = max(abs(self.speed), float(np.sqrt(np.abs(acceleration[0]))))
        motor = self.equations.model.forces.motor
        if motor is not None:
            speed = min(speed, abs(motor.no_load))
        return REVOLUTION * (1.0 + abs(self.turns)) / max(speed, 1e-6)

    def outcome(self, trajectory: Trajectory, state: Kinematics, latest: float) -> tuple[Outcome, str]:
        """Return outcome and reason of a run that ended in a state; `latest` is its time limit in [s]."""
        if trajectory.outcome not in ("done", "stopped"):
            return trajectory.outcome, trajectory.reason
        angle, time = float(state.q.values[self._crank, 0]), trajectory.end
        if self.turns is None:
            stopped = trajectory.outcome == "stopped"
            return trajectory.outcome, _forces_at_rest(self.equations.model, angle, time) if stopped else ""
        made, from_rest = (angle - self.start) / REVOLUTION, self.speed == 0.0
        if trajectory.event == "turns":
            return "done", ""
        if trajectory.event == "backwards":
            reason = (
                f"the crank rotated {abs(self.turns):g} turns backwards; reverse the sign of the "
                f"torque, or give {-self.turns:g} turns"
            )
            return ("cannot start" if from_rest else "turned back"), reason
        if trajectory.event == "turned back":
            reason = (
                f"the crank turns back at {angle:.6g} rad, {made:.3g} turns from its start: its "
                "kinetic energy is used up there; increase the torque or the initial speed"
            )
            return ("cannot start" if from_rest else "turned back"), reason
        still = abs(angle - self.start) <= MOVED
        if trajectory.outcome == "stopped" or still:
            outcome = "cannot start" if from_rest and still else "stopped"
            return outcome, _forces_at_rest(self.equations.model, angle, time)
        return "time over", f"{made:.6g} of {self.turns:g} turns in {latest:.6g} s"


def _forces_at_rest(model: DynamicModel, angle: float, time: float) -> str:
    """Return the torques on a crank at rest at an angle in [rad] and a time in [s], as a sentence."""
    unit = model.unit_motion([angle])
    forces = reduced_coefficients(unit, applied(model, unit), model.forces.flywheel)
    torque = loads(model, unit, np.array([time]), 0.0).torque + model.forces.motor_torque(np.zeros(1))
    return (
        f"at crank angle {angle:.6g} rad the drive and loads give {torque[0]:.6g} N m and weight and "
        f"springs {forces.static[0]:.6g}, and dry friction holds up to {forces.coulomb[0]:.6g} N m"
        + (" besides friction by load or rate" if any(row.varies for row in model.forces.friction) else "")
    )
