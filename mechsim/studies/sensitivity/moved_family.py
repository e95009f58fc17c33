"""A parametric mechanism with a driver motion: its quantities, and their derivatives by dimensions."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.kinematics.derivatives.dimensions import changes
from mechsim.kinematics.derivatives.motion import (
    TracedMotion,
    derivatives_along,
    followed_motion,
    motion_derivatives,
)
from mechsim.kinematics.designs import DesignFamily, placed_designs
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinetics import DynamicModel, InverseDynamics, dynamic_model
from mechsim.kinetics.derivatives import forces_along, model_numbers, perturbed_forces
from mechsim.kinetics.prescribed_motion import prescribed_along
from mechsim.mechanism.forces import WEIGHT, Forces, forces_of
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.masses import with_inertia
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import no_crank_range_error
from mechsim.mechanism.quantities import quantity, scalar_quantities, unknown
from mechsim.mechanism.quantity import AXES, Quantity, record_columns
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.studies.sensitivity.tolerances import CLEARANCE

# default number of instants of a motion; distance from dead centres as a fraction of the range
DEFAULT_INSTANTS, DEAD_CENTRE_DISTANCE = 73, 0.01
# distance from change points in [rad]
CHANGE_POINT_DISTANCE = 1e-3

Columns = dict[str, Array]
# largest change of coordinates from the nominal mechanism, in [rad] or characteristic lengths
MAX_DISPLACEMENT = 0.5
# suffix of the crank's name for the dimension that shifts its zero
OFFSET = ".offset"


@dataclass(frozen=True)
class QuantityDerivatives:
    """Quantities of a mechanism and their derivatives.

    Attributes:
        values: column -> (n,), in SI.
        by: dimension -> column -> derivative, (n,).
    """

    values: Mapping[str, Array]
    by: Mapping[str, Mapping[str, Array]]


@dataclass(frozen=True)
class MovedFamily:
    """A parametric mechanism and its driver motion.

    Attributes:
        designs: the parametric mechanism.
        angles: path parameters, (n,) in [rad].
        speed: crank speed in [rad/s]; motion laws have their own.
        forces: applied forces; None takes those of the file, or else weight.
    """

    designs: DesignFamily
    angles: Array
    speed: float
    forces: Forces | None = None

    @cached_property
    def solver(self) -> KinematicSolver:
        """The nominal mechanism."""
        return self.designs.make({})

    def acting(self, solver: KinematicSolver) -> Forces:
        """Return the applied forces of a mechanism."""
        return self.forces or forces_of(solver)

    def dynamic_model(self, solver: KinematicSolver) -> DynamicModel:
        """Return a mechanism with masses and applied forces."""
        return dynamic_model(solver, self.acting(solver))

    @cached_property
    def over(self) -> tuple[str, Array]:
        """The instants: crank angle in [rad], or t in [s] under motion laws."""
        return self.solver.motion_laws.axis, self.solver.motion_laws.instants(self.angles)

    @property
    def rate(self) -> float:
        """Rate of the path parameter, in [rad/s]."""
        return self.solver.motion_laws.path_speed(self.speed)

    @property
    def offset(self) -> str:
        """Name of the dimension that shifts the crank's zero, in [rad]; empty under motion laws."""
        alone = self.solver.motion_laws.crank and self.solver.mechanism.has_crank
        return self.solver.mechanism.crank.name + OFFSET if alone else ""

    def quantity(self, name: str) -> Quantity:
        """Return the quantity of a name."""
        return quantity(name, self.solver.mechanism)

    def loaded(self, names: Iterable[str]) -> bool:
        """Whether quantities need masses and forces."""
        return any(self.quantity(name).loaded for name in names)

    def quantities(self, names: Sequence[str]) -> list[str]:
        """Return the scalar quantities of names: for a vector its determined components.

        Raises:
            InputError: for an unknown name, or a reaction that rigid links leave undetermined.
        """
        quantities = scalar_quantities(names, self.solver.mechanism)
        columns_known = record_columns(
            motion_derivatives(self.solver, {}, self.angles[:1]).motion, quantities
        )
        undetermined: set[str] = set()
        if any(component.loaded for component in quantities):
            study = prescribed_along(self.dynamic_model(self.solver), self.angles[:1], self.rate)
            columns_known |= self._force_columns(dict(study.columns()))
            reactions = study.forces.reactions.items()
            undetermined = {
                f"{joint}.{component}" for joint, reaction in reactions for component in reaction.undetermined
            }
        result: list[str] = []
        for component in quantities:
            columns = {column.name for column in component.columns}
            if not columns <= columns_known.keys():
                raise unknown(component.name, self.solver.mechanism)
            if not columns & undetermined:
                result.append(component.name)
            elif component.function is not None or component.name in names:
                raise InputError(
                    f"{self.solver.name}: rigid links leave {component.name} undetermined, so it has no "
                    f"derivative; name another quantity (undetermined: {', '.join(sorted(undetermined))})"
                )
        return result

    def _force_columns(self, columns: Mapping[str, Array]) -> Columns:
        """Return columns of forces, with the torque of a crank under a motion law under both of its names."""
        mechanism = self.solver.mechanism
        driver_column = f"drive {mechanism.drivers[0]}"
        if mechanism.has_crank and "torque" not in columns and driver_column in columns:
            return {**columns, "torque": columns[driver_column]}
        return dict(columns)

    def values(self, names: Sequence[str], dimensions: Mapping[str, float]) -> Columns:
        """Return quantities for other dimensions, solved by Newton's method from the nominal mechanism.

        Args:
            names: of the quantities.
            dimensions: changed dimension -> value in SI; `offset` shifts the crank.

        Raises:
            AssemblyError: for loops that do not close.
            InputError: for invalid dimensions.
        """
        own, ahead = self._split_offset(dimensions)
        solver = self.designs.make(own)
        quantities = [self.quantity(name) for name in names]
        columns: Columns = {}
        moving = [component for component in quantities if component.uses("point", "joint", "link")]
        if moving:
            columns |= record_columns(self._motion(solver, moving, ahead), moving)
        if any(component.loaded for component in quantities):
            columns |= self._force_columns(dict(self._forces(solver, ahead).columns()))
        return {name: component.number(columns) for name, component in zip(names, quantities, strict=True)}

    @cached_property
    def _nominal_motion(self) -> TracedMotion | None:
        """The nominal motion, from which others are solved; None if it passes a change point."""
        with suppress(AssemblyError):
            return followed_motion(self.solver, self.angles, self.rate)
        return None

    @cached_property
    def _nominal_unit_motion(self) -> TracedMotion | None:
        """The nominal motion per radian of the path parameter."""
        return None if self._nominal_motion is None else followed_motion(self.solver, self.angles)

    def _split_offset(self, dimensions: Mapping[str, float]) -> tuple[dict[str, float], float]:
        """Return the dimensions of the designs, and the crank offset in [rad]."""
        own = {name: value for name, value in dimensions.items() if name != self.offset}
        return own, dimensions.get(self.offset, 0.0)

    def _motion(self, solver: KinematicSolver, quantities: Sequence[Quantity], ahead: float) -> Motion:
        """Return the motion of another mechanism, solved on its own if Newton's method does not converge."""
        if self._nominal_motion is not None:
            with suppress(AssemblyError):
                return self._nominal_motion.with_dimensions(
                    solver.mechanism, ahead, MAX_DISPLACEMENT
                ).motion()
        motion = solver.solve_along(self.angles + ahead, self.rate)
        columns = [column for component in quantities for column in component.columns]
        if {column.name for column in columns if column.source == "joint"} <= dict(motion.columns()).keys():
            return motion
        return KinematicSolver(solver.mechanism).solve(self.angles + ahead, self.rate)

    def _forces(self, solver: KinematicSolver, ahead: float) -> InverseDynamics:
        model = self.dynamic_model(solver)
        if self._nominal_unit_motion is not None:
            with suppress(AssemblyError):
                unit = self._nominal_unit_motion.with_dimensions(solver.mechanism, ahead, MAX_DISPLACEMENT)
                return perturbed_forces(model, unit.motion(), self.rate)
        return prescribed_along(model, self.angles + ahead, self.rate)

    def derivatives(
        self, columns: Sequence[str], names: Sequence[str], changed: Mapping[str, float] | None = None
    ) -> QuantityDerivatives:
        """Return quantities and their exact derivatives by dimensions.

        Args:
            columns: quantities.
            names: dimensions, and `offset`.
            changed: dimension -> value in SI at which the derivatives are taken; None for the nominal values.

        Raises:
            AssemblyError: for loops that do not close, or a dimension that cannot change alone.
        """
        own, ahead = self._split_offset(changed or {})
        designs = family_at(self.designs, own)
        dimensions = [name for name in names if name != self.offset]

        def derivatives(*numbers: Callable[[Mapping[str, float]], Array]) -> dict[str, Array | None]:
            by_dimension = changes(designs, dimensions, *numbers)
            return {name: by_dimension.get(name) for name in names}

        moving = any(self.quantity(name).uses("point", "joint", "link") for name in columns)
        change = derivatives() if moving else None
        model_change = derivatives(self._numbers(designs)) if self.loaded(columns) else None
        return self._derivatives_by(designs.make({}), ahead, columns, change, model_change)

    def play(self, columns: Sequence[str], joint: str) -> list[Columns]:
        """Return derivatives by displacements of a joint's pin in its hole, normal to a hinge axis.

        One for each direction, per metre; masses do not move.

        Raises:
            AssemblyError: for a displacement that opens redundant loops.
        """
        mechanism = self.solver.mechanism
        names = [f"{joint}.b.at.{axis}" for axis in AXES]
        by_axis = np.array([*changes(placed_designs(KinematicSolver(mechanism)), names).values()])
        directions = mechanism.joint(joint).b.frame.T[: 3 if KINDS[mechanism.joint(joint).kind].ball else 2]
        change = {f"{joint}{CLEARANCE}{i}": direction @ by_axis for i, direction in enumerate(directions)}
        wide = None
        if self.loaded(columns):
            full = len(self._numbers(self.designs)({}))
            wide = {name: np.pad(direction, (0, full - len(direction))) for name, direction in change.items()}
        result = self._derivatives_by(self.solver, 0.0, columns, change, wide)
        return [dict(direction) for direction in result.by.values()]

    def _derivatives_by(
        self,
        solver: KinematicSolver,
        ahead: float,
        columns: Sequence[str],
        change: Mapping[str, Array | None] | None,
        model_change: Mapping[str, Array | None] | None,
    ) -> QuantityDerivatives:
        """Return quantities and derivatives by changes of a mechanism's and of a dynamic model's numbers."""
        quantities = [self.quantity(name) for name in columns]
        values: Columns = {}
        by: dict[str, Columns] = {name: {} for name in (change or model_change or {})}
        if change is not None:
            result = derivatives_along(self._followed(self._nominal_motion, solver, ahead, self.rate), change)
            values |= record_columns(result.motion, quantities)
            for name, motion in result.by.items():
                by[name] |= record_columns(motion, quantities)
        if model_change is not None:
            unit = self._followed(self._nominal_unit_motion, solver, ahead, 1.0)
            forces = forces_along(self.dynamic_model(solver), unit, model_change, self.rate)
            values |= self._force_columns(forces.columns)
            for name, moved in forces.by.items():
                by[name] |= self._force_columns(moved)
        return QuantityDerivatives(
            {component.name: component.number(values) for component in quantities},
            {
                name: {component.name: component.changes(values, own)[0] for component in quantities}
                for name, own in by.items()
            },
        )

    def _followed(
        self, nominal: TracedMotion | None, solver: KinematicSolver, ahead: float, rate: float
    ) -> TracedMotion:
        """Return the motion of another mechanism from this one, or from its own guess if that is too far."""
        if nominal is not None:
            with suppress(AssemblyError):
                return nominal.with_dimensions(solver.mechanism, ahead, MAX_DISPLACEMENT)
        return followed_motion(solver, self.angles + ahead, rate)

    def _numbers(self, designs: DesignFamily) -> Callable[[Mapping[str, float]], Array]:
        """Return a function that gives the numbers of a dynamic model for dimensions."""
        still = self.acting(designs.make({}))

        def numbers(values: Mapping[str, float]) -> Array:
            mechanism = with_inertia(designs.describe(values))
            # if a file defines the forces, its dimensions may change them
            forces = still if designs.forces is None else self.forces or designs.forces(values) or WEIGHT
            return model_numbers(mechanism, forces)

        return numbers


