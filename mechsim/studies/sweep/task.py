"""A sweep as it is sent to workers: what is swept, what is measured, and over which poses."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.closure.many_motion import SharedLoops, shared_loops
from mechsim.errors import InputError, MechsimError
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.crank_profile import PART_OF_RANGE
from mechsim.model.forces import Forces
from mechsim.simulation.many.design_models import LikeModel, like_model
from mechsim.simulation.recorded_motion import CHUNK
from mechsim.simulation.settings import Settings
from mechsim.studies.sweep.designs import Designs
from mechsim.studies.sweep.measures import FACTS, TurnMeasure
from mechsim.studies.sweep.subject import SweptSubject

# outcomes of designs, as they are kept
OUTCOMES = (
    "met",
    "cannot assemble",
    "diverged",
    "undetermined",
    "overdriven",
    "missed",
    "changed assembly",
    "swings",
)
# outcomes of designs that were built
BUILT = ("met", "swings")
MET = 0
# distance of the first and last pose from the dead centres of a crank that swings, as a fraction of its
# reachable range
AT_ENDS = 1e-10
# parts of the distance of two recorded instants by which an angle may be beside one
ON_RECORD = 1e-6
# measures that each design is asked for by itself, where no formula is
ALONE = ("function", *FACTS)


@dataclass(frozen=True, slots=True)
class CrankRows:
    """Crank angles (..., poses) in [rad], speeds in [rad/s] and accelerations in [rad/s2] of designs."""

    angle: Array
    speed: Array
    acceleration: Array

    def some(self, rows: slice) -> "CrankRows":
        """Return those of some designs."""
        return CrankRows(self.angle[rows], self.speed[rows], self.acceleration[rows])


@dataclass(frozen=True)
class SweepTask:
    """A sweep.

    Attributes:
        subject: what is swept.
        designs: which.
        measures: of each.
        samples: poses a turn, or over programs.
        speed: of the crank in [rad/s]; programs have their own.
        settings: how designs are stepped in MuJoCo; None for motions by formulas and loop equations.
    """

    subject: SweptSubject
    designs: Designs
    measures: tuple[TurnMeasure, ...]
    samples: int
    speed: float
    settings: Settings | None = None

    def __getstate__(self) -> dict[str, Any]:
        # what was worked out from these is worked out again where it is wanted
        return {one.name: getattr(self, one.name) for one in fields(self)}

    @property
    def pace(self) -> float:
        """Speed of the crank or of the programs' clock in [rad/s]."""
        programs = self.subject.form.programs
        return self.speed if programs is None else programs.pace

    @cached_property
    def places(self) -> dict[float, int]:
        """Angle at which some measures are taken -> which of the poses that is."""
        asked = dict.fromkeys(one.angle for one in self.measures if one.angle is not None)
        return {angle: self.samples + i for i, angle in enumerate(asked)}

    @cached_property
    def angles(self) -> Array:
        """Angles of the crank or of the programs' clock, (poses,) in [rad]; empty where none is wanted."""
        if not any(one.turns for one in self.measures):
            return np.zeros(0)
        programs = self.subject.form.programs
        if programs is None:
            turn = TURN * np.arange(self.samples) / self.samples
        else:
            turn = np.linspace(0.0, programs.pace * programs.duration, self.samples)
        return np.concatenate([turn, [*self.places]])

    def within(self, low: ArrayLike, high: ArrayLike) -> CrankRows:
        """Return the crank's motion along which designs that swing are measured.

        Poses are spread evenly over the reachable range. Rates and forces have no bound at its ends: they are
        those of the swing that `simulate` makes, at instants spread evenly in time.

        Args:
            low: lower ends of reachable ranges, (...) in [rad].
            high: upper ends.
        """
        low, high = np.asarray(low)[..., None], np.asarray(high)[..., None]
        fixed = np.broadcast_to([*self.places], (*low.shape[:-1], len(self.places)))
        if self.rated or self.loaded:
            phase = TURN * np.arange(self.samples) / self.samples
            reach = 0.5 * PART_OF_RANGE * (high - low)
            angle = 0.5 * (low + high) - reach * np.cos(phase)
            speed = self.pace * np.sin(phase) + 0.0 * angle
            acceleration = self.pace**2 / reach * np.cos(phase)
        else:
            angle = low + np.linspace(AT_ENDS, 1.0 - AT_ENDS, self.samples) * (high - low)
            speed, acceleration = np.full_like(angle, self.pace), np.zeros_like(angle)
        rows = ((angle, fixed), (speed, np.full_like(fixed, self.pace)), (acceleration, np.zeros_like(fixed)))
        return CrankRows(*(np.concatenate(parts, -1) for parts in rows))

    @property
    def rated(self) -> bool:
        """Whether velocities or accelerations are needed."""
        return any(one.rated for one in self.measures)

    @property
    def loaded(self) -> bool:
        """Whether forces are needed."""
        return any(one.loaded for one in self.measures)

    @property
    def joints(self) -> list[str]:
        """The joints that are measured."""
        asked = (one.of for one in self.measures)
        return [*dict.fromkeys(of.subject for of in asked if of is not None and of.kind == "joint")]

    @property
    def turn(self) -> CrankRows:
        """The crank's motion along which designs are measured whose cranks turn fully, or laws drive."""
        angle = self.angles
        return CrankRows(angle, np.full_like(angle, self.pace), np.zeros_like(angle))

    @cached_property
    def together(self) -> SharedLoops | None:
        """What designs followed together have in common; None where each must be by itself."""
        form = self.subject.form
        alone = self.loaded or self.wants("transmission") or any(one.kind in ALONE for one in self.measures)
        if alone or getattr(form, "change_point", "smooth") != "smooth":
            return None
        with suppress(MechsimError):
            return shared_loops(form.mechanism, self.joints, form.programs)
        return None

    @cached_property
    def like(self) -> LikeModel | None:
        """The model by which designs are stepped together; None where each must be by itself."""
        form = self.subject.form
        alone = self.settings is None or self.wants("function") or self.samples > CHUNK
        if alone or form.programs is not None or (self.loaded and not self._weighed):
            return None
        with suppress(MechsimError):
            return like_model(form.mechanism, self.forces.gravity if self.loaded else None)
        return None

    @property
    def forces(self) -> Forces:
        """What acts on the subject as it stands."""
        return self.subject.form.forces or Forces()

    @property
    def _weighed(self) -> bool:
        """Whether the drive's torque against gravity and inertia is all that is asked of forces."""
        plain = self.forces == Forces(gravity=self.forces.gravity)
        efforts = {one.of.subject for one in self.measures if one.of is not None and one.of.kind == "effort"}
        return plain and efforts == {"torque"} and not self.accelerated

    @property
    def accelerated(self) -> bool:
        """Whether rates of points, or accelerations, are measured."""
        asked = [one.of for one in self.measures if one.of is not None]
        return any(of.part[:1] == "a" or (of.kind == "point" and of.part[:1] == "v") for of in asked)

    @property
    def intervals(self) -> int:
        """Between the poses of a stepped motion, whose last one is that in which it ends."""
        return self.samples if self.subject.form.programs is None else self.samples - 1

    @property
    def stride(self) -> int:
        """Steps from one pose to the next."""
        assert self.settings is not None
        return -(-self.settings.steps_per_turn // self.samples)

    @cached_property
    def records(self) -> NDArray[np.intp]:
        """Which of the recorded instants of a stepped motion the poses are, in the order of `angles`.

        Raises:
            InputError: for an angle at which something is measured and no instant is recorded.
        """
        programs, form = self.subject.form.programs, self.subject.form
        whole = TURN if programs is None else programs.pace * programs.duration
        begin = form.mechanism.start if programs is None else 0.0
        found = np.arange(self.samples)
        for angle in self.places:
            place = (angle - begin) / whole * self.intervals
            if abs(place - round(place)) > ON_RECORD:
                scale, unit = (1.0, "rad") if programs is None else (programs.pace, "s")
                raise InputError(
                    f"at {angle / scale:.6g} {unit} nothing is recorded, but every "
                    f"{whole / self.intervals / scale:.6g} {unit}; choose --samples so that a pose lies there"
                )
            found = np.append(found, round(place) % (self.samples if programs is None else self.samples + 1))
        return found

    def wants(self, kind: str) -> bool:
        """Whether a measure is of a kind, or of a quantity of a kind."""
        return any(kind == one.kind or (one.of is not None and one.of.kind == kind) for one in self.measures)


@dataclass
class Measured:
    """What was measured of some designs.

    Attributes:
        values: measure -> (n,) in SI; not a number where there is none.
        outcome: place in `OUTCOMES`, (n,).
        reason: why there is nothing, (n,); empty where it was built.
    """

    values: dict[str, Array]
    outcome: NDArray[np.int8]
    reason: NDArray[np.object_] = field(default_factory=lambda: np.zeros(0, dtype=object))

    def take(self, rows: NDArray[np.intp], found: Mapping[str, Array]) -> None:
        """Keep what was measured of some of the designs."""
        for name, values in found.items():
            self.values[name][rows] = values
        self.outcome[rows] = MET
        self.reason[rows] = ""

    def take_swings(
        self, rows: NDArray[np.intp], found: Mapping[str, Array], low: Array, high: Array
    ) -> None:
        """Keep what was measured of some designs whose cranks swing, and over which reachable range."""
        self.take(rows, found)
        self.outcome[rows] = OUTCOMES.index("swings")
        self.reason[rows] = [swings_between(*ends) for ends in zip(low, high, strict=True)]

    def refuse(self, rows: NDArray[np.intp], outcome: str, reason: str) -> None:
        """Say of some designs why there is nothing."""
        self.outcome[rows] = OUTCOMES.index(outcome)
        self.reason[rows] = reason


def swings_between(low: float, high: float) -> str:
    """Return in words over which reachable range, in [rad], a crank swings."""
    return f"the crank swings from {np.rad2deg(low):.6g} to {np.rad2deg(high):.6g} deg"


def nothing_measured(task: SweepTask, count: int) -> Measured:
    """Return a table of designs of which nothing is known."""
    values = {one.name: np.full(count, np.nan) for one in task.measures}
    return Measured(
        values, np.full(count, OUTCOMES.index("diverged"), dtype=np.int8), np.full(count, "", dtype=object)
    )
