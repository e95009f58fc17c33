"""Evaluation points of a comparison: a mechanism, the instants, and the exact values there."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mechsim.compare.tolerances import RecordInstants
from mechsim.errors import AssemblyError, InputError
from mechsim.kinematics.loops.motion import conditioning_of
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.quantity import Column, Quantity, record_columns
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.studies.motions import profile_of

if TYPE_CHECKING:
    from mechsim.kinematics.derivatives.motion import TracedMotion
    from mechsim.kinetics.model import DynamicModel

Values = Sequence[Array]
# default number of instants of a comparison: every five degrees of a revolution, both ends included
INSTANTS = 73


@dataclass(frozen=True)
class EvaluationPoints:
    """A mechanism and the instants at which it is evaluated.

    Attributes:
        solver: the mechanism's solver.
        angle: path parameters, (n,) in [rad].
        speed: their rates, (n,) in [rad/s].
        acceleration: their second derivatives, (n,) in [rad/s2].
        time: (n,) in [s]; None if only angles are known.
        dynamic_model: with masses and forces; None takes the forces of the solver.
        solved: the motion, if it is already known; None solves for it.
        selecting: crank angles of a longer motion whose first angle selects the assembly; None takes `angle`.
    """

    solver: KinematicSolver
    angle: Array
    speed: Array
    acceleration: Array
    time: Array | None = None
    dynamic_model: "DynamicModel | None" = field(default=None, compare=False)
    solved: Motion | None = field(default=None, compare=False)
    selecting: Array | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        selecting = self.angle if self.selecting is None else self.selecting
        object.__setattr__(self, "selecting", selecting)
        if len(selecting):
            object.__setattr__(self, "solver", self.solver.starting_at(selecting, float(self.speed[0])))

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
        return self.solver.solve_along(self.angle, self.speed, self.acceleration)

    @cached_property
    def _perturbed(self) -> "TracedMotion | None":
        from mechsim.kinematics.derivatives.motion import followed_motion

        with suppress(AssemblyError):
            return followed_motion(self.solver, self.angle, self.speed, self.acceleration)
        return None

    @property
    def instants(self) -> RecordInstants:
        """Labels of the instants: crank angles, times of motion laws, or rows of a table without times."""
        if self.solver.motion_laws.crank:
            return RecordInstants(self.angle, "rad")
        if self.time is not None:
            return RecordInstants(self.time, "s")
        return RecordInstants(np.arange(1.0, len(self) + 1.0), "row")

    def with_dimensions(self, solver: KinematicSolver, *, similar: bool = True) -> "EvaluationPoints":
        """Return the points of a mechanism with other dimensions, under the same forces.

        A similar one without formulas is solved from this motion where possible.
        """
        model = solved = None
        if self.dynamic_model is not None:
            from mechsim.kinetics.model import dynamic_model

            model = dynamic_model(solver, self.dynamic_model.forces)
        if similar and solver.closed_form is None and self._perturbed is not None:
            solved = replace(self._perturbed.with_dimensions(solver.mechanism).motion(), origin=None)
        return replace(self, solver=solver, dynamic_model=model, solved=solved)

    @cached_property
    def conditioning(self) -> Array:
        """Distance of the loops from a singular pose, (n,), as used in verdicts."""
        return conditioning_of(self.solver.mechanism, self.motion)

    @cached_property
    def _of_loops(self) -> Motion:
        """The motion by the loop equations, which determine every coordinate."""
        if self.solved is not None:
            return self.motion
        loops = self.solver.with_mechanism(self.solver.mechanism)
        return loops.solve_along(self.angle, self.speed, self.acceleration)

    @cached_property
    def loaded_model(self) -> "DynamicModel":
        """The mechanism with its masses and forces."""
        from mechsim.kinetics.model import dynamic_model

        return self.dynamic_model or dynamic_model(self.solver)

    @cached_property
    def forces(self) -> ForceRecord:
        """Drive forces and joint reactions."""
        from mechsim.kinetics.prescribed_motion import prescribed_along

        run = prescribed_along(self.loaded_model, self.angle, self.speed, self.acceleration, time=self.time)
        return run.forces

    def drivers(self) -> dict[str, tuple[Array, Array, Array]]:
        """Return driver -> value, rate and acceleration, (n,) each in SI."""
        motion_laws = self.solver.motion_laws
        if self.solved is not None and not motion_laws.crank:
            # the actual driver positions, such as those of a run
            joints = {name: self.solved.joints[name] for name in motion_laws.drivers}
            return {name: (joint.value, joint.rate, joint.acceleration) for name, joint in joints.items()}
        value, first, second = motion_laws.along_path(self.angle)
        rate, change_of_rate = first * self.speed, first * self.acceleration + second * self.speed**2
        return {
            name: (value[i], rate[i], change_of_rate[i])
            for i, name in enumerate(self.solver.mechanism.drivers)
        }

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
            columns |= dict(self.forces.columns())
            driver_column = f"drive {self.solver.mechanism.drivers[0]}"
            columns.setdefault("torque", columns.get(driver_column, self.forces.torque))
        missing = [column.name for column in quantity.columns if column.name not in columns]
        if missing:
            raise InputError(f"{quantity.name}: {missing[0]} of {self.solver.name} is undetermined")
        return np.column_stack(quantity.components(columns))

    def _coordinate(self, column: Column) -> Array:
        """Return a joint coordinate, or a rate of it, that the motion does not contain, (n,)."""
        if column.subject in self.solver.mechanism.drivers:
            return self.drivers()[column.subject][column.order]
        columns = dict(self._of_loops.columns())
        if column.name not in columns:
            raise InputError(f"the coordinate {column.subject} of {self.solver.name} is undetermined")
        return columns[column.name]

    def change(self, motion: Motion, quantity: Quantity) -> Array:
        """Return the derivative of a quantity, (n, k), from the derivatives of a motion; not of forces.

        Raises:
            KeyError: for a quantity that the derivatives do not contain.
        """
        if quantity.loaded:
            raise KeyError(quantity.name)
        values, by = record_columns(self.motion, [quantity]), record_columns(motion, [quantity])
        for column in quantity.columns:
            if column.subject in self.solver.mechanism.drivers:
                values.setdefault(column.name, self.drivers()[column.subject][column.order])
                by[column.name] = np.zeros(len(self))
        return np.column_stack(quantity.changes(values, by))

    def all(self, quantities: Sequence[Quantity]) -> list[Array]:
        """Return the values of quantities, (n, k) each in SI."""
        return [self.exact(quantity) for quantity in quantities]


def evaluation_points(solver: KinematicSolver, speed: float) -> EvaluationPoints:
    """Return a solver at a crank speed in [rad/s] and instants over its range, evenly spaced with both ends.

    The range is a revolution, a stroke, or its motion laws.
    """
    profile = profile_of(solver, speed, solver.period / REVOLUTION)
    time = np.linspace(0.0, profile.duration, INSTANTS)
    return EvaluationPoints(solver, *profile.state(time), time)


def driver_inputs(evaluation: EvaluationPoints) -> Array | Mapping[str, Array]:
    """Return the arguments of a formula: crank angles, or the driver coordinates by name."""
    drivers = {name: state[0] for name, state in evaluation.drivers().items()}
    return next(iter(drivers.values())) if len(drivers) == 1 else drivers
