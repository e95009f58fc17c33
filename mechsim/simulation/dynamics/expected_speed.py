"""How fast a free crank will turn, roughly: what time step it needs, and when to give up on it."""

from dataclasses import dataclass

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.efforts import tangent
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.poses import follow
from mechsim.simulation.recorded_motion import States

# a crank that nothing drives is looked at as if it made a turn in so many seconds
SLOWEST = 100.0
# crank angles in a turn at which inertia and damping are looked up
PROBES = 24
# part of the quickest decay that a step may take: Runge's method is stable to 2.8
PART_OF_DECAY = 0.5


@dataclass(frozen=True, slots=True)
class ExpectedSpeed:
    """What is expected of a free run.

    Attributes:
        speed: about the largest crank speed, in [rad/s].
        decay: shortest time in which damping and motor slow the crank to 1/e, in [s]; may be infinite.
    """

    speed: float
    decay: float

    def timestep(self, step: float) -> float:
        """Return a time step no longer than the decay allows, in [s]."""
        return min(step, PART_OF_DECAY * self.decay)


def expect_speed(
    loaded: LoadedModel, angle: float, speed: float, turns: float | None, duration: float | None
) -> ExpectedSpeed:
    """Return what to expect, from the energy that motor, loads and weight can give.

    That is the energy of one turn, or of the turns asked for where no speed limits the motor.
    """
    inertia, damping = _along(loaded, angle)
    weight = float(loaded.model.body_mass.sum() * np.linalg.norm(loaded.model.opt.gravity))
    stored = 2.0 * weight * loaded.mechanism.size
    forces, torque, limit, fall = loaded.forces, 0.0, np.inf, 0.0
    if forces.motor is not None:
        torque, fall = abs(float(forces.motor.torque(0.0))), -forces.motor.slope
        limit = abs(forces.motor.no_load)
    if forces.crank_torque is not None:
        around = np.linspace(0.0, TURN, 73)
        torque += float(np.abs(forces.crank_torque.at(around, np.zeros(73))).max())
    for spring in forces.springs:
        stored += 0.5 * spring.stiffness * loaded.mechanism.size**2
    least = float(inertia.min())
    far = TURN * abs(turns) if turns is not None else TURN
    driven = min(float(np.sqrt(2.0 * torque * far / least)), limit)
    if duration is not None:
        driven = min(driven, torque * duration / least)
    # the crank is fastest where the inertia is least
    kept = np.sqrt((2.0 * stored + float(inertia[0]) * speed**2) / least)
    fastest = max(abs(speed), float(np.hypot(kept, driven)), TURN / SLOWEST)
    slowing = damping + fall
    return ExpectedSpeed(fastest, float((inertia / slowing).min()) if (slowing > 0.0).all() else np.inf)


def _along(loaded: LoadedModel, angle: float) -> tuple[Array, Array]:
    """Return generalised inertia [kg m2] and damping [N m s] at the crank over the turn, or at one angle."""
    angles = angle + np.linspace(0.0, TURN, PROBES + 1)[:-1]
    try:
        qpos = follow.follow(loaded.loops, loaded.qpos, angles)
    except AssemblyError:
        qpos = follow.follow(loaded.loops, loaded.qpos, angles[:1])
    n, model = len(qpos), loaded.looking()
    rest = States(np.zeros(n), qpos, np.zeros((n, loaded.model.nv)))
    inertia = loaded.look(model, rest, loaded.nothing(n))["inertia"]
    rates = tangent(loaded, qpos, inertia)
    fields = loaded.look(model, States(rest.time, qpos, rates), loaded.nothing(n))
    lost = -(fields["qfrc_damper"] * rates).sum(1)
    return (rates * (inertia @ rates[..., None])[..., 0]).sum(1), np.maximum(lost, 0.0)
