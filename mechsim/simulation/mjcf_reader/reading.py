"""An MJCF file as a mechanism, and as the model that MuJoCo runs of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.model.forces import Forces
from mechsim.model.links import Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.silence import quiet
from mechsim.simulation.mjcf_reader import facts
from mechsim.simulation.mjcf_reader.driven_joints import did_you_mean, driven, listed, require_coordinate
from mechsim.simulation.mjcf_reader.element_names import name_elements
from mechsim.simulation.mjcf_reader.equality_constraints import equalities
from mechsim.simulation.mjcf_reader.fixed_bodies import (
    fix_bodies,
    free_bodies,
    free_joints,
    rotational_joints,
)
from mechsim.simulation.mjcf_reader.inertias_and_forces import forces_of_model, with_inertias
from mechsim.simulation.mjcf_reader.joint_chains import kinematic_tree, poses
from mechsim.simulation.mjcf_reader.joint_types import BALL, FREE, SLIDE
from mechsim.simulation.mjcf_reader.link_frames import Carrier
from mechsim.simulation.mjcf_reader.number_bounds import require_numbers
from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput, compile_repaired, model_label, parse_file
from mechsim.simulation.mjcf_reader.repaired_inertias import minimum_mass
from mechsim.simulation.mjcf_reader.tracked_points import BodyPoint, tracked

LockedAt = float | None | Callable[[Literal["m", "rad"]], float]


@dataclass(frozen=True)
class MjcfModel:
    """What was read of an MJCF file.

    Attributes:
        path: of the file, or how messages name the object.
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
    source: MujocoInput,
    *,
    drivers: Sequence[str] = (),
    lock: Mapping[str, LockedAt] | None = None,
    fix_base: bool = False,
    key: str | None = None,
    track: Sequence[str] = (),
    describe_only: bool = False,
) -> MjcfModel:
    """Read an MJCF or URDF file, or an object of MuJoCo, as a mechanism.

    Args:
        source: path of a file that MuJoCo loads, or an object, which stays unchanged.
        drivers: joints that are driven; empty takes those of actuators, else a hinge called crank.
        holds: joint -> value at which it is held in [m] or [rad], or a function that has it from the unit;
            None for that of the start, at which alone a ball or a free joint can be held.
        fix_base: whether bodies with free joints stand still.
        key: keyframe to start from; None takes the reference configuration.
        track: points, as `tracked` reads them.
        describe_only: whether nothing need be driven.

    Raises:
        InputError: for a file, joint, keyframe or point that cannot be read; names it.
    """
    path = model_label(source)
    spec, _, remarks = parse_file(source)
    name_elements(spec)
    model, _ = compile_repaired(path, spec)
    remarks += facts.ignored_ranges(spec)
    start = _start(path, model, key)
    for key_ in list(spec.keys):  # they fit no model to which anything is added
        spec.delete(key_)
    if fix_base and not free_bodies(model):
        raise InputError(f"{path}: no body has a free joint; leave out --fix-base")
    stilled, lock = _fixed_joints(model, lock or {}, fix_base=fix_base)
    if stilled:
        remarks += _fixed_remarks(model, stilled)
        start = fix_bodies(spec, model, stilled, start)
        model, _ = compile_repaired(path, spec)
    require_numbers(path, spec, model, start)
    tree = kinematic_tree(model)
    carriers = tree.carriers
    loops = equalities(model, carriers)
    values = facts.coordinate_values(model, start)
    locked = _locked_values(model, lock, values)
    driven_names, raised_to = driven(model, drivers, list(locked), describe_only), minimum_mass(remarks)
    points = tracked(model, carriers, track)
    mechanism = Mechanism(
        name=spec.modelname or "model",
        links=facts.with_outlines(model, tree),
        joints=(*tree.joints, *loops.joints),
        driver=driven_names[0] if len(driven_names) == 1 else driven_names,
        points=_link_points(model, carriers, points),
        guess=poses(model, tree, start),
        couplings=tuple(loops.couplings),
        locked=locked,
        counted=values,
    )
    links = with_inertias(model, mechanism.links, carriers, mechanism.size, raised_to)
    start_angle = values[driven_names[0]] if mechanism.has_crank else mechanism.start
    mechanism = replace(mechanism, links=links, start=start_angle)
    _add_sites(spec, points)
    return MjcfModel(
        path,
        mechanism,
        spec,
        start,
        facts.largest_gap(loops.joints, mechanism.guess),
        facts.limits(model),
        facts.actuators(model),
        (*remarks, *loops.remarks),
        forces_of_model(model),
        stilled,
    )


def _link_points(
    model: mujoco.MjModel, carriers: Sequence[Carrier], points: Mapping[str, BodyPoint]
) -> dict[str, tuple[str, Vector]]:
    """Return tracked points in the frames of links: name -> link and position."""
    carrier_of = {model.body(b).name: carriers[b] for b in range(model.nbody)}
    return {
        name: (carrier_of[body].link, carrier_of[body].point(position))
        for name, (body, position) in points.items()
    }


def _fixed_joints(
    model: mujoco.MjModel, lock: Mapping[str, LockedAt], *, fix_base: bool
) -> tuple[tuple[int, ...], dict[str, LockedAt]]:
    """Return the balls and free joints that are held where they start, by their numbers, and other holds."""
    rotational = rotational_joints(model)
    named = {rotational[name] for name, value in lock.items() if name in rotational and value is None}
    fixed = tuple(sorted(named.union(free_joints(model) if fix_base else ())))
    return fixed, {name: value for name, value in lock.items() if rotational.get(name) not in fixed}


def _fixed_remarks(model: mujoco.MjModel, joints: tuple[int, ...]) -> list[str]:
    """Say which bodies stand without their joints."""
    free = [model.body(model.jnt_bodyid[j]).name for j in joints if int(model.jnt_type[j]) == FREE]
    balls = [model.joint(j).name for j in joints if int(model.jnt_type[j]) == BALL]
    groups = (("a free joint", free), ("the ball", balls))
    return [
        f"held where the model starts, without {what}: {listed(names)}" for what, names in groups if names
    ]


def _start(path: str, model: mujoco.MjModel, key: str | None) -> Array:
    """Return the coordinates of a keyframe, or of the reference configuration, (nq,)."""
    if key is None:
        return model.qpos0.copy()
    names = [model.key(k).name for k in range(model.nkey)]
    if key not in names:
        raise InputError(
            f"{path}: there is no keyframe {key!r}{did_you_mean(key, names)}; there are {listed(names)}"
        )
    return model.key_qpos[names.index(key)].copy()


def _locked_values(
    model: mujoco.MjModel, lock: Mapping[str, LockedAt], values: Mapping[str, float]
) -> dict[str, float]:
    locked: dict[str, float] = {}
    for name, value in lock.items():
        require_coordinate(model, name, "--lock")
        if callable(value):
            value = value("m" if int(model.joint(name).type[0]) == SLIDE else "rad")
        locked[name] = values[name] if value is None else float(value)
        if not np.isfinite(locked[name]):
            raise InputError(f"--lock {name} is at {value}; give a finite number in SI")
    return locked


def _add_sites(spec: mujoco.MjSpec, points: Mapping[str, BodyPoint]) -> None:
    """Put a site at each tracked point that is none."""
    names = {site.name for site in spec.sites}
    for name, (body, position) in points.items():
        if name not in names:
            spec.body(body).add_site(name=name, pos=position)
