"""How far a run of a user's scene errs: by closure, by trajectory, by torque."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.studies.scenes.scene_limit import SceneLimit
from mechsim.studies.scenes.scene_run import SceneRun

By = Literal["closure", "trajectory", "torque"]
MEASURES: dict[By, str] = {
    "closure": "worst distance of a tracked point from the exact closure at the run's own drivers, in m",
    "trajectory": "worst distance of a tracked point from the scene's own limit at the same time, in m",
    "torque": "worst difference of an actuator's or drive's effort from the scene's own limit, in N m or N",
}


@dataclass(frozen=True, slots=True)
class SceneErrors:
    """Worst errors of a run; infinite where it broke, NaN where there is no limit to judge by.

    Attributes:
        closure: in [m].
        trajectory: in [m].
        torque: in [N m] or [N].
        drive: how far a prescribed joint is from its program, in [rad] or [m].
    """

    closure: float
    trajectory: float = np.nan
    torque: float = np.nan
    drive: float = 0.0

    def by(self, measure: By) -> float:
        """Return one of them."""
        return float(getattr(self, measure))

    def as_dict(self) -> dict[str, float]:
        """Return them by name."""
        return {name: getattr(self, name) for name in ("closure", "trajectory", "torque", "drive")}


def errors_of(run: SceneRun, limit: SceneLimit | None = None, *, torque: bool = True) -> SceneErrors:
    """Return how far a run errs.

    Args:
        run: the run.
        limit: of its scene; None leaves trajectory and torque unknown.
        torque: whether efforts are compared, which costs an evaluation in Python for each record.
    """
    if run.broken:
        return SceneErrors(np.inf, np.inf, np.inf, np.inf)
    closure = worst_distance(run.scene.closure.errors(run.qpos, run.points))
    if limit is None or limit.broken:
        return SceneErrors(closure, drive=drive_error(run))
    trajectory = worst_distance(np.linalg.norm(run.points - limit.points(run.time), axis=2))
    effort = worst_distance(np.abs(run.efforts - limit.efforts(run.time))) if torque else np.nan
    return SceneErrors(closure, trajectory, effort, drive_error(run))


def worst_distance(errors: Array) -> float:
    """Return the largest of errors, infinity where one is not a number."""
    largest = float(np.max(errors, initial=0.0))
    return largest if np.isfinite(largest) else np.inf


def drive_error(run: SceneRun) -> float:
    """Return how far the prescribed joints are from their programs, in [rad] or [m]."""
    scene = run.scene
    places = scene.model.jnt_qposadr[[*scene.driven_joints.values()]]
    gaps = [
        run.qpos[:, place] - state(run.time)[0]
        for place, state in zip(places, scene.drive.values(), strict=True)
    ]
    return max((worst_distance(np.abs(gap)) for gap in gaps), default=0.0)
