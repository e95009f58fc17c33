"""Normal forces of contacts with curves and cams along a prescribed motion: lift-off, and what prevents it.

The force on link b is N n with the normal n of the contact. A contact closed by force can only push and lifts
off where N becomes negative (Norton, *Cam Design and Manufacturing Handbook*, ch. 15); if it is closed by
form, the other flank carries there. A force F, or moment, on the follower towards the cam adds F / l to N,
where the lever l is the normal displacement of the contact per lift.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.model.cams import Cam
from mechsim.model.contacts import Contact
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import root

# intervals into which one with a least force next to zero is divided
FINER = 32

# times (n,) in [s] -> path parameter with its rate and second derivative
State = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactForce:
    """Normal force of a contact along a motion.

    Attributes:
        one_sided: whether the contact can only push, or a rope only pull.
        rope: whether it is the tension of a rope.
        least: least force in [N]; negative if the contact would pull.
        least_at: its time in [s].
        largest: largest force in [N].
        largest_at: its time in [s].
        changes: times in [s] at which the force changes its sign.
        preload: further constant force in [N], or moment in [N m], on the follower towards the cam with which
            the contact never pulls; None for a curve.
    """

    one_sided: bool
    rope: bool
    least: float
    least_at: float
    largest: float
    largest_at: float
    changes: tuple[float, ...]
    preload: float | None

    def sentence(self, name: str) -> str:
        """Return in words whether the contact stays closed, or the rope taut."""
        if self.rope:
            if self.least >= 0.0:
                return f"{name}: the rope is taut, under {self.least:.6g} to {self.largest:.6g} N"
            instants = ", ".join(f"{time:.10g}" for time in self.changes) or "no instant"
            return (
                f"{name}: the rope goes slack: its tension changes sign at {instants} s and would reach "
                f"{self.least:.6g} N at {self.least_at:.6g} s"
            )
        if not self.changes:
            if self.one_sided and self.least < 0.0:
                return f"{name}: the contact would have to pull, up to {-self.least:.6g} N, all the time"
            return f"{name}: the contact pushes with {self.least:.6g} to {self.largest:.6g} N"
        instants = ", ".join(f"{time:.10g}" for time in self.changes)
        if not self.one_sided:
            return f"{name}: the other flank carries from {instants} s on, up to {-self.least:.6g} N"
        more = ""
        if self.preload is not None:
            more = f"; {self.preload:.6g} N or N m more on the follower towards the cam prevent it"
        return (
            f"{name}: the contact lifts off: its force changes sign at {instants} s and would reach "
            f"{self.least:.6g} N at {self.least_at:.6g} s{more}"
        )


def contact_forces(model: DynamicModel, state: State, times: Array) -> dict[str, ContactForce]:
    """Return the forces of all contacts and ropes of a mechanism along a prescribed motion.

    Args:
        model: the dynamic model.
        state: its motion over time.
        times: instants between which changes of sign are located, rising, (n,) in [s].
    """
    mechanism = model.mechanism
    ropes = [name for name, coupling in mechanism.named_laws.items() if coupling.rope]
    names = [*mechanism.contacts, *ropes] if len(times) > 1 else []
    return {name: _contact_force(model, state, times, name) for name in names}


def _contact_force(model: DynamicModel, state: State, times: Array, name: str) -> ContactForce:
    contact = model.mechanism.contacts.get(name)

    def force(instants: Array) -> tuple[Array, Array | None]:
        if contact is not None:
            return _normal_force(model, state, instants, contact)
        parameter, rate, second = state(instants)
        # the multiplier of the path's length, which tension shortens
        return -prescribed_along(model, parameter, rate, second, time=instants).forces.gears[name], None

    value, levers = force(times)
    preload = None if levers is None else max(0.0, float((-value * levers).max()))
    # a force next to zero that turns between two instants may change its sign twice
    steps, magnitude = np.abs(np.diff(value)), np.abs(value[1:-1])
    turning = (magnitude < np.maximum(steps[1:], steps[:-1])) & (value[:-2] * value[2:] > 0.0)
    for i in np.flatnonzero(turning):
        between = np.linspace(times[i], times[i + 2], FINER + 1)
        times, value = np.append(times, between), np.append(value, force(between)[0])
    order = np.argsort(times, kind="stable")
    times, value = times[order], value[order]
    changes = [
        root(lambda time: float(force(np.array([time]))[0][0]), float(times[i]), float(times[i + 1]))
        for i in np.flatnonzero(value[:-1] * value[1:] < 0.0)
    ]
    first, last = int(np.argmin(value)), int(np.argmax(value))
    return ContactForce(
        one_sided=contact is None or contact.one_sided,
        rope=contact is None,
        least=float(value[first]),
        least_at=float(times[first]),
        largest=float(value[last]),
        largest_at=float(times[last]),
        changes=tuple(changes),
        preload=preload,
    )


def _normal_force(
    model: DynamicModel, state: State, times: Array, contact: Contact
) -> tuple[Array, Array | None]:
    """Return the normal force, (n,) in [N], and at a cam its lever, (n,) in [1] or [m]."""
    parameter, rate, second = state(times)
    motion = model.solver.whole_motion(parameter)
    values = motion.joints[contact.coordinate].value
    normals = contact.normals(values)
    study = prescribed_along(model, parameter, rate, second, time=times)
    reaction = study.forces.reactions[contact.force_joint].force
    directions = (motion.links[contact.frame].rotation @ normals[..., None])[..., 0]
    levers = contact.shape.lever(values) if isinstance(contact.shape, Cam) else None
    return (reaction * directions).sum(-1), levers
