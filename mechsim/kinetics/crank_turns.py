"""The end of a run of forward dynamics after revolutions of the crank."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mechsim.errors import InputError
from mechsim.kinetics.applied_forces import applied, loads
from mechsim.kinetics.contacts import EventFunction
from mechsim.kinetics.equations_of_motion import EquationsOfMotion, Kinematics
from mechsim.kinetics.forward_dynamics import BUDGET, Integration, Trajectory
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.reduced_equation import reduced_coefficients
from mechsim.mechanism.finding import Outcome
from mechsim.numerics.arrays import REVOLUTION, Array

# time limit of a run that has a number of revolutions but no duration, relative to its expected time
PATIENCE = 100.0
# work budget: many revolutions of one crank are asked for by their number
TURNS_BUDGET = 20 * BUDGET
# rounding: angle in [rad] of a crank that has not moved, and speed of a crank at rest relative to the mean
MOVED, SLOW = 1e-9, 1e-9


@dataclass(frozen=True, slots=True)
class CrankTurns:
    """Revolutions of the crank that end a run.

    Attributes:
        equations: equations of motion.
        crank: index of the crank's coordinate.
        turns: number of revolutions; negative for backwards.
        start: initial crank angle in [rad].
        speed: initial crank speed in [rad/s].
    """

    equations: EquationsOfMotion
    crank: int
    turns: float
    start: float
    speed: float

    @classmethod
    def from_state(cls, equations: EquationsOfMotion, turns: float, state: Kinematics) -> CrankTurns:
        """Return the revolutions from an initial state.

        Raises:
            InputError: for a mechanism without a crank, or a number of revolutions that is not finite or 0.
        """
        crank = equations.loops.tree.index_of[equations.model.mechanism.crank.name]
        if not 0.0 < abs(turns) < np.inf:
            raise InputError(f"turns of the crank are {turns}; give a finite number other than 0")
        return cls(equations, crank, turns, float(state.q.values[crank, 0]), float(state.rates[crank, 0]))

    def trajectory(self, integration: Integration, duration: float | None) -> Trajectory:
        """Return the trajectory to the last revolution, or to a time in [s], with its outcome."""
        expected = self.expected_time(integration.kinematics()) if duration is None else duration
        latest = PATIENCE * expected if duration is None else duration
        distance = REVOLUTION * abs(self.turns)
        watched = self.crank, self.start - distance, self.start + distance
        trajectory = integration.run(latest, self.functions(expected), expected, watched)
        outcome, reason = self.outcome(trajectory, integration.kinematics(), latest)
        return replace(trajectory, outcome=outcome, reason=reason)

    def functions(self, expected: float) -> dict[str, EventFunction]:
        """Return end -> function that falls through zero there; `expected` is the time of the run in [s]."""
        sign, distance = float(np.sign(self.turns)), REVOLUTION * abs(self.turns)

        def travelled(state: Kinematics) -> Array:
            return sign * (state.q.values[self.crank] - self.start)

        ends: dict[str, EventFunction] = {
            "turns": lambda state, _: distance - travelled(state),
            "backwards": lambda state, _: distance + travelled(state),
        }
        if self.equations.steady:
            # the crank never passes its reversal, as lost energy does not come back. A crank that friction
            # holds there never turns back at this speed
            slow = SLOW * distance / expected

            def forwards(state: Kinematics, _: Array) -> Array:
                rate = sign * state.rates[self.crank]
                at_start = (np.abs(travelled(state)) <= MOVED) & (np.abs(rate) <= 10.0 * slow)
                return np.where(at_start, -slow, rate + slow)

            ends["turned back"] = forwards
        return ends

    def expected_time(self, state: Kinematics) -> float:
        """Return the expected time in [s] of the revolutions, from the initial acceleration and the motor."""
        none = np.zeros(len(self.equations.frictions))
        acceleration = self.equations.accelerate(state, np.zeros(1), none).acceleration[self.crank]
        speed = max(abs(self.speed), float(np.sqrt(np.abs(acceleration[0]))))
        motor = self.equations.model.forces.motor
        if motor is not None:
            speed = min(speed, abs(motor.no_load))
        return REVOLUTION * (1.0 + abs(self.turns)) / max(speed, 1e-6)

    def outcome(self, trajectory: Trajectory, state: Kinematics, latest: float) -> tuple[Outcome, str]:
        """Return outcome and reason of a run that ended in a state; `latest` is its time limit in [s]."""
        if trajectory.outcome not in ("done", "stopped"):
            return trajectory.outcome, trajectory.reason
        angle, time = float(state.q.values[self.crank, 0]), trajectory.end
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
