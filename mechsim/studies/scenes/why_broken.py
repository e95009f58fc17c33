"""What made a run of a scene diverge: a singular pose, a limit, a contact, stiffness; in words."""

import copy

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.divergence_cause import limit_or_contact, near_singular
from mechsim.simulation.stiffest_element import stiffness_cause
from mechsim.studies.scenes.scene_run import SceneRun, stepped

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
