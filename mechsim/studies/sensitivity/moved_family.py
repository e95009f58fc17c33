"""A family of mechanisms moved in one manner: its quantities, and their derivatives by dimensions."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mechsim.analytic.derivatives import DesignFamily, changes, motion_derivatives
from mechsim.analytic.derivatives.dimensions import placed_family
from mechsim.analytic.derivatives.dynamics import efforts_along, machine_numbers, moved_efforts
from mechsim.analytic.derivatives.motion import (
    Followed,
    MotionBeside,
    derivatives_along,
    followed_motion,
    motion_beside,
)
from mechsim.analytic.dynamics import InverseDynamics, Machine, machine
from mechsim.analytic.dynamics.prescribed_motion import prescribed_along
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import AssemblyError, InputError
from mechsim.model.forces import Forces
from mechsim.model.joint_kinds import KINDS
from mechsim.model.masses import STEEL, with_inertia
from mechsim.model.motion import Motion
from mechsim.model.motion_laws import no_crank_range_error
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.studies.quantities import AXES, Quantity, quantity, record_columns, scalar_quantities, unknown
from mechsim.studies.sensitivity.tolerances import CLEARANCE

# instants of a motion where none are asked for, and how near to a dead centre they come, as part of the range
INSTANTS, CLEAR = 73, 0.01
# nor nearer to where assemblies meet
MEETING = 1e-3

Columns = dict[str, Array]
# how far a mechanism's coordinates may lie from those of the one that it is solved from, in [rad] or sizes
REACH = 0.5
# what follows the crank's name where its zero is meant
OFFSET = ".offset"


@dataclass(frozen=True)
class Loading:
    """What the links are made of, and what acts on a mechanism.

    Attributes:
        forces: what acts on one; None takes what its file says.
        density: of links, which are round rods where they have no inertia, in [kg/m3].
        diameter: of those rods in [m]; None takes 0.05 of the size.
    """

    forces: Callable[[Form], Forces] | None = None
    density: float = STEEL
    diameter: float | None = None

    def acting(self, form: Form) -> Forces:
        """Return what acts on a mechanism."""
        if self.forces is not None:
            return self.forces(form)
        own = form.forces
        return own or Forces()

    def machine(self, form: Form) -> Machine:
        """Return a mechanism with masses and what acts on it."""
        return machine(form, self.acting(form), density=self.density, diameter=self.diameter)


@dataclass(frozen=True)
class Slopes:
    """Quantities of a mechanism and their derivatives.

    Attributes:
        values: column -> (n,), in SI.
        by: dimension -> column -> derivative, (n,).
    """

    values: Mapping[str, Array]
    by: Mapping[str, Mapping[str, Array]]


@dataclass(frozen=True)
class MovedFamily:
    """A family, and how each of it is moved.

    Attributes:
        family: the mechanisms.
        angles: of the crank, or of the clock of programs, (n,) in [rad].
        speed: of the crank in [rad/s]; programs have their own.
        loading: what efforts are of.
    """

    family: DesignFamily
    angles: Array
    speed: float
    loading: Loading = Loading()

    @cached_property
    def form(self) -> Form:
        """The mechanism as it stands."""
        return self.family.make({})

    @cached_property
    def over(self) -> tuple[str, Array]:
        """What tells the instants apart: crank angle in [rad], or t in [s] under programs."""
        motion_laws = self.form.motion_laws
        return ("angle", self.angles) if motion_laws is None else ("t", self.angles / motion_laws.rate)

    @property
    def rate(self) -> float:
        """Speed of the crank or of the clock, in [rad/s]."""
        motion_laws = self.form.motion_laws
        return self.speed if motion_laws is None else motion_laws.rate

    @property
    def offset(self) -> str:
        """The name of the crank's unknown zero, a dimension in [rad]; empty under programs."""
        alone = self.form.motion_laws is None and self.form.mechanism.has_crank
        return self.form.mechanism.crank.name + OFFSET if alone else ""

    def quantity(self, name: str) -> Quantity:
        """Return the quantity of a name."""
        return quantity(name, self.form.mechanism)

    def loaded(self, names: Iterable[str]) -> bool:
        """Whether quantities need masses and forces."""
        return any(self.quantity(name).loaded for name in names)

    def quantities(self, names: Sequence[str]) -> list[str]:
        """Return the numbers that names stand for: of vectors the components that are determined.

        Raises:
            InputError: for an unknown name, or a reaction that rigid links do not determine.
        """
        found = scalar_quantities(names, self.form.mechanism)
        known = record_columns(motion_derivatives(self.form, {}, self.angles[:1]).motion, found)
        undetermined: set[str] = set()
        if any(part.loaded for part in found):
            study = prescribed_along(self.loading.machine(self.form), self.angles[:1], self.rate)
            known |= self._force_columns(dict(study.columns()))
            reactions = study.efforts.reactions.items()
            undetermined = {
                f"{joint}.{part}" for joint, reaction in reactions for part in reaction.undetermined
            }
        result: list[str] = []
        for part in found:
            columns = {column.name for column in part.columns}
            if not columns <= known.keys():
                raise unknown(part.name, self.form.mechanism)
            if not columns & undetermined:
                result.append(part.name)
            elif part.function is not None or part.name in names:
                raise InputError(
                    f"{self.form.name}: rigid links do not determine {part.name}, so that it has no "
                    f"derivative; name another ({', '.join(sorted(undetermined))} are not determined)"
                )
        return result

    def _force_columns(self, columns: Mapping[str, Array]) -> Columns:
        """Return columns of forces in which the torque of a crank under a motion law is called so, too."""
        mechanism = self.form.mechanism
        drive = f"drive {mechanism.drivers[0]}"
        if mechanism.has_crank and "torque" not in columns and drive in columns:
            return {**columns, "torque": columns[drive]}
        return dict(columns)

    def values(self, names: Sequence[str], dimensions: Mapping[str, float]) -> Columns:
        """Return quantities of a mechanism with other dimensions, solved by Newton's method from this one.

        Args:
            names: of the quantities.
            dimensions: name -> value in SI, of those that change; `offset` is how far the crank is ahead.

        Raises:
            AssemblyError: where its loops do not close.
            InputError: for dimensions that no mechanism can have.
        """
        own, ahead = self._parted(dimensions)
        form = self.family.make(own)
        wanted = [self.quantity(name) for name in names]
        columns: Columns = {}
        moving = [part for part in wanted if part.uses("point", "joint", "link")]
        if moving:
            columns |= record_columns(self._motion(form, moving, ahead), moving)
        if any(part.loaded for part in wanted):
            columns |= self._force_columns(dict(self._efforts(form, ahead).columns()))
        return {name: part.number(columns) for name, part in zip(names, wanted, strict=True)}

    @cached_property
    def _near(self) -> MotionBeside | None:
        """The motion as it stands, from which others are solved; None where two assemblies meet on it."""
        with suppress(AssemblyError):
            return motion_beside(self.form, self.angles, self.rate, reach=REACH)
        return None

    @cached_property
    def _near_unit(self) -> MotionBeside | None:
        """The same per radian of the crank or of the clock."""
        return None if self._near is None else motion_beside(self.form, self.angles, reach=REACH)

    def _parted(self, dimensions: Mapping[str, float]) -> tuple[dict[str, float], float]:
        """Return dimensions of the family, and how far the crank is ahead in [rad]."""
        own = {name: value for name, value in dimensions.items() if name != self.offset}
        return own, dimensions.get(self.offset, 0.0)

    def _motion(self, form: Form, wanted: Sequence[Quantity], ahead: float) -> Motion:
        """Return the motion of another mechanism; where Newton's method does not reach it, by itself."""
        if self._near is not None:
            with suppress(AssemblyError):
                return self._near.of(form.mechanism, ahead)
        found = form.solve_along(self.angles + ahead, self.rate)
        known = dict(found.columns())
        joints = [column.name for part in wanted for column in part.columns if column.source == "joint"]
        return (
            found
            if all(name in known for name in joints)
            else LoopForm(form.mechanism).solve(self.angles + ahead, self.rate)
        )

    def _efforts(self, form: Form, ahead: float) -> InverseDynamics:
        machine = self.loading.machine(form)
        if self._near_unit is not None:
            with suppress(AssemblyError):
                return moved_efforts(machine, self._near_unit.of(form.mechanism, ahead), self.rate)
        return prescribed_along(machine, self.angles + ahead, self.rate)

    def slopes(
        self, columns: Sequence[str], names: Sequence[str], at: Mapping[str, float] | None = None
    ) -> Slopes:
        """Return quantities and their exact derivatives by dimensions.

        Args:
            columns: quantities.
            names: dimensions, and `offset`.
            at: name -> value in SI, of dimensions that are changed before.

        Raises:
            AssemblyError: where loops do not close, or a dimension alone would tear them open.
        """
        own, ahead = self._parted(at or {})
        here = beside(self.family, own)
        dimensions = [name for name in names if name != self.offset]
        motion = any(self.quantity(name).uses("point", "joint", "link") for name in columns)

        def slopes(*numbers: Callable[[Mapping[str, float]], Array]) -> dict[str, Array | None]:
            found = changes(here, dimensions, *numbers)
            return {name: found.get(name) for name in names}

        return self._found(
            here.make({}),
            ahead,
            columns,
            slopes() if motion else None,
            slopes(self._numbers(here)) if self.loaded(columns) else None,
        )

    def play(self, columns: Sequence[str], joint: str) -> list[Columns]:
        """Return derivatives of quantities by shifts of a joint's pin in its hole, square to a hinge's axis.

        One for each direction, per metre; masses stay where they are.

        Raises:
            AssemblyError: where a shift would tear loops open that repeat each other.
        """
        mechanism = self.form.mechanism
        names = [f"{joint}.b.at.{axis}" for axis in AXES]
        by_axis = np.array([*changes(placed_family(LoopForm(mechanism)), names).values()])
        directions = mechanism.joint(joint).b.frame.T[: 3 if KINDS[mechanism.joint(joint).kind].ball else 2]
        change = {f"{joint}{CLEARANCE}{i}": one @ by_axis for i, one in enumerate(directions)}
        full = len(self._numbers(self.family)({})) if self.loaded(columns) else 0
        wide = {name: np.pad(one, (0, full - len(one))) for name, one in change.items()} if full else None
        found = self._found(self.form, 0.0, columns, change, wide)
        return [dict(one) for one in found.by.values()]

    def _found(
        self,
        form: Form,
        ahead: float,
        columns: Sequence[str],
        change: Mapping[str, Array | None] | None,
        machine_change: Mapping[str, Array | None] | None,
    ) -> Slopes:
        """Return quantities and derivatives by changes of a mechanism's numbers and of a machine's."""
        wanted = [self.quantity(name) for name in columns]
        values: Columns = {}
        by: dict[str, Columns] = {name: {} for name in (change or machine_change or {})}
        if change is not None:
            found = derivatives_along(self._followed(self._near, form, ahead, self.rate), change)
            values |= record_columns(found.motion, wanted)
            for name, motion in found.by.items():
                by[name] |= record_columns(motion, wanted)
        if machine_change is not None:
            unit = self._followed(self._near_unit, form, ahead, 1.0)
            told = efforts_along(self.loading.machine(form), unit, machine_change, self.rate)
            values |= self._force_columns(told.columns)
            for name, moved in told.by.items():
                by[name] |= self._force_columns(moved)
        return Slopes(
            {part.name: part.number(values) for part in wanted},
            {name: {part.name: part.changes(values, own)[0] for part in wanted} for name, own in by.items()},
        )

    def _followed(self, near: MotionBeside | None, form: Form, ahead: float, rate: float) -> Followed:
        """Return the motion of another mechanism from this one, or from its own guess if that is too far."""
        if near is not None:
            with suppress(AssemblyError):
                return near.followed(form.mechanism, ahead)
        return followed_motion(form, form.mechanism, self.angles + ahead, rate, 0.0)

    def _numbers(self, family: DesignFamily) -> Callable[[Mapping[str, float]], Array]:
        """Return what gives the numbers of a machine of the family."""
        still = self.loading.acting(family.make({}))

        def numbers(values: Mapping[str, float]) -> Array:
            mechanism = with_inertia(family.describe(values), self.loading.density, self.loading.diameter)
            # where a file says what acts, its dimensions may change that too
            if family.forces is None:
                return machine_numbers(mechanism, still)
            if self.loading.forces is None:
                return machine_numbers(mechanism, family.forces(values) or Forces())
            return machine_numbers(mechanism, self.loading.acting(family.make(values)))

        return numbers


