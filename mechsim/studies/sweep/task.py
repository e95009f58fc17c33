"""A sweep task, as workers receive it: subject, designs with their assembled poses, and measures."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import MechsimError
from mechsim.io.python_object import PythonObject
from mechsim.io.readers import open_model, parametric_model
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.formulas.closed_form import ClosedForm
from mechsim.kinematics.formulas.many_designs import allowed, can_be_started, closed_form_starts
from mechsim.kinematics.loops.design_motion import SharedLoops, shared_loops
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.design_arrays import StartedDesigns, similar_designs
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import SWING_FRACTION
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.studies.sweep.designs import Designs
from mechsim.studies.sweep.measures import MeasureSet, Turns, table_of

# outcomes of designs, stored by index
OUTCOMES = (
    "passed",
    "cannot assemble",
    "diverged",
    "underdetermined",
    "overdetermined",
    "swings",
    "not measured",
)
# outcomes of designs that were built
BUILT = ("passed", "swings")
PASSED = 0
# distance of the first and last pose from the dead centres of a crank that swings, as a fraction of its
# reachable range
END_DISTANCE = 1e-10


Rows = NDArray[np.intp]
# crank angles (..., poses) in [rad], speeds in [rad/s] and accelerations in [rad/s2] of designs
CrankRows = tuple[Array, Array, Array]


@dataclass(frozen=True)
class SweptSubject:
    """A subject and its designs.

    Attributes:
        name: as requested.
        solver: the nominal design.
        design_family: its parameters, and the function that makes its designs.
        closed: the formulas whose own parameters vary; None for other subjects.
        unitless: whether its parameters state no units, as arguments of a function in a Python file.
    """

    name: str
    solver: KinematicSolver
    design_family: DesignFamily
    closed: ClosedForm | None
    unitless: bool


def swept_subject(
    model: str | KinematicSolver | Mechanism, set: Mapping[str, str | float] | None = None, **options: Any
) -> SweptSubject:
    """Return the subject of a sweep.

    Args:
        model: as for `load`, or a solver.
        set: parameter -> its value, as for `load`.
        options: further arguments of `load`.

    Raises:
        InputError: as for `load`.
    """
    source = open_model(model)
    designs = parametric_model(source, set, **options)
    solver = designs.make({})
    unitless = isinstance(source, PythonObject) and bool(source.parameters({}).dimensions)
    name = model if isinstance(model, str) else solver.name
    closed = None if unitless else solver.closed_form
    return SweptSubject(name, solver, designs, closed, unitless)


@dataclass(frozen=True)
class SweepTask:
    """A sweep that workers can execute.

    Attributes:
        subject: the mechanism and its parameters.
        designs: the parameter values.
        measures: evaluated for each design.
        samples: number of poses in a revolution, or over motion laws.
        speed: crank speed in [rad/s]; motion laws have their own.
    """

    subject: SweptSubject
    designs: Designs
    measures: MeasureSet
    samples: int
    speed: float

    @property
    def path_speed(self) -> float:
        """Rate of the path parameter in [rad/s]."""
        return self.subject.solver.motion_laws.path_speed(self.speed)

    @cached_property
    def angle_index(self) -> dict[float, int]:
        """Angle of a measure -> index of its pose."""
        requested = dict.fromkeys(measure.angle for measure in self.measures if measure.angle is not None)
        return {angle: self.samples + i for i, angle in enumerate(requested)}

    @cached_property
    def angles(self) -> Array:
        """Path parameters of the poses, (poses,) in [rad]."""
        return np.concatenate([self.subject.solver.motion_laws.spread(self.samples), [*self.angle_index]])

    def within(self, low: ArrayLike, high: ArrayLike) -> CrankRows:
        """Return the crank motion over which designs that swing are measured.

        Poses are spread evenly over the reachable range. Rates and forces are unbounded at its ends: they are
        evaluated along the swing of `simulate`, at instants spread evenly in time.

        Args:
            low: lower ends of reachable ranges, (...) in [rad].
            high: upper ends.
        """
        low, high = np.asarray(low)[..., None], np.asarray(high)[..., None]
        fixed = np.broadcast_to([*self.angle_index], (*low.shape[:-1], len(self.angle_index)))
        if self.measures.rated or self.measures.loaded:
            phase = REVOLUTION * np.arange(self.samples) / self.samples
            reach = 0.5 * SWING_FRACTION * (high - low)
            angle = 0.5 * (low + high) - reach * np.cos(phase)
            speed = self.path_speed * np.sin(phase) + 0.0 * angle
            acceleration = self.path_speed**2 / reach * np.cos(phase)
        else:
            angle = low + np.linspace(END_DISTANCE, 1.0 - END_DISTANCE, self.samples) * (high - low)
            speed, acceleration = np.full_like(angle, self.path_speed), np.zeros_like(angle)
        return (
            np.concatenate([angle, fixed], -1),
            np.concatenate([speed, np.full_like(fixed, self.path_speed)], -1),
            np.concatenate([acceleration, np.zeros_like(fixed)], -1),
        )

    @property
    def single_only(self) -> bool:
        """Whether designs are solved one at a time, as for forces: each has its own equations of motion."""
        return self.measures.loaded or self.measures.includes("function")

    @property
    def revolution(self) -> CrankRows:
        """The crank motion over which designs that turn fully or follow motion laws are measured."""
        angle = self.angles
        return angle, np.full_like(angle, self.path_speed), np.zeros_like(angle)

    @cached_property
    def loops(self) -> SharedLoops | None:
        """The common loops of designs traced together; None if they are solved one at a time."""
        solver = self.subject.solver
        if self.single_only or solver.change_point != "smooth":
            return None
        with suppress(MechsimError):
            return shared_loops(solver.mechanism, self.measures.joints, solver.motion_laws)
        return None

    def values(self, turns: Turns) -> dict[str, Array]:
        """Return all measures of designs from their motions: name -> (designs,)."""
        return table_of(self.measures, turns, self.angle_index)

    def unmeasured(self, count: int) -> "Measured":
        """Return an empty table of designs."""
        values = {measure.name: np.full(count, np.nan) for measure in self.measures}
        outcome = np.full(count, OUTCOMES.index("diverged"), dtype=np.int8)
        return Measured(values, outcome, np.full(count, "", dtype=object))

    def assembled(self, rows: Mapping[str, Array]) -> tuple[StartedDesigns, Rows] | None:
        """Return the designs that can be made and have equal topology, with their initial poses and indices.

        Args:
            rows: parameter -> its value in each design.

        Returns:
            None if there are none.
        """
        formula = self.subject.closed
        if formula is not None and can_be_started(formula, rows):
            valid = np.flatnonzero(allowed(formula, rows))
            while len(valid):
                started = closed_form_starts(formula, {name: values[valid] for name, values in rows.items()})
                finite = [np.isfinite(pose.rotation).all((1, 2)) for pose in started.guess.values()]
                assembled = np.all(finite, axis=0)
                if assembled.all():
                    return started, valid
                valid = valid[assembled]
            return None
        designs, mechanisms = self.subject.design_family, list[Mechanism | None]()
        for i in range(len(next(iter(rows.values())))):
            mechanisms.append(None)
            with suppress(MechsimError, ArithmeticError, ValueError):
                own = {name: float(values[i]) for name, values in rows.items()}
                # an unassembled one is made faster; formulas have the guess
                mechanisms[i] = designs.describe(own) if formula is None else designs.make(own).mechanism
        similar, which = similar_designs(self.subject.solver.mechanism, mechanisms)
        return None if similar is None else (similar, which)


@dataclass
class Measured:
    """Measures of some designs.

    Attributes:
        values: measure -> (n,) in SI; NaN without a value.
        outcome: index in `OUTCOMES`, (n,).
        reason: why a design was not built, (n,); empty otherwise.
    """

    values: dict[str, Array]
    outcome: NDArray[np.int8]
    reason: NDArray[np.object_]

    def store(self, rows: Rows, result: Mapping[str, Array]) -> None:
        """Store measures of some of the designs."""
        for name, values in result.items():
            self.values[name][rows] = values
        self.outcome[rows] = PASSED
        self.reason[rows] = ""

    def store_finite(
        self,
        rows: Rows,
        result: Mapping[str, Array],
        valid: NDArray[np.bool_] | Literal[True] = True,
        swings: tuple[Array, Array] | None = None,
    ) -> Rows:
        """Store the measures of the designs with finite values only; return these designs.

        Args:
            rows: designs, (n,).
            result: measure -> (n,).
            valid: which of them may be stored, (n,).
            swings: lower and upper ends of the reachable ranges, (n,) each in [rad], of cranks that swing.
        """
        finite = valid & np.all([np.isfinite(values) for values in result.values()], axis=0)
        stored = rows[finite]
        self.store(stored, {name: values[finite] for name, values in result.items()})
        if swings is not None:
            low, high = (ends[finite] for ends in swings)
            self.outcome[stored] = OUTCOMES.index("swings")
            self.reason[stored] = [swings_between(*ends) for ends in zip(low, high, strict=True)]
        return stored

    def reject(self, rows: Rows, outcome: str, reason: str) -> None:
        """Store outcome and reason of some designs."""
        self.outcome[rows] = OUTCOMES.index(outcome)
        self.reason[rows] = reason


def swings_between(low: float, high: float) -> str:
    """Return the reason text of a crank that swings over a reachable range in [rad]."""
    return f"the crank swings from {np.rad2deg(low):.6g} to {np.rad2deg(high):.6g} deg"
