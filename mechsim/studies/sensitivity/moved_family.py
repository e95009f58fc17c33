"""A family of mechanisms moved in one manner: its quantities, and their derivatives by dimensions."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mechsim.analytic.derivatives import DesignFamily, changes, motion_derivatives
from mechsim.analytic.derivatives.dimensions import AXES, placed_family
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
from mechsim.model.motion_laws import closes_nowhere
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.quantities import columns_of, is_effort
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
        return ("angle", self.angles) if motion_laws is None else ("t", self.angles / motion_laws.pace)

    @property
    def rate(self) -> float:
        """Speed of the crank or of the clock, in [rad/s]."""
        motion_laws = self.form.motion_laws
        return self.speed if motion_laws is None else motion_laws.pace

    @property
    def offset(self) -> str:
        """The name of the crank's unknown zero, a dimension in [rad]; empty under programs."""
        alone = self.form.motion_laws is None and self.form.mechanism.has_crank
        return self.form.mechanism.crank.name + OFFSET if alone else ""

    def quantities(self, asked: Sequence[str]) -> list[str]:
        """Return the columns that names stand for (see `columns_of`).

        Raises:
            InputError: for an unknown name, or a reaction that rigid links do not determine.
        """
        known = dict(motion_derivatives(self.form, {}, self.angles[:1]).motion.columns())
        left: tuple[str, ...] = ()
        if any(is_effort(one) for one in asked):
            study = prescribed_along(self.loading.machine(self.form), self.angles[:1], self.rate)
            known |= dict(study.columns())
            left = tuple(
                f"{name}.{part}" for name, one in study.efforts.reactions.items() for part in one.open
            )
        found = columns_of(asked, list(known), self.form.mechanism)
        if told := [one for one in found if one in left and one in asked]:
            raise InputError(
                f"{self.form.name}: rigid links do not determine {told[0]}, so that it has no derivative; "
                f"ask for another ({', '.join(left)} are not determined)"
            )
        return [one for one in found if one not in left]

    def values(self, columns: Sequence[str], dimensions: Mapping[str, float]) -> Columns:
        """Return quantities of a mechanism with other dimensions, solved by Newton's method from this one.

        Args:
            columns: quantities.
            dimensions: name -> value in SI, of those that change; `offset` is how far the crank is ahead.

        Raises:
            AssemblyError: where its loops do not close.
            InputError: for dimensions that no mechanism can have.
        """
        own, ahead = self._parted(dimensions)
        form = self.family.make(own)
        found: Columns = {}
        if any(not is_effort(one) for one in columns):
            found |= dict(self._motion(form, columns, ahead).columns())
        if any(is_effort(one) for one in columns):
            found |= dict(self._efforts(form, ahead).columns())
        return {one: found[one] for one in columns}

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

    def _motion(self, form: Form, columns: Sequence[str], ahead: float) -> Motion:
        """Return the motion of another mechanism; where Newton's method does not reach it, by itself."""
        if self._near is not None:
            with suppress(AssemblyError):
                return self._near.of(form.mechanism, ahead)
        found = form.solve_along(self.angles + ahead, self.rate)
        told = dict(found.columns())
        whole = all(one in told for one in columns if not is_effort(one))
        return found if whole else LoopForm(form.mechanism).solve(self.angles + ahead, self.rate)

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
        motion, efforts = (any(is_effort(one) is kind for one in columns) for kind in (False, True))

        def slopes(*numbers: Callable[[Mapping[str, float]], Array]) -> dict[str, Array | None]:
            found = changes(here, dimensions, *numbers)
            return {name: found.get(name) for name in names}

        return self._found(
            here.make({}),
            ahead,
            columns,
            slopes() if motion else None,
            slopes(self._numbers(here)) if efforts else None,
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
        full = len(self._numbers(self.family)({})) if any(is_effort(one) for one in columns) else 0
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
        values: Columns = {}
        by: dict[str, Columns] = {name: {} for name in (change or machine_change or {})}
        if change is not None:
            found = derivatives_along(self._followed(self._near, form, ahead, self.rate), change)
            values |= dict(found.motion.columns())
            for name, motion in found.by.items():
                by[name] |= dict(motion.columns())
        if machine_change is not None:
            unit = self._followed(self._near_unit, form, ahead, 1.0)
            told = efforts_along(self.loading.machine(form), unit, machine_change, self.rate)
            values |= told.columns
            for name, moved in told.by.items():
                by[name] |= moved
        return Slopes(
            {one: values[one] for one in columns},
            {name: {one: own[one] for one in columns} for name, own in by.items()},
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
        low, high, turn = 0.0, motion_laws.pace * motion_laws.duration, np.inf
    elif (arcs := form.crank_range()).full:
        low, high, turn = 0.0, TURN, TURN
    else:
        if not arcs.arcs:
            raise closes_nowhere(form.name)
        low, high = max(arcs.arcs, key=lambda arc: arc[1] - arc[0])
        clear = CLEAR * (high - low)
        low, high, turn = low + clear, high - clear, TURN
    at = np.linspace(low, high, INSTANTS)
    off = np.abs(at[:, None] - np.array(form.change_points()))
    return at[(np.minimum(off, np.abs(off - turn)) > MEETING * (high - low)).all(1)]