def beside(family: DesignFamily, values: Mapping[str, float]) -> DesignFamily:
    """Return the same family seen from a mechanism with other dimensions."""
    if not values:
        return family
    own = dict(values)
    forces = family.forces
    return DesignFamily(
        family.name,
        {name: replace(one, value=own.get(name, one.value)) for name, one in family.dimensions.items()},
        lambda more: family.describe(own | dict(more)),
        lambda more: family.make(own | dict(more)),
        None if forces is None else lambda more: forces(own | dict(more)),
        family.usual,
        {name: of for name, of in family.reckoned.items() if name not in own},
    )


def instants_of(form: Form) -> Array:
    """Return angles of the crank or of the programs' clock spread over what it can do, (n,) in [rad].

    A crank that only swings keeps away from its dead centres, and any from where two assemblies meet:
    derivatives have no bound there.

    Raises:
        AssemblyError: if the loops close at no crank angle.
    """
    motion_laws = form.motion_laws
    if motion_laws is not None:
        low, high, turn = 0.0, motion_laws.rate * motion_laws.duration, np.inf
    elif (arcs := form.crank_range()).full:
        low, high, turn = 0.0, REVOLUTION, REVOLUTION
    else:
        if not arcs.arcs:
            raise no_crank_range_error(form.name)
        low, high = max(arcs.arcs, key=lambda arc: arc[1] - arc[0])
        clear = CLEAR * (high - low)
        low, high, turn = low + clear, high - clear, REVOLUTION
    at = np.linspace(low, high, INSTANTS)
    off = np.abs(at[:, None] - np.array(form.change_points()))
    return at[(np.minimum(off, np.abs(off - turn)) > MEETING * (high - low)).all(1)]
