"""Degrees of freedom that the drivers of a scene leave undetermined."""

from collections.abc import Iterator

import numpy as np

from mechsim.errors import MechsimError
from mechsim.model.finding import Finding
from mechsim.numerics.arrays import Array
from mechsim.simulation import closed_model
from mechsim.simulation.findings.inspected import Inspected, null_space, rank
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.mjcf_reader.fixed_bodies import free_bodies
from mechsim.simulation.model_loops import BALL
from mechsim.simulation.undetermined_dofs import residual_mobility

# part of a freedom that is a motion of a joint, and no rounding
SIGNIFICANT = 1e-6
# names that are listed
MAX_LISTED = 6


def undetermined(scene: Inspected) -> Iterator[Finding]:
    """Yield what the drivers leave open, where something is."""
    # where nothing is driven, all is open, and nothing is wrong with that
    if not (scene.drivers and _has_undetermined(scene)):
        return
    model, (jacobian, _) = scene.model, scene.generic
    locked = [*scene.drivers, *scene.read.mechanism.locked]
    rows = np.eye(model.nv)[[int(model.joint(name).dofadr[0]) for name in locked]]
    free = null_space(np.vstack([jacobian, rows]))
    count, names = _representative_joints(scene, free)
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    listed = ", ".join(names[:MAX_LISTED]) + more
    floats = " or --fix-base" if free_bodies(model) else ""
    yield Finding(
        kind="open",
        what=listed,
        by=count,
        explains=0.0,
        message=f"{model.nv - rank(jacobian)} freedoms, {count} of them open with {', '.join(locked)} held: "
        f"{listed} can still move, and only springs, weight, friction and contacts say how",
        remedy=f"drive, hold or couple them (--drive, --lock{floats})",
    )


def _representative_joints(scene: Inspected, free: Array) -> tuple[int, list[str]]:
    """Return how many freedoms of (k, nv) are open, and a joint that moves by each.

    Balls are left out: what they alone let turn is a rod about its own line.
    """
    model, chosen, names = scene.model, list[int](), list[str]()
    for dof in range(model.nv):
        joint = int(model.dof_jntid[dof])
        if int(model.jnt_type[joint]) == BALL:
            continue
        if np.linalg.matrix_rank(free[:, [*chosen, dof]], tol=SIGNIFICANT) > len(chosen):
            chosen.append(dof)
            names.append(str(model.joint(joint).name))
    return len(chosen), list(dict.fromkeys(names))


def _has_undetermined(scene: Inspected) -> bool:
    """Say whether anything that matters can move with the drivers held; not where the loops never close."""
    try:
        with quiet():
            return (
                residual_mobility(closed_model.from_source(scene.read, drivers=scene.drivers)).undetermined
                != ()
            )
    except (MechsimError, np.linalg.LinAlgError):
        return False