def family_at(designs: DesignFamily, values: Mapping[str, float]) -> DesignFamily:
    """Return the same parametric model with other nominal dimensions."""
    if not values:
        return designs
    own, forces = dict(values), designs.forces
    return replace(
        designs,
        dimensions={
            name: replace(dimension, value=own.get(name, dimension.value))
            for name, dimension in designs.dimensions.items()
        },
        describe=lambda more: designs.describe(own | dict(more)),
        make=lambda more: designs.make(own | dict(more)),
        forces=None if forces is None else lambda more: forces(own | dict(more)),
        derived={name: parameters for name, parameters in designs.derived.items() if name not in own},
    )


def spread_instants(solver: KinematicSolver) -> Array:
    """Return path parameters spread over the whole motion, (n,) in [rad].

    Instants of a crank that swings keep a distance from its dead centres, all others from change points:
    derivatives are unbounded there.

    Raises:
        AssemblyError: if the loops close at no crank angle.
    """
    motion_laws = solver.motion_laws
    if not motion_laws.crank:
        low, high, period = 0.0, motion_laws.length, np.inf
    elif (arcs := solver.crank_range()).full:
        low, high, period = 0.0, REVOLUTION, REVOLUTION
    else:
        if not arcs.arcs:
            raise no_crank_range_error(solver.name)
        low, high = max(arcs.arcs, key=lambda arc: arc[1] - arc[0])
        clear = DEAD_CENTRE_DISTANCE * (high - low)
        low, high, period = low + clear, high - clear, REVOLUTION
    angles = np.linspace(low, high, DEFAULT_INSTANTS)
    off = np.abs(angles[:, None] - np.array(solver.change_points()))
    return angles[(np.minimum(off, np.abs(off - period)) > CHANGE_POINT_DISTANCE * (high - low)).all(1)]
