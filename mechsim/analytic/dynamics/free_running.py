"""Free running: the crank moves as the reduced equation says, by DOP853 at 3e-13."""

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.analytic.dynamics.free_run_events import Runner
from mechsim.analytic.dynamics.machines import Machine
from mechsim.errors import InputError
from mechsim.model.efforts import FreeRun

# relative, of DOP853: at 1e-12 a step whose estimate of its error happens to vanish is too long, in 2 of 12
# runs of the squeezer that differ by rounding, which costs a digit of ten; at 3e-13 in none
TOLERANCE = 3e-13


def free_run(
    machine: Machine,
    *,
    angle: float | str | None = None,
    speed: float | str = 0.0,
    turns: float | None = None,
    duration: float | str | None = None,
    times: ArrayLike | None = None,
    samples: int = 721,
    tolerance: float = TOLERANCE,
) -> FreeRun:
    """Let a machine run by itself from a crank angle and speed; quantities in SI, or text, as "600rpm".

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
    first = machine.mechanism.start if angle is None else angle
    machine = machine.starting_at([first], speed or turns or 1.0)
    runner = Runner(machine, first, speed, turns, tolerance)
    outcome, reason = runner.run(duration)
    asked = np.linspace(0.0, runner.time, samples) if instants is None else instants
    times = asked[asked <= runner.time]
    (crank, rate, work, lost), acceleration, inertia, potential = runner.at(times)
    return FreeRun(
        time=times,
        angle=crank,
        speed=rate,
        acceleration=acceleration,
        kinetic=0.5 * inertia * rate**2,
        potential=potential,
        work=work,
        lost=lost,
        motor=machine.forces.motor_torque(rate),
        outcome=outcome,
        reason=reason,
    )
