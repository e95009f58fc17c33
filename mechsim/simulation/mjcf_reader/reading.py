"""An MJCF file as a mechanism, and as the model that MuJoCo runs of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.model.forces import Forces
from mechsim.model.mechanism import Mechanism
from mechsim.simulation.mjcf.silence import quiet
from mechsim.simulation.mjcf_reader import facts
from mechsim.simulation.mjcf_reader.driven_joints import driven, listed, meant, require_coordinate
from mechsim.simulation.mjcf_reader.equality_rows import equalities
from mechsim.simulation.mjcf_reader.held_still import free_bodies, free_joints, hold_still, turning_joints
from mechsim.simulation.mjcf_reader.joint_chains import chains, poses
from mechsim.simulation.mjcf_reader.kinds import BALL, FREE, SLIDE
from mechsim.simulation.mjcf_reader.mended_inertias import raised_mass
from mechsim.simulation.mjcf_reader.named_parts import name_parts
from mechsim.simulation.mjcf_reader.number_bounds import require_numbers
from mechsim.simulation.mjcf_reader.parsed_file import compiled_whole, parsed
from mechsim.simulation.mjcf_reader.tracked_points import Place, tracked
from mechsim.simulation.mjcf_reader.weights import acting, weighed

Held = float | None | Callable[[Literal["m", "rad"]], float]


@dataclass(frozen=True)
class MjcfModel:
    """What was read of an MJCF file.

    Attributes:
        path: of the file.
        mechanism: its links, joints, couplings, drivers and points; the guess is its start.
        spec: the file as MuJoCo is to run it: every body, joint and equality named, a site at every
            tracked point, free joints taken away where the base is held. Copy it before changing it.
        qpos: of the start, (nq,).
        gap: how far the loops stand open at the start, in [m].
        limits: joint -> its range in [m] or [rad].
        actuators: actuator -> the joints on which it acts.
        remarks: sentences on what was left out or changed.
        forces: gravity, and what acts in its hinges and slides.
        stilled: the file's joints, by their numbers, that were taken away as they are held where they start.
    """

    path: str
    mechanism: Mechanism
    spec: mujoco.MjSpec
    qpos: Array
    gap: float
    limits: Mapping[str, tuple[float, float]]
    actuators: Mapping[str, Sequence[str]]
    remarks: tuple[str, ...]
    forces: Forces = Forces()
    stilled: tuple[int, ...] = ()


@quiet()
def read_model(
    path: str,
    *,
    drivers: Sequence[str] = (),
    lock: Mapping[str, Held] | None = None,
    fix_base: bool = False,
    key: str | None = None,
    track: Sequence[str] = (),
    still: bool = False,
) -> MjcfModel:
    """Read an MJCF file as a mechanism.

    Args:
        path: of a file that MuJoCo loads.
        drivers: joints that are driven; empty takes those of actuators, else a hinge called crank.
        holds: joint -> value at which it is held in [m] or [rad], or a function that has it from the unit;
            None for that of the start, at which alone a ball or a free joint can be held.
        fix_base: whether bodies with free joints stand still.
        key: keyframe to start from; None takes the reference configuration.
        track: points, as `tracked` reads them.
        still: whether nothing need be driven.

    Raises:
        InputError: for a file, joint, keyframe or point that cannot be read; names it.
    """
    spec, _, remarks = parsed(path)
    name_parts(spec)
    model, _ = compiled_whole(path, spec)
    remarks += facts.idle_ranges(spec)
    start = _start(path, model, key)
    for one in list(spec.keys):  # they fit no model to which anything is added
        spec.delete(one)
    if fix_base and not free_bodies(model):
        raise InputError(f"{path}: no body has a free joint; leave out --fix-base")
    stilled, lock = _stilled(model, lock or {}, fix_base=fix_base)
    if stilled:
        remarks += _told_still(model, stilled)
        start = hold_still(spec, model, stilled, start)
        model, _ = compiled_whole(path, spec)
    require_numbers(path, spec, model, start)
    chained = chains(model)
    carried = chained.carriers
    said = equalities(model, carried)
    values = facts.coordinate_values(model, start)
    fixed = _held(model, lock, values)
    drives, raised = driven(model, drivers, list(fixed), still), raised_mass(remarks)
    points = tracked(model, carried, track)
    of = {model.body(b).name: carried[b] for b in range(model.nbody)}
    mechanism = Mechanism(
        name=spec.modelname or "model",
        links=facts.outlined(model, chained),
        joints=(*chained.joints, *said.joints),
        driver=drives[0] if len(drives) == 1 else drives,
        points={name: (of[body].link, of[body].point(place)) for name, (body, place) in points.items()},
        guess=poses(model, chained, start),
        couplings=tuple(said.couplings),
        locked=fixed,
        counted=values,
    )
    mechanism = replace(mechanism, links=weighed(model, mechanism.links, carried, mechanism.size, raised))
    if mechanism.has_crank:
        mechanism = replace(mechanism, start=values[drives[0]])
    _add_sites(spec, points)
    return MjcfModel(
        path,
        mechanism,
        spec,
        start,
        facts.gap(said.joints, mechanism.guess),
        facts.limits(model),
        facts.actuators(model),
        (*remarks, *said.remarks),
        acting(model),
        stilled,
    )


def _stilled(
    model: mujoco.MjModel, lock: Mapping[str, Held], *, fix_base: bool
) -> tuple[tuple[int, ...], dict[str, Held]]:
    """Return the balls and free joints that are held where they start, by their numbers, and other holds."""
    turning = turning_joints(model)
    named = {turning[name] for name, value in lock.items() if name in turning and value is None}
    found = tuple(sorted(named.union(free_joints(model) if fix_base else ())))
    return found, {name: value for name, value in lock.items() if turning.get(name) not in found}


def _told_still(model: mujoco.MjModel, joints: tuple[int, ...]) -> list[str]:
    """Say which bodies stand without their joints."""
    free = [model.body(model.jnt_bodyid[j]).name for j in joints if int(model.jnt_type[j]) == FREE]
    balls = [model.joint(j).name for j in joints if int(model.jnt_type[j]) == BALL]
    said = (("a free joint", free), ("the ball", balls))
    return [f"held where the model starts, without {what}: {listed(names)}" for what, names in said if names]


def _start(path: str, model: mujoco.MjModel, key: str | None) -> Array:
    """Return the coordinates of a keyframe, or of the reference configuration, (nq,)."""
    if key is None:
        return model.qpos0.copy()
    known = [model.key(k).name for k in range(model.nkey)]
    if key not in known:
        raise InputError(
            f"{path}: there is no keyframe {key!r}{meant(key, known)}; there are {listed(known)}"
        )
    return model.key_qpos[known.index(key)].copy()


def _held(model: mujoco.MjModel, holds: Mapping[str, Held], values: Mapping[str, float]) -> dict[str, float]:
    found: dict[str, float] = {}
    for name, value in holds.items():
        require_coordinate(model, name, "--lock")
        if callable(value):
            value = value("m" if int(model.joint(name).type[0]) == SLIDE else "rad")
        found[name] = values[name] if value is None else float(value)
        if not np.isfinite(found[name]):
            raise InputError(f"--lock {name} is at {value}; give a finite number in SI")
    return found


def _add_sites(spec: mujoco.MjSpec, points: Mapping[str, Place]) -> None:
    """Put a site at each tracked point that is none."""
    known = {site.name for site in spec.sites}
    for name, (body, place) in points.items():
        if name not in known:
            spec.body(body).add_site(name=name, pos=place)
