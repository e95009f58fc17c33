"""Subjects of a trade-off: a mechanism with its exact motion, or a custom model with a much finer run."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import InputError
from mechsim.model.motion import Motion, select_instants
from mechsim.model.motion_laws import within_range
from mechsim.numerics.arrays import worst
from mechsim.numerics.convergence import half_extent, plausible_order
from mechsim.simulation.settings import Settings
from mechsim.simulation.source import Model
from mechsim.studies.tradeoff.methods import BuiltModel, build_model
from mechsim.verdict.quantities import QUANTITIES, motion_scales

# steps per revolution of the reference runs
FINE_STEPS = (3600, 7200, 14400)


def reference_runs(built: BuiltModel, name: str) -> dict[int, Motion]:
    """Return steps per revolution -> motion of the reference runs, in ascending order.

    Raises:
        InputError: if a run diverges.
    """
    runs: dict[int, Motion] = {}
    for count in FINE_STEPS:
        settings = Settings(steps_per_turn=count)
        motion, _ = built.motion(settings)
        if motion is None:
            raise InputError(
                f"{name} diverges at {count:,} steps a turn with {settings.integrator}, so no reference run "
                "is possible; reduce the stiffness of the moving bodies, or give them more damping or mass"
            )
        runs[count] = motion
    return runs


# compared quantities; the drive is compared with its profile
COMPARED = ("position", "velocity", "acceleration", "angle", "loop", "drive")
# ratio of the crank speed to its target above which a run counts as diverged
MAX_SPEED_RATIO = 1e6


@dataclass(frozen=True, slots=True)
class Reference:
    """The exact motion, or a much finer run, with which trials are compared.

    Attributes:
        what: description.
        exact: simulated motion -> true motion at the same instants.
        own_error: error of the reference by quantity, in the units of the errors; empty for a closed form.
        max_steps: largest number of steps per revolution of runs that can be compared with it.
    """

    what: str
    exact: Callable[[Motion], Motion]
    own_error: Mapping[str, float] = field(default_factory=dict)
    max_steps: float = np.inf


@dataclass(frozen=True, slots=True)
class Subject:
    """The mechanism or model on which the trade-off is measured.

    Attributes:
        name: name of the mechanism or file.
        built: its model.
        reference: reference of the trials.
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, in [rad/s].
    """

    name: str
    built: BuiltModel
    reference: Reference
    stroke: float
    speed: float

    def errors(self, motion: Motion | None) -> dict[str, float]:
        """Return the largest errors by quantity.

        Position and loop residual are in strokes, velocity and acceleration in strokes and crank speeds,
        angle and drive in [rad]; all are infinite for a diverged motion. The drive error is the distance of
        the crank from its profile. The other errors are measured at the actual crank angle.
        """
        if motion is None or not worst(motion.speed) <= MAX_SPEED_RATIO * self.speed:
            return dict.fromkeys(COMPARED, np.inf)
        errors = differences(motion, self.reference.exact(motion), self.stroke, self.speed)
        assert motion.time is not None
        return errors | {"drive": worst(motion.angle - self.built.profile.state(motion.time)[0])}


def differences(motion: Motion, exact: Motion, stroke: float, speed: float) -> dict[str, float]:
    """Return the largest differences of two motions at the same instants, as in `Subject.errors`."""
    scales = motion_scales(stroke, speed)
    return {name: QUANTITIES[name].largest(motion, exact, scales) for name in COMPARED[:-1]}


def subject_of(solver: KinematicSolver, speed: float) -> Subject:
    """Return a mechanism as a subject, with the closed form or the loop equations as its reference."""
    name = solver.name
    profile = within_range(solver.mechanism, solver.crank_range(), speed)
    angles = profile.state(np.linspace(0.0, profile.duration, 361))[0]
    solver = solver.starting_at(angles)
    stroke = half_extent(solver.positions(angles).values())
    reference = Reference(
        solver.method,
        lambda motion: solver.solve(motion.angle, motion.speed, motion.acceleration),
    )
    built = build_model(solver.mechanism, profile, speed)
    return Subject(name, built, reference, stroke, abs(speed))


def subject_of_model(source: Model, name: str, speed: float) -> Subject:
    """Return a custom model as a subject; its reference is a much finer run with an estimated error.

    Args:
        source: the model.
        name: name of the model.
        speed: crank speed, in [rad/s].

    Raises:
        AssemblyError: if the crank cannot make a full revolution.
        InputError: if a reference run diverges.
    """
    built = build_model(source, None, speed)
    runs = reference_runs(built, name)
    max_steps, fine = list(runs.items())[-1]
    stroke = half_extent(point.position for point in fine.points.values())
    if not stroke > 0.0:
        raise InputError(f"no tracked point of {name} moves; put a named site on a moving body")

    def exact(motion: Motion) -> Motion:
        return select_instants(fine, slice(None, None, (len(fine) - 1) // (len(motion) - 1)))

    before, last = (differences(a, b, stroke, abs(speed)) for a, b in pairwise(runs.values()))
    bar = {
        quantity: last[quantity] / (2.0 ** plausible_order(before[quantity], last[quantity], 2.0) - 1.0)
        for quantity in ("position", "velocity", "acceleration")
    }
    # differences between runs do not contain the loop-closure error
    bar["position"] = max(bar["position"], differences(fine, fine, stroke, abs(speed))["loop"])
    reference = Reference(f"a run of {max_steps} steps a turn", exact, bar, max_steps / 2)
    return Subject(name, built, reference, stroke, abs(speed))
