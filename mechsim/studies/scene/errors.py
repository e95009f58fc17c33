"""How far a run of a user's scene errs: by closure, by trajectory, by torque."""

import copy
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.divergence import limit_or_contact, near_singular, stiffness_cause
from mechsim.studies.scene.converged_reference import SceneLimit
from mechsim.studies.scene.evaluator import SceneRun, stepped
from mechsim.studies.scene.scene import UserScene

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


def start_error(scene: UserScene) -> float:
    """Return the worst distance of a tracked point from the exact closure at time zero, in [m]."""
    run = stepped(scene, records=2, duration=float(scene.model.opt.timestep))
    return worst_distance(scene.closure.errors(run.qpos[:1], run.points[:1]))


# a step that many times smaller tells whether stiffness broke it
FINER = 8.0


def why_broken(run: SceneRun) -> str:
    """Return in one clause what made a run diverge, with where that was seen; empty where it did not."""
    if not run.broken:
        return ""
    again = stepped(run.scene, run.model, records=None)
    seen = near_singular(again.time, _distance(again)) or limit_or_contact(
        run.model, again.time, again.qpos, again.qvel
    )
    if seen:
        return seen
    stiff = stiffness_cause(run.model)
    if stiff:
        return stiff
    fine = copy.copy(run.model)
    fine.opt.timestep /= FINER
    if not stepped(run.scene, fine, records=2).broken:
        return f"stiffness: a step {FINER:g} times smaller does not diverge"
    return f"what a step {FINER:g} times smaller does not mend either, as of loops that contradict each other"


def _distance(run: SceneRun) -> Array:
    """Return how far each state of a run is from a singular pose, (n,), 1 where nothing can be singular."""
    loops = run.scene.closure.loops
    if not loops.rows or not len(loops.unknown):
        return np.ones(len(run.qpos))
    with np.errstate(all="ignore"):
        slope = loops.linearise(run.scene.closure.coordinates(run.qpos))[1]
    matrix = np.moveaxis(slope[:, loops.unknown], -1, 0)
    good = np.asarray(np.isfinite(matrix).all((1, 2)), dtype=np.bool_).reshape(len(matrix))
    values = np.linalg.svd(np.where(good[:, None, None], matrix, 0.0), compute_uv=False)
    rank = int((values[0] > 1e-9 * values[0, 0]).sum())
    least = values[:, rank - 1] / values[0, rank - 1] if rank else np.ones(len(good))
    return np.where(good, least, 1.0)
