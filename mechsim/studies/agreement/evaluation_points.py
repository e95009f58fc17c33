"""The instants at which a model and a claim are compared, and what the exact motion says there."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic import dynamics
from mechsim.analytic.derivatives import DesignFamily, changes, motion_derivatives
from mechsim.analytic.derivatives.motion import MotionBeside, motion_beside
from mechsim.analytic.dynamics import Machine
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import AssemblyError, InputError, MechsimError
from mechsim.model.efforts import Efforts
from mechsim.model.masses import LinkMass
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.studies.motion_source import profile_of
from mechsim.studies.quantities import Column, Quantity, record_columns
from mechsim.verdict.tolerances import RecordInstants

INSTANTS = 73
TURN = 2.0 * np.pi


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
        solved: its motion where that is known; None where it is to be solved.
        selecting: crank angles of the whole motion, whose first one selects the assembly; None takes `angle`.
    """

    form: Form
    angle: Array
    speed: Array
    acceleration: Array
    time: Array | None = None
    machine: Machine | None = field(default=None, compare=False)
    solved: Motion | None = field(default=None, compare=False)
    selecting: Array | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        selecting = self.angle if self.selecting is None else self.selecting
        object.__setattr__(self, "selecting", selecting)
        if len(selecting):
            object.__setattr__(self, "form", self.form.starting_at(selecting, float(self.speed[0])))

    def __len__(self) -> int:
        return len(self.angle)

    @cached_property
    def motion(self) -> Motion:
        """The exact motion.

        Raises:
            AssemblyError: where the loops do not close.
        """
        if self.solved is not None:
            return self.solved
        return self.form.solve_along(self.angle, self.speed, self.acceleration)

    @cached_property
    def _beside(self) -> MotionBeside | None:
        with suppress(AssemblyError):
            return motion_beside(self.form, self.angle, self.speed, self.acceleration)
        return None

    @property
    def instants(self) -> RecordInstants:
        """What names the instants: crank angles, times of motion laws, or rows of a table without times."""
        if self.form.motion_laws is None:
            return RecordInstants(self.angle, "rad")
        if self.time is not None:
            return RecordInstants(self.time, "s")
        return RecordInstants(np.arange(1.0, len(self) + 1.0), "row")

    @property
    def phase(self) -> Array:
        """Angle of the crank within its period, or the parameter of the motion laws, (n,)."""
        return self.angle if self.form.motion_laws is not None else np.mod(self.angle, self.form.period)

    def with_dimensions(self, form: Form) -> "Comparand":
        """Return the same with what has other dimensions, solved from the motion here where that can be."""
        if self._beside is None:
            return replace(self, form=form, machine=self.machine_of(form), solved=None)
        motion = self._beside.of(form.mechanism)
        return replace(self, form=form, machine=self.machine_of(form), solved=replace(motion, origin=None))

    def machine_of(self, form: Form) -> Machine | None:
        """Return another form under the forces that act here; None where no others than its own do."""
        return None if self.machine is None else dynamics.machine(form, self.machine.forces)

    @cached_property
    def conditioning(self) -> Array:
        """How far the loops are from a singular pose, (n,), as verdicts have it."""
        motion = self.motion
        return self.form.conditioning(motion) if motion.conditioning is None else motion.conditioning

    @cached_property
    def _of_loops(self) -> Motion:
        """The motion by the loop equations, which know every coordinate."""
        if isinstance(self.form, LoopForm) or self.solved is not None:
            return self.motion
        return LoopForm(self.form.mechanism).solve(self.angle, self.speed, self.acceleration)

    @cached_property
    def _loaded(self) -> Machine:
        """The dynamic model of efforts."""
        return self.machine or dynamics.machine(self.form, self.form.forces)

    @property
    def masses(self) -> tuple[LinkMass, ...]:
        """The masses of the links that efforts are computed from, and where each comes from."""
        return self._loaded.masses

    @cached_property
    def efforts(self) -> Efforts:
        """What drives and joints carry."""
        found = prescribed_along(self._loaded, self.angle, self.speed, self.acceleration, time=self.time)
        return found.efforts

    def drivers(self) -> dict[str, tuple[Array, Array, Array]]:
        """Return driver -> value, rate and acceleration, (n,) each in SI."""
        motion_laws = self.form.motion_laws
        if self.solved is not None and motion_laws is not None:
            # where drivers really were, as in a run
            joints = {name: self.solved.joints[name] for name in motion_laws.drivers}
            return {name: (one.value, one.rate, one.acceleration) for name, one in joints.items()}
        if motion_laws is None:
            return {self.form.mechanism.crank.name: (self.angle, self.speed, self.acceleration)}
        value, first, second = motion_laws.along_path(self.angle)
        rate, bend = first * self.speed, first * self.acceleration + second * self.speed**2
        return {name: (value[i], rate[i], bend[i]) for i, name in enumerate(motion_laws.drivers)}

    def exact(self, quantity: Quantity) -> Array:
        """Return a quantity, (n, k) in SI.

        Raises:
            AssemblyError: where the loops do not close.
        """
        columns: dict[str, Array] = {}
        if quantity.uses("point", "joint", "link"):
            columns |= record_columns(self.motion, [quantity])
            columns |= {
                column.name: self._coordinate(column)
                for column in quantity.columns
                if column.source == "joint" and column.name not in columns
            }
        if quantity.loaded:
            columns |= dict(self.efforts.columns())
            drive = f"drive {self.form.mechanism.drivers[0]}"
            columns.setdefault("torque", columns.get(drive, self.efforts.torque))
        missing = [column.name for column in quantity.columns if column.name not in columns]
        if missing:
            raise InputError(f"{quantity.name}: nothing determines {missing[0]} of {self.form.name}")
        return np.column_stack(quantity.components(columns))

    def _coordinate(self, column: Column) -> Array:
        """Return a joint coordinate or a rate of it that the motion does not hold, (n,)."""
        if column.subject in self.form.mechanism.drivers:
            return self.drivers()[column.subject][column.order]
        columns = dict(self._of_loops.columns())
        if column.name not in columns:
            raise InputError(f"nothing determines the coordinate {column.subject} of {self.form.name}")
        return columns[column.name]

    def change(self, motion: Motion, quantity: Quantity) -> Array:
        """Return the derivative of a quantity, (n, k), from the derivatives of a motion; of no force.

        Raises:
            KeyError: for what the derivatives do not hold.
        """
        if quantity.loaded:
            raise KeyError(quantity.name)
        values, by = record_columns(self.motion, [quantity]), record_columns(motion, [quantity])
        for column in quantity.columns:
            if column.subject in self.form.mechanism.drivers:
                by[column.name] = values[column.name] = np.zeros(len(self))
        return np.column_stack(quantity.changes(values, by))

    @cached_property
    def _by_dimension(self) -> dict[tuple[bool, str], Motion]:
        return {}

    def by_dimension(self, family: DesignFamily, name: str) -> Motion:
        """Return the derivatives of the motion by a dimension of a family, those of all of it taken at once.

        Raises:
            KeyError: for one that tears the loops, or beside which nothing can stand.
        """
        key = name.count(".at.") + name.count(".tilt.") > 0
        if (key, "") not in self._by_dimension:
            self._by_dimension[key, ""] = self.motion
            for one, motion in _derivatives(self, family).items():
                self._by_dimension[key, one] = motion
        return self._by_dimension[key, name]

    @cached_property
    def _variants(self) -> dict[str, "Comparand | None"]:
        return {}

    def variant(self, key: str, make: "Callable[[], Comparand]") -> "Comparand | None":
        """Return what `make` makes, made and solved once; None where it cannot stand."""
        if key not in self._variants:
            self._variants[key] = None
            with suppress(MechsimError):
                made = make()
                self._variants[key] = replace(made, solved=made.motion)
        return self._variants[key]

    @cached_property
    def _assemblies(self) -> list[tuple[str, Form]]:
        return []

    def other_assemblies(self, find: Callable[[LoopForm], list[tuple[str, Form]]]) -> list[tuple[str, Form]]:
        """Return the other assemblies of a form without closed form, looked for once."""
        if "searched" not in self.__dict__:
            self.__dict__["searched"] = True
            if isinstance(self.form, LoopForm):
                self._assemblies.extend(find(self.form))
        return self._assemblies

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

    def all(self, quantities: Sequence[Quantity]) -> list[Array]:
        """Return what quantities are, (n, k) each in SI."""
        return [self.exact(quantity) for quantity in quantities]


