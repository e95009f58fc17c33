"""Forces of contacts, ropes and flanks with backlash along a prescribed motion: lift-off, slackness, changes.

The force on link b is N n with the normal n of the contact. A contact closed by force can only push and lifts
off where N becomes negative (Norton, *Cam Design and Manufacturing Handbook*, ch. 15); if it is closed by
form, the other flank carries there. A force F, or moment, on the follower towards the cam adds F / l to N,
where the lever l is the normal displacement of the contact per lift.

With backlash, the flank that carries changes where the force on the driven side changes its sign, without
regard of the impact.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mechsim.kinematics.loops.record import link_or_ground_motion
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.prescribed_motion import prescribed_along
from mechsim.mechanism.cams import Cam
from mechsim.mechanism.joints import Coupling
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import roots
from mechsim.numerics.peaks import peak

# intervals into which one with a least force next to zero is divided
FINER = 32
# largest step of a driver in [rad] or [m] between instants, and largest number of steps from row to row
STEP, MAX_STEPS = np.pi / 36.0, 50
# largest number of instants that a sentence lists
MAX_SHOWN = 4
# force of a coupling relative to the largest one of the drives that is rounding
ROUNDING = 1e-13

# times (n,) in [s] -> path parameter with its rate and second derivative
State = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactForce:
    """Normal force of a contact along a motion.

    Attributes:
        one_sided: whether the contact can only push, or a rope only pull.
        rope: whether it is the tension of a rope.
        backlash: play between the flanks of a coupling, whose force on the driven side it is; 0 for others.
        least: least force in [N]; negative if the contact would pull.
        least_at: its time in [s].
        largest: largest force in [N].
        largest_at: its time in [s].
        changes: times in [s] at which the force changes its sign.
        preload: further constant force, or moment, on the follower towards the cam with which the contact
            never pulls; None for a curve.
        unit: of the preload, or of the force on a driven side with backlash: "N", or "N m" if it rotates.
    """

    one_sided: bool
    rope: bool
    backlash: float
    least: float
    least_at: float
    largest: float
    largest_at: float
    changes: tuple[float, ...]
    preload: float | None
    unit: str

    def sentence(self, name: str) -> str:
        """Return in words whether the contact stays closed, or the rope taut."""
        instants = self._instants()
        interval = f"{self.least:.6g} to {self.largest:.6g}"
        reached = f"would reach {self.least:.6g} N at {self.least_at:.6g} s"
        if self.rope:
            if self.least >= 0.0:
                return f"{name}: the rope is taut, under {interval} N"
            return f"{name}: the rope goes slack: its tension changes sign {instants} and {reached}"
        if self.backlash:
            flank = (
                f"{instants} the other flank carries" if self.changes else "one flank carries all the time"
            )
            return (
                f"{name}: {flank}, under {interval} {self.unit}; a change moves the driven side by "
                f"{self.backlash:.6g} {'m' if self.unit == 'N' else 'rad'}"
            )
        if not self.changes:
            if self.one_sided and self.least < 0.0:
                return f"{name}: the contact would have to pull, up to {-self.least:.6g} N, all the time"
            return f"{name}: the contact pushes with {interval} N"
        if not self.one_sided:
            return f"{name}: the other flank carries {self._instants('from')}, up to {-self.least:.6g} N"
        more = ""
        if self.preload is not None:
            more = f"; {self.preload:.6g} {self.unit} more on the follower towards the cam prevent it"
        return f"{name}: the contact lifts off: its force changes sign {instants} and {reached}{more}"

    def _instants(self, preposition: str = "at") -> str:
        """Return the first changes in words, and the number of the others."""
        shown, more = self.changes[:MAX_SHOWN], len(self.changes) - MAX_SHOWN
        text = ", ".join(f"{time:.10g}" for time in shown) + " s" if shown else "no instant"
        return f"{preposition} {text}" + (f" and {more} more times" if more > 0 else "")


def contact_forces(model: DynamicModel, state: State, times: Array) -> dict[str, ContactForce]:
    """Return the forces of all contacts and ropes of a mechanism along a prescribed motion.

    Args:
        model: the dynamic model.
        state: its motion over time.
        times: instants between which changes of sign are located, rising, (n,) in [s].
    """
    mechanism = model.mechanism
    laws = mechanism.named_laws.items()
    opening = {law.name: (label, law) for label, law in laws if law.rope or law.backlash}
    names = [*mechanism.contacts, *opening] if len(times) > 1 else []
    if names:
        drivers, _, _ = model.solver.motion_laws.along_path(state(times)[0])
        steps = min(MAX_STEPS, int(np.ceil(np.abs(np.diff(drivers)).max(initial=0.0) / STEP)))
        rows = np.arange(len(times))
        times = np.interp(np.linspace(0.0, rows[-1], rows[-1] * max(1, steps) + 1), rows, times)
    return {name: _contact_force(model, state, times, name, *opening.get(name, ("", None))) for name in names}


def contact_unit(mechanism: Mechanism, name: str) -> str:
    """Return the unit of the force of a contact or a rope."""
    shape = mechanism.contacts[name].shape if name in mechanism.contacts else None
    return "N m" if isinstance(shape, Cam) and shape.motion == "swinging" else "N"


def _contact_force(
    model: DynamicModel, state: State, times: Array, name: str, label: str, law: Coupling | None
) -> ContactForce:
    """Return the force of a contact by its name, or of a coupling by the label of its law."""
    contact, rope = model.mechanism.contacts.get(name), law is not None and law.rope

    def force(instants: Array) -> tuple[Array, Array | None]:
        """Return the force, (n,) in [N] or [N m], and at a cam its lever, (n,) in [1] or [m]."""
        parameter, rate, second = state(instants)
        forces = prescribed_along(model, parameter, rate, second, time=instants).forces
        if contact is None:
            # the multiplier of the left side; tension shortens that of a rope
            multiplier = forces.gears[label]
            driving = np.abs([forces.torque, *forces.drives.values()]).max()
            multiplier = np.where(np.abs(multiplier) <= ROUNDING * driving, 0.0, multiplier)
            return (-multiplier if rope else multiplier), None
        motion = model.solver.whole_motion(parameter)
        values = motion.joints[contact.coordinate].value
        carrier = link_or_ground_motion(contact.frame, motion.links)
        directions = (carrier.rotation @ contact.normals(values)[..., None])[..., 0]
        levers = contact.shape.lever(values) if isinstance(contact.shape, Cam) else None
        return (forces.reactions[contact.force_joint].force * directions).sum(-1), levers

    def preload(instants: Array) -> Array:
        value, levers = force(instants)
        return np.zeros_like(value) if levers is None else -value * levers

    samples = times
    value, levers = force(times)
    # a force next to zero that turns between two instants may change its sign twice
    steps, magnitude = np.abs(np.diff(value)), np.abs(value[1:-1])
    turning = (magnitude < np.maximum(steps[1:], steps[:-1])) & (value[:-2] * value[2:] > 0.0)
    if turning.any():
        between = np.unique(np.linspace(times[:-2][turning], times[2:][turning], FINER + 1))
        times, value = np.append(times, between), np.append(value, force(between)[0])
    order = np.argsort(times, kind="stable")
    times, value = times[order], value[order]
    acting = np.flatnonzero(value)
    before, after = acting[:-1], acting[1:]
    crosses = value[before] * value[after] < 0.0
    changes = roots(lambda instants: force(instants)[0], times[before[crosses]], times[after[crosses]])
    least_at, least = peak(lambda instants: -force(instants)[0], samples)
    largest_at, largest = peak(lambda instants: force(instants)[0], samples)
    return ContactForce(
        one_sided=contact is None or contact.one_sided,
        rope=rope,
        backlash=0.0 if law is None else law.backlash,
        least=-least,
        least_at=least_at,
        largest=largest,
        largest_at=largest_at,
        changes=tuple(changes.tolist()),
        preload=None if levers is None else max(0.0, peak(preload, samples)[1]),
        unit=model.mechanism.effort_unit(next(iter(law.left_terms)))
        if law
        else contact_unit(model.mechanism, name),
    )
