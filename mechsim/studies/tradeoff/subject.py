"""The subject of a trade-off: a mechanism with its exact motion."""

from dataclasses import dataclass

import numpy as np

from mechsim.compare.quantities import QUANTITIES, motion_scales
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import within_range
from mechsim.numerics.arrays import worst
from mechsim.numerics.convergence import half_extent
from mechsim.studies.tradeoff.methods import BuiltModel, build_model

# compared quantities; the drive is compared with its profile
COMPARED = ("position", "velocity", "acceleration", "angle", "loop", "drive")
# ratio of the crank speed to its target above which a run counts as diverged
MAX_SPEED_RATIO = 1e6


@dataclass(frozen=True, slots=True)
class Subject:
    """The mechanism on which the trade-off is measured.

    Attributes:
        name: name of the mechanism.
        built: its model.
        solver: its exact motion, with which trials are compared.
        stroke: half the largest extent of a point's path, in [m].
        speed: largest crank speed, in [rad/s].
    """

    name: str
    built: BuiltModel
    solver: KinematicSolver
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
        exact = self.solver.solve(motion.angle, motion.speed, motion.acceleration)
        scales = motion_scales(self.stroke, self.speed)
        errors = {name: QUANTITIES[name].largest(motion, exact, scales) for name in COMPARED[:-1]}
        assert motion.time is not None
        return errors | {"drive": worst(motion.angle - self.built.profile.state(motion.time)[0])}


def subject_of(solver: KinematicSolver, speed: float) -> Subject:
    """Return a mechanism as a subject, with its formulas or the loop equations as the reference.

    Raises:
        AssemblyError: if the crank cannot make its whole motion.
    """
    profile = within_range(solver.mechanism, solver.crank_range(), speed)
    angles = profile.state(np.linspace(0.0, profile.duration, 361))[0]
    solver = solver.starting_at(angles)
    stroke = half_extent(solver.positions(angles).values())
    return Subject(solver.name, build_model(solver.mechanism, profile), solver, stroke, abs(speed))
