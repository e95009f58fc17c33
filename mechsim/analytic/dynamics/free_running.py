"""Free running: the crank moves as the reduced equation says, by DOP853 at 1e-12."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.dynamics.free_run_events import Outcome, Runner
from mechsim.analytic.dynamics.machines import Machine
from mechsim.errors import InputError
from mechsim.model.motion import Motion

Array = NDArray[np.float64]

TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True)
class FreeRun:
    """A free run at n instants, in SI, and how it ended.

    Attributes:
        machine: what ran.
        time: (n,) in [s].
        angle: crank angle, not wrapped, (n,) in [rad].
        speed: (n,) in [rad/s].
        acceleration: (n,) in [rad/s2].
        kinetic: J w2 / 2, (n,) in [J].
        potential: of gravity and springs, (n,) in [J].
        work: done by motor and loads since the start, (n,) in [J].
        lost: in friction and dampers since the start, (n,) in [J].
        outcome: "done" (the turns or time asked for), "time over" (fewer turns in the time),
            "cannot start" (never left its place, or swung back without a turn), "turned back" (ran, but
            did not make the turns), "stopped" (friction holds it), "dead centre".
        reason: one sentence where the outcome is not "done".
    """

    machine: Machine
    time: Array
    angle: Array
    speed: Array
    acceleration: Array
    kinetic: Array
    potential: Array
    work: Array
    lost: Array
    outcome: Outcome
    reason: str = ""

    def __len__(self) -> int:
        return len(self.time)

    @property
    def imbalance(self) -> Array:
        """Energy there is less energy there should be, (n,) in [J]; zero by the law of energy."""
        total = self.kinetic + self.potential
        return total - total[0] - self.work + self.lost

    @property
    def energy_error(self) -> float:
        """Largest imbalance relative to the energy turned over."""
        size = max(np.ptp(self.kinetic), np.ptp(self.potential), np.abs(self.kinetic).max())
        size = max(float(size), float(np.abs(self.work).max()), float(self.lost.max()))
        return float(np.abs(self.imbalance).max()) / size if size > 0.0 else 0.0

    @property
    def motor_torque(self) -> Array:
        """Torque of the motor on the crank, (n,) in [N m]."""
        motor = self.machine.forces.motor
        return np.zeros(len(self)) if motor is None else motor.torque(self.speed)

    def motion(self) -> Motion:
        """Return the motion of all points, links and joints at these instants.

        Raises:
            InputError: for a machine without a closed form.
        """
        if self.machine.drive is None:
            raise InputError(
                f"{self.machine.mechanism.name} has no closed form; use closure.rates at the run's angles"
            )
        return self.machine.drive.solve(self.angle, self.speed, self.acceleration)

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the run as columns of a table in SI."""
        for name in ("time", "angle", "speed", "acceleration", "kinetic", "potential", "work", "lost"):
            yield name, getattr(self, name)
        yield "motor", self.motor_torque


def free_run(
    machine: Machine,
    *,
    angle: float | None = None,
    speed: float = 0.0,
    turns: float | None = None,
    duration: float | None = None,
    times: ArrayLike | None = None,
    samples: int = 721,
    tolerance: float = TOLERANCE,
) -> FreeRun:
    """Let a machine run by itself from a crank angle and speed.

    Dry friction holds a crank at rest until what drives it is larger; every rest and change of
    direction is an event of its own, so that no step is taken across it.

    Args:
        machine: the machine.
        angle: crank angle at the start in [rad]; None takes where assembly starts.
        speed: crank speed at the start in [rad/s].
        turns: turns of the crank after which to end; negative backwards.
        duration: time after which to end in [s]; give it, `turns` or `times`.
        times: instants to record in [s], rising from 0; None records `samples` evenly spread ones.
        samples: instants recorded where no times are given.
        tolerance: relative, of DOP853.

    Raises:
        InputError: where it is not said when to end.

    Accuracy: crank angle about 1e-11 rad a turn at the default tolerance; `energy_error` says how
        well the energy balance came out.
    """
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
    runner = Runner(machine, machine.mechanism.start if angle is None else angle, speed, turns, tolerance)
    outcome, reason = runner.run(duration)
    asked = np.linspace(0.0, runner.time, samples) if instants is None else instants
    times = asked[asked <= runner.time]
    (way, rate, work, lost), pull, inertia, energy = runner.at(times)
    return FreeRun(
        machine,
        times,
        way,
        rate,
        pull,
        0.5 * inertia * rate**2,
        energy,
        work,
        lost,
        outcome,
        reason,
    )
