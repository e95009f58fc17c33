"""The instants at which a model and a claim are compared, and what the exact motion says there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic import dynamics
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.dynamics import Machine
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.efforts import Efforts
from mechsim.model.forces import Forces
from mechsim.model.motion import Motion
from mechsim.studies.agreement.named_quantities import NamedQuantity
from mechsim.studies.motion_source import profile_of, programs_of

INSTANTS = 73
TURN = 2.0 * np.pi
EFFORTS = ("torque", "force", "moment")


@dataclass(frozen=True)
class Comparand:
    """What moves, and at which instants it is asked.

    Attributes:
        form: what moves.
        angle: of the crank, or of the clock of programs, (n,) in [rad].
        speed: of it, (n,) in [rad/s].
        acceleration: of it, (n,) in [rad/s2].
        time: (n,) in [s]; None where only angles are known.
        machine: with masses and forces, for efforts; None takes the form's own forces.
    """

    form: Form
    angle: Array
    speed: Array
    acceleration: Array
    time: Array | None = None
    machine: Machine | None = field(default=None, compare=False)

    def __len__(self) -> int:
        return len(self.angle)

    @cached_property
    def motion(self) -> Motion:
        """The exact motion.

        Raises:
            AssemblyError: where the loops do not close.
        """
        return self.form.solve(self.angle, self.speed, self.acceleration)

    @cached_property
    def _of_loops(self) -> Motion:
        """The motion by the loop equations, which know every coordinate."""
        if isinstance(self.form, LoopForm):
            return self.motion
        return LoopForm(self.form.mechanism).solve(self.angle, self.speed, self.acceleration)

    @cached_property
    def efforts(self) -> Efforts:
        """What drives and joints carry."""
        machine = self.machine or dynamics.machine(self.form, acting(self.form))
        found = dynamics.prescribed(machine, self.angle, self.speed, self.acceleration, time=self.time)
        return found.efforts

    def drivers(self) -> dict[str, tuple[Array, Array, Array]]:
        """Return driver -> value, rate and acceleration, (n,) each in SI."""
        programs = programs_of(self.form)
        if programs is None:
            return {self.form.mechanism.crank.name: (self.angle, self.speed, self.acceleration)}
        value, first, second = programs.by_clock(self.angle)
        rate, bend = first * self.speed, first * self.acceleration + second * self.speed**2
        return {name: (value[i], rate[i], bend[i]) for i, name in enumerate(programs.drivers)}

    def exact(self, named: NamedQuantity) -> Array:
        """Return what a quantity is, (n, k) in SI.

        Raises:
            AssemblyError: where the loops do not close.
        """
        kind, subject = named.kind, named.subject
        if kind in EFFORTS:
            return named.components(self._effort(kind, subject))
        if kind in ("position", "velocity", "acceleration"):
            return named.components(getattr(self.motion.points[subject], kind))
        joints = self.motion.joints if subject in self.motion.joints else self._of_loops.joints
        part = {"joint": "value", "joint rate": "rate", "joint acceleration": "acceleration"}[kind]
        if subject not in joints and subject in self.form.mechanism.drivers:
            value = self.drivers()[subject]
            return value[("joint", "joint rate", "joint acceleration").index(kind)][:, None]
        if subject not in joints:
            raise InputError(f"{named.name}: nothing tells the coordinate {subject} of {self.form.name}")
        return getattr(joints[subject], part)[:, None]

    def _effort(self, kind: str, subject: str) -> Array:
        if kind != "torque":
            reaction = self.efforts.reactions[subject]
            return getattr(reaction, kind)
        drives = self.efforts.drives
        return (drives[subject] if drives else self.efforts.torque)[:, None]

    def at(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> "Comparand":
        """Return some of the instants."""
        time = None if self.time is None else self.time[rows]
        return replace(
            self,
            angle=self.angle[rows],
            speed=self.speed[rows],
            acceleration=self.acceleration[rows],
            time=time,
        )

    def all(self, named: Sequence[NamedQuantity]) -> list[Array]:
        """Return what quantities are, (n, k) each in SI."""
        return [self.exact(one) for one in named]


def acting(form: Form) -> Forces | None:
    """Return what acts on it, as its file says."""
    return form.forces if isinstance(form, LoopForm) else None


def situation_of(form: Form, speed: float, samples: int = INSTANTS) -> Comparand:
    """Return a form over its range: a turn, a swing, or its programs from begin to end, evenly in time.

    Args:
        form: what moves.
        speed: of its crank in [rad/s].
        samples: instants, both ends included.
    """
    profile = profile_of(form, speed, form.period / TURN)
    time = np.linspace(0.0, profile.duration, samples)
    return Comparand(form, *profile.state(time), time)


def asked_of(situation: Comparand) -> Array | Mapping[str, Array]:
    """Return what a formula is asked at: the crank's angles, or the coordinates of the drivers by name."""
    drivers = {name: state[0] for name, state in situation.drivers().items()}
    if programs_of(situation.form) is None or len(drivers) == 1:
        return next(iter(drivers.values()))
    return drivers
