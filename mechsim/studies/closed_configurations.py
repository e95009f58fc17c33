"""Closed configurations of any model in MuJoCo's order of qpos; a mechanism is exported to MuJoCo first."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from mechsim.numerics.arrays import Array
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation import closed_configurations
from mechsim.simulation.closed_configurations import Sample
from mechsim.studies.robots.mujoco_models import quantity_of_joint, started_model


def closed_qpos(
    model: Any,
    values: Mapping[str, ArrayLike],
    *,
    set: Mapping[str, str | float] | None = None,
    loops: str | PathLike[str] | None = None,
    key: str | None = None,
    start: Mapping[str, str | float] | None = None,
) -> Array:
    """Return closed configurations in MuJoCo's order of qpos, (n, nq), in the assembly of the file.

    Args:
        model: an MJCF or URDF file, `mujoco.MjSpec`, `mujoco.MjModel`, or any argument of `load`, exported
            first.
        values: hinge or slide -> positions in [rad] or [m], scalar or (n,), or text, as "30deg". Joints that
            neither these nor the loops determine stay at the reference.
        set: parameter of a mechanism -> its value, as for `load`.
        loops: path of a sidecar file with the loop closures of a URDF file.
        key: name of the keyframe from which paths start; None is the reference.
        start: joint -> value as text or in SI; paths start in the nearest assembly.

    Raises:
        InputError: for an unknown joint, positions of different lengths, or a joint outside its limits.
        AssemblyError: for a loop that does not close on the path.

    Example:
        >>> ms.closed_qpos("four_bar", {"crank": "30deg"}).shape
        (1, 3)
    """
    started = started_model(model, set, loops, key, start)
    read = {
        name: quantity_of_joint(started.model, name, value) if isinstance(value, str) else value
        for name, value in values.items()
    }
    return closed_configurations.closed_qpos(started.model, read, started.initial)


def sample(
    model: Any,
    n: int,
    seed: int = 0,
    *,
    set: Mapping[str, str | float] | None = None,
    loops: str | PathLike[str] | None = None,
    progress: Progress = no_progress,
    key: str | None = None,
    start: Mapping[str, str | float] | None = None,
    fix_base: bool = False,
    lock_others: bool = False,
) -> Sample:
    """Return closed states drawn at random within the joint limits, in the assembly of the file.

    Args:
        model: as `closed_qpos` takes it.
        n: number of states.
        seed: of the random numbers; the same seed gives the same states.
        set: parameter of a mechanism -> its value, as for `load`.
        loops: path of a sidecar file with the loop closures of a URDF file.
        progress: called with a text and the finished fraction.
        key, start: as in `closed_qpos`.
        fix_base: whether free joints stay at the start.
        lock_others: whether joints without an actuator that the loops do not determine stay at the start.

    Raises:
        InputError: for a model without loops, too many states, or joint limits that few configurations
            satisfy.
        AssemblyError: for loops that do not close.

    Example:
        >>> ms.sample("four_bar", 100).qpos.shape
        (100, 3)
    """
    started = started_model(model, set, loops, key, start)
    return closed_configurations.sample(
        started.model, n, seed, progress, started.initial, fix_base=fix_base, lock_others=lock_others
    )