def _derivatives(comparand: Comparand, family: DesignFamily) -> dict[str, Motion]:
    """Return the derivatives of a motion by all dimensions of a family that can be changed alone."""
    change: dict[str, Array] = {}
    for name in family.dimensions:
        try:
            change |= changes(family, [name])
        except (MechsimError, ValueError):
            continue
    change = {name: slope for name, slope in change.items() if slope.any()}
    found = motion_derivatives(
        comparand.form, change, comparand.angle, comparand.speed, comparand.acceleration, torn=True
    )
    return dict(found.by)


def comparand_of(form: Form, speed: float, samples: int = INSTANTS) -> Comparand:
    """Return a form over its range: a turn, a swing, or its programs from begin to end, evenly in time.

    Args:
        form: what moves.
        speed: of its crank in [rad/s].
        samples: instants, both ends included.
    """
    profile = profile_of(form, speed, form.period / TURN)
    time = np.linspace(0.0, profile.duration, samples)
    return Comparand(form, *profile.state(time), time)


def asked_of(comparand: Comparand) -> Array | Mapping[str, Array]:
    """Return what a formula is asked at: the crank's angles, or the coordinates of the drivers by name."""
    drivers = {name: state[0] for name, state in comparand.drivers().items()}
    if comparand.form.motion_laws is None or len(drivers) == 1:
        return next(iter(drivers.values()))
    return drivers
