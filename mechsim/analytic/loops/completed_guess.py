"""Rough poses of the links of which the guess says nothing, drawn to where the guess puts the others."""

from collections.abc import Mapping

import numpy as np

from mechsim.analytic.loops.assembly import MAX_ROTATION, moved_poses
from mechsim.analytic.loops.loop_equations import equations, row_units, scaled
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism

# steps of Newton's method, which need not close anything; one so short that no more is gained, in [rad] and
# parts of the size; and singular values that are left out of them
STEPS, LAST_STEP, CUTOFF = 30, 1e-9, 1e-6


def completed_poses(mechanism: Mechanism, initial: Mapping[str, Pose]) -> dict[str, Pose] | None:
    """Return poses in which the links without a guess open the loops least while the others stand still.

    A chain of joints alone puts a leg somewhere, not towards the plate that it carries. None where all links
    have a guess, or none has.
    """
    free = np.array([link.name not in mechanism.guess for link in mechanism.links])
    if free.all() or not free.any():
        return None
    columns, size = np.repeat(free, 6), mechanism.size
    poses = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in initial.items()}
    for _ in range(STEPS):
        rows = equations(mechanism, poses, None)
        jacobian = scaled(mechanism, rows.jacobian)[0][:, columns]
        residual = (rows.residual * row_units(mechanism, rows.residual.shape[1]))[0]
        step = np.zeros(6 * len(free))
        step[columns] = -np.linalg.lstsq(jacobian, residual, rcond=CUTOFF)[0]
        if not float(np.abs(step).max()) > LAST_STEP:
            break
        step *= MAX_ROTATION / max(MAX_ROTATION, float(np.abs(step).max()))
        step = step.reshape(-1, 6) * np.repeat([size, 1.0], 3)
        poses = moved_poses(mechanism, poses, step.reshape(1, -1))
    return {name: Pose(pose.position[0], pose.rotation[0]) for name, pose in poses.items()}
