"""Errors and cost of a run of a scene: closure, trajectory, torque, and cause of divergence."""

import copy
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array, worst
from mechsim.numerics.rank import significant
from mechsim.simulation.driven_run import limit_or_contact, near_singular, stiffness_cause
from mechsim.simulation.plain_settings import UNCHANGED, PlainSettings
from mechsim.simulation.poses.equations import ModelStates
from mechsim.studies.scene.run import RECORDS, SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene
from mechsim.units import Unit, parse_tolerance, si

By = Literal["closure", "trajectory", "torque"]
MEASURES: dict[By, str] = {
    "closure": "worst distance of a tracked point from the exact closure at the run's own drivers, in m",
    "trajectory": "worst distance of a tracked point from the scene's own limit at the same time, in m",
    "torque": "worst difference of an actuator's or drive's force from the scene's own limit, in N m or N",
}
UNITS: dict[str, Unit] = {"closure": "m", "trajectory": "m", "torque": "N m"}
# factor by which the step is reduced to test whether stiffness caused a divergence
STEP_RATIO = 8.0


@dataclass(frozen=True, slots=True)
class SceneErrors:
    """Largest errors of a run over its records; infinite for a diverged run, NaN if not measured.

    Attributes:
        closure: distance of a tracked point from the exact closure, in [m].
        trajectory: distance of a tracked point from the reference, in [m].
        torque: difference of an actuator or drive force from the reference, in [N m] or [N].
        drive_error: distance of a prescribed joint from its motion law, in [rad] or [m].
    """

    JSON: ClassVar[tuple[str, ...]] = ("closure", "trajectory", "torque", "drive=drive_error")

    closure: float = np.nan
    trajectory: float = np.nan
    torque: float = np.nan
    drive_error: float = 0.0

    def by(self, measure: By) -> float:
        """Return the error by a measure."""
        return float(getattr(self, measure))


def tolerance_in_si(value: float | str, by: str, measures: Iterable[str]) -> float:
    """Return a tolerance by one of some measures in SI; raise InputError for an invalid one."""
    if by not in measures:
        raise InputError(f"there is no error by {by!r}; choose from {', '.join(measures)}")
    if isinstance(value, str) and UNITS[by] == "m":
        value = parse_tolerance(value)
    tolerance = si(value, UNITS[by], "the tolerance")
    if not 0.0 < tolerance < np.inf:
        raise InputError(f"the tolerance is {value}; give a finite value above 0")
    return tolerance


DIVERGED = SceneErrors(np.inf, np.inf, np.inf, np.inf)


def deviation(run: SceneRun, reference: SceneRun) -> Array:
    """Return the displacements of a run's tracked points relative to another run, (n, k, 3) in [m]."""
    return run.points - cubic_interpolation(reference.time, reference.points, run.time)


def drive_error(run: SceneRun) -> float:
    """Return the largest distance of a prescribed joint from its motion law, in [rad] or [m]."""
    scene = run.scene
    addresses = scene.model.jnt_qposadr[[*scene.driven_joints.values()]]
    laws = zip(addresses, scene.joint_laws.values(), strict=True)
    return worst([worst(run.qpos[:, address] - law(run.time)[0]) for address, law in laws])


def cubic_interpolation(nodes: Array, values: Array, time: Array) -> Array:
    """Return values (n, ...) at increasing nodes (n,), interpolated by cubics through four neighbours."""
    if len(nodes) < 4:
        return values[np.searchsorted(nodes, time).clip(0, len(nodes) - 1)]
    first = np.clip(np.searchsorted(nodes, time) - 2, 0, len(nodes) - 4)
    x = nodes[first[:, None] + np.arange(4)]  # (m, 4)
    result = np.zeros((len(time), *values.shape[1:]))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        weight = np.prod((time[:, None] - x[:, others]) / (x[:, [i]] - x[:, others]), axis=1)
        result += weight.reshape(-1, *(1,) * (values.ndim - 1)) * values[first + i]
    return result


def sampled_run(run: SceneRun, samples: int) -> SceneRun:
    """Return evenly spaced records of a run, both ends included, interpolated between those of all its steps.

    A broken run is returned as it is.
    """
    if run.broken:
        return run
    every = run_scene(run.scene, run.model, records=None)
    instants = np.linspace(0.0, run.scene.duration, samples)
    qpos, qvel = (cubic_interpolation(every.time, values, instants) for values in (every.qpos, every.qvel))
    return replace(run, time=instants, qpos=qpos, qvel=qvel)


def start_error(scene: UserScene) -> float:
    """Return the largest distance of a tracked point from the exact closure at time zero, in [m]."""
    run = run_scene(scene, records=2, duration=float(scene.model.opt.timestep))
    return worst(scene.closure.errors(run.qpos[:1], run.points[:1]))


def divergence_reason(run: SceneRun) -> str:
    """Return the cause and position of a divergence as a clause; empty for a complete run."""
    if not run.broken:
        return ""
    full = run_scene(run.scene, run.model, records=None)
    cause = near_singular(full.time, _singularity_distance(full)) or limit_or_contact(
        run.model, full.time, full.qpos, full.qvel
    )
    if cause := cause or stiffness_cause(run.model):
        return cause
    fine = copy.copy(run.model)
    fine.opt.timestep /= STEP_RATIO
    if not run_scene(run.scene, fine, records=2).broken:
        return f"stiffness: a step {STEP_RATIO:g} times smaller does not diverge"
    return f"a step {STEP_RATIO:g} times smaller diverges too, as for contradictory loops"


def _force_error(run: SceneRun, reference: SceneRun) -> float:
    """Return the largest difference of the forces that exist in both runs, in [N m] or [N]."""
    references = reference.forces_by_name
    return worst(
        [
            worst(values - cubic_interpolation(reference.time, references[name], run.time))
            for name, values in run.forces_by_name.items()
            if name in references
        ]
    )


def _singularity_distance(run: SceneRun) -> Array:
    """Return the smallest relative singular value of the loops at each record, (n,); 1 without loops."""
    closure = run.scene.closure
    if not closure.equations.rows or not len(closure.free):
        return np.ones(len(run.qpos))
    with np.errstate(all="ignore"):
        jacobian = closure.equations.linearise(ModelStates(run.qpos))[1]
    matrix = np.moveaxis(jacobian[:, closure.free], -1, 0)
    valid = np.asarray(np.isfinite(matrix).all(axis=(1, 2)))
    values = np.linalg.svd(np.where(valid[:, None, None], matrix, 0.0), compute_uv=False)
    rank = int(significant(values[0], floor=0.0).sum())
    least = values[:, rank - 1] / values[0, rank - 1] if rank else np.ones(len(valid))
    return np.where(valid, least, 1.0)


@dataclass(frozen=True, slots=True)
class SceneTrial:
    """Evaluated settings.

    Attributes:
        settings: changes of the scene's own settings.
        errors: errors of the run.
        seconds: processor time of a simulated second, in [s].
    """

    settings: PlainSettings
    errors: SceneErrors
    seconds: float


@dataclass(frozen=True)
class SceneEvaluator:
    """Runs scenes and measures errors and cost; used by tune, reduce and the scene costs of tradeoff.

    Attributes:
        reference: run with the true points and forces over time; None without a comparison.
        closure: whether points are compared with the exact closure of the scene's loops.
        forces: whether forces are compared, which costs an evaluation in Python for each record.
    """

    reference: SceneRun | None = None
    closure: bool = True
    forces: bool = False

    def errors(self, run: SceneRun) -> SceneErrors:
        """Return the errors of a run."""
        if run.broken:
            return DIVERGED
        reference = self.reference
        closed = worst(run.scene.closure.errors(run.qpos, run.points)) if self.closure else np.nan
        if reference is None:
            return SceneErrors(closed, drive_error=drive_error(run))
        trajectory = worst(np.linalg.norm(deviation(run, reference), axis=2))
        torque = _force_error(run, reference.nodes) if self.forces else np.nan
        return SceneErrors(closed, trajectory, torque, drive_error(run))

    def evaluate(
        self,
        scene: UserScene,
        settings: PlainSettings = UNCHANGED,
        *,
        records: int | None = RECORDS,
        duration: float | None = None,
    ) -> SceneTrial:
        """Run a scene once with settings and return its errors and cost.

        Args:
            scene: the scene.
            settings: changes of its own settings.
            records: approximate number of compared instants; None for every step.
            duration: in [s]; None for the duration of the scene.
        """
        run = run_scene(scene, settings.applied(scene.model), records=records, duration=duration)
        return SceneTrial(settings, self.errors(run), run.seconds_per_second)
