"""Reads an MJCF file as a mechanism and as a MuJoCo model."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.link_poses import spin_rod
from mechsim.mechanism.links import GROUND, IDENTITY, Inertia, Link, Pose, Vector, combine, rows
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import LinkMotion
from mechsim.numerics.arrays import ROUNDING, Array
from mechsim.simulation import state
from mechsim.simulation.mjcf.compiling import compiled, quiet
from mechsim.simulation.mjcf_reader import coordinates, parsed_file
from mechsim.simulation.mjcf_reader.coordinates import actuated_joints, actuator_names
from mechsim.simulation.mjcf_reader.equality_constraints import equalities
from mechsim.simulation.mjcf_reader.file_errors import readable_error, require_numbers
from mechsim.simulation.mjcf_reader.fixed_bodies import COORDINATES, fix_bodies, free_joints
from mechsim.simulation.mjcf_reader.forces import forces_of_model
from mechsim.simulation.mjcf_reader.kinematic_tree import KinematicTree, kinematic_tree, link_name, poses
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput, compile_repaired, model_label
from mechsim.simulation.mjcf_reader.pose_chains import with_pose_chains
from mechsim.simulation.mjcf_reader.repairs import minimum_mass
from mechsim.simulation.state import BALL, FREE, SCALAR, SLIDE, quaternion, rotation_matrix, scalar_joints


def with_outlines(model: mujoco.MjModel, chain: KinematicTree) -> tuple[Link, ...]:
    """Return the moving links, with points of their geoms if the joints of each link share one point."""
    ends = {(end.link, end.point) for joint in chain.joints for end in (joint.a, joint.b)}
    moving = [link for link, _ in ends if link != GROUND]
    if len(moving) > len({*moving}):
        return chain.links
    outlines = {link.name: list[Vector]() for link in chain.links}
    for body, carrier in enumerate(chain.carriers):
        if carrier.link in outlines:
            points = [model.body_ipos[body]]
            # two opposite corners of the bounding box of each geom
            for geom in np.flatnonzero(model.geom_bodyid == body):
                rotation = rotation_matrix(model.geom_quat[geom])
                centre, half = np.split(model.geom_aabb[geom], 2)
                points += [
                    model.geom_pos[geom] + rotation @ corner for corner in (centre - half, centre + half)
                ]
            outlines[carrier.link] += [carrier.point(point) for point in points]
    return tuple(Link(link.name, tuple(outlines[link.name])) for link in chain.links)


def with_inertias(model: mujoco.MjModel, chain: KinematicTree, raised: float) -> tuple[Link, ...]:
    """Return the moving links with their outlines and the inertias of all their bodies.

    Args:
        model: the compiled model.
        chain: its links and joints.
        raised: mass in [kg] assigned to massless bodies; 0 if there are none.
    """
    links, carriers = with_outlines(model, chain), chain.carriers
    bodies = {link.name: list[int]() for link in links}
    for i, carrier in enumerate(carriers):
        if carrier.link in bodies:
            bodies[carrier.link].append(i)
    if not any(model.body_mass[i] > 0.0 for own in bodies.values() for i in own):
        return links

    def inertia(own: Sequence[int]) -> Inertia:
        """Return the inertia of the bodies on one link, in its frame."""
        inertias: list[Inertia] = []
        for i in own if any(model.body_mass[i] > 0.0 for i in own) else ():
            axes = carriers[i].pose.rotation @ rotation_matrix(model.body_iquat[i])
            moments = rows(axes @ np.diag(model.body_inertia[i]) @ axes.T)
            centre = carriers[i].point(model.body_ipos[i])
            inertias.append(Inertia(float(model.body_mass[i]), centre, moments))
        whole = combine(inertias)
        return replace(whole, negligible=not whole.mass > raised * len(own) * (1.0 + ROUNDING))

    return tuple(replace(link, inertia=inertia(bodies[link.name])) for link in links)


# kind of element, its range, and the attribute that activates the range
_RANGES = (
    ("joint", "range", "limited"),
    ("tendon", "range", "limited"),
    ("actuator", "ctrlrange", "ctrllimited"),
    ("actuator", "forcerange", "forcelimited"),
)


LockedAt = float | None | Callable[[Literal["m", "rad"]], float]


@quiet()
def read_model(
    source: MujocoInput,
    *,
    drivers: Sequence[str] = (),
    lock: Mapping[str, LockedAt | Vector] | None = None,
    fix_base: bool = False,
    key: str | None = None,
    track: Sequence[str] = (),
    describe_only: bool = False,
    lint: bool = False,
) -> MjcfModel:
    """Read an MJCF or URDF file, or an object of MuJoCo, as a mechanism.

    Args:
        source: path of a file that MuJoCo loads, or an object, which remains unchanged.
        drivers: driven joints; if empty, the joints with actuators, or a hinge named crank.
        lock: joint -> locked value in [m] or [rad], or a function from the unit to this value. None locks a
            joint at its initial value, the only choice for a free joint; a vector is the axis of one rotation
            of a ball, as in `spin_rod`.
        fix_base: whether bodies with free joints are fixed at their initial poses.
        key: keyframe of the initial state; None for the reference configuration.
        track: points, as `tracked` reads them.
        describe_only: whether a model without drivers is allowed.
        lint: whether to read the file for the linter: the first keyframe, if any, is the initial state,
            meshes become boxes, and equalities that are no joint or coupling remain, with a remark.

    Raises:
        InputError: if a file, joint, keyframe or point cannot be read, with its name.
    """
    path = model_label(source)
    parse = parsed_file.parse_without_meshes if lint else parsed_file.parse_file
    spec, parsed_model, remarks, unread = parse(source)
    try:
        parsed_file.name_elements(spec)
    except ValueError as error:  # MuJoCo reports a repeated name in a URDF file only here
        raise readable_error(path, error) from None
    model, _ = compile_repaired(path, spec, unread if lint else None)
    remarks += _limits_left_out(spec)
    start = model.key_qpos[0].copy() if lint and model.nkey else parsed_file.initial_qpos(path, model, key)
    keyframes = tuple(key_.name for key_ in spec.keys if key_.name)
    for key_ in list(spec.keys):  # keyframes do not fit a model with added elements
        spec.delete(key_)
    if fix_base and not free_joints(model):
        raise InputError(f"{path}: no body has a free joint; leave out --fix-base")
    spins = {name: value for name, value in (lock or {}).items() if isinstance(value, tuple)}
    locks = {name: value for name, value in (lock or {}).items() if not isinstance(value, tuple)}
    # ball and free joints that are locked
    rotational = {model.joint(j).name: j for j in range(model.njnt) if int(model.jnt_type[j]) in COORDINATES}
    named = {rotational[name] for name, value in locks.items() if name in rotational and value is None}
    fixed = tuple(sorted(named.union(free_joints(model) if fix_base else ())))
    locks = {name: value for name, value in locks.items() if rotational.get(name) not in fixed}
    if fixed:
        remarks += _fixed_remarks(model, fixed)
        start = fix_bodies(spec, model, fixed, start)
        model, _ = compile_repaired(path, spec)
    if spins:
        model = _with_locked_spins(spec, model, start, spins)
    model, start = with_pose_chains(spec, model, start, drivers)
    require_numbers(path, spec, model, start)
    tree = kinematic_tree(model)
    loops, couplings, omitted = equalities(model, tree.carriers, skip_others=lint)
    points = coordinates.tracked(model, tree.carriers, track)
    locked = _locked(model, start, locks)
    names = coordinates.driven(model, drivers, list(locked), describe_only or lint)
    carrier_of = {model.body(b).name: carrier for b, carrier in enumerate(tree.carriers)}
    values = {name: float(start[model.jnt_qposadr[j]]) for name, j in scalar_joints(model).items()}
    mechanism = Mechanism(
        name=spec.modelname or "model",
        links=with_inertias(model, tree, minimum_mass(remarks)),
        joints=(*tree.joints, *loops),
        driver=names[0] if len(names) == 1 else names,
        points={
            name: (carrier_of[body].link, carrier_of[body].point(position))
            for name, (body, position) in points.items()
        },
        guess=poses(model, tree, start),
        couplings=couplings,
        locked=locked,
        guess_coordinates=values,
    )
    if mechanism.has_crank:
        mechanism = replace(mechanism, start=values[names[0]])
    # the linter reports negative damping instead of rejecting it, and needs no forces
    forces, left_out = (Forces(), ()) if lint else forces_of_model(model, tree.carriers, locked)
    # add a site at each tracked point that is not a site
    sites = {site.name for site in spec.sites}
    for name, (body, position) in points.items():
        if name not in sites:
            spec.body(body).add_site(name=name, pos=position)
    # the largest distance in [m] between the points that loop-closing joints make coincident
    frames = {GROUND: IDENTITY, **mechanism.guess}
    offsets = [
        frames[joint.b.link].point(joint.b.point) - frames[joint.a.link].point(joint.a.point)
        for joint in loops
    ]
    return MjcfModel(
        path=path,
        source=source,
        mechanism=mechanism,
        spec=spec,
        qpos=start,
        gap=max((float(np.linalg.norm(offset)) for offset in offsets), default=0.0),
        limits={
            model.joint(j).name: (float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1]))
            for j in state.limited_joints(model).tolist()
        },
        actuators={name: actuated_joints(model, a) for a, name in enumerate(actuator_names(model))},
        remarks=(*remarks, *omitted),
        forces=forces,
        fixed=fixed,
        left_out=left_out,
        with_meshes=parsed_model if lint else None,
        unread=tuple(unread),
        keyframes=keyframes,
    )


def _locked(model: mujoco.MjModel, start: Array, lock: Mapping[str, LockedAt]) -> dict[str, float]:
    """Return the values of locked joints, in [m] or [rad]; by default those of the initial state."""
    locked: dict[str, float] = {}
    for name, value in lock.items():
        coordinates.require_coordinate(model, name, "--lock")
        if callable(value):
            value = value("m" if int(model.joint(name).type[0]) == SLIDE else "rad")
        own = start[model.jnt_qposadr[model.joint(name).id]]
        locked[name] = float(own if value is None else value)
        if not np.isfinite(locked[name]):
            raise InputError(f"--lock {name} is at {value}; give a finite number in SI")
    return locked


def _limits_left_out(spec: mujoco.MjSpec) -> list[str]:
    """Return sentences on ranges that are no limit to MuJoCo."""
    return [
        f"{kind} {element.name!r} has {attribute} {low:g} {high:g}, which MuJoCo takes as no limit: "
        "it goes from low to high"
        for kind, attribute, flag in _RANGES
        for element in getattr(spec, f"{kind}s")
        for low, high in [getattr(element, attribute)]
        if getattr(element, flag) == mujoco.mjtLimited.mjLIMITED_AUTO and not low < high and (low or high)
    ]


def _fixed_remarks(model: mujoco.MjModel, fixed: Sequence[int]) -> list[str]:
    """Return sentences on the ball and free joints that are removed."""
    free = [model.body(model.jnt_bodyid[j]).name for j in fixed if int(model.jnt_type[j]) == FREE]
    balls = [model.joint(j).name for j in fixed if int(model.jnt_type[j]) == BALL]
    groups, start = (("a free joint", free), ("the ball", balls)), "held where the model starts, without"
    return [f"{start} {what}: {coordinates.listed(names)}" for what, names in groups if names]


def _with_locked_spins(
    spec: mujoco.MjSpec, model: mujoco.MjModel, start: Array, spins: Mapping[str, Vector]
) -> mujoco.MjModel:
    """Add the rods that lock one rotation of balls each, and return the model with them."""
    from mechsim.simulation.mjcf.equalities import add_rod

    tree = kinematic_tree(model)
    at_start, reference = ({GROUND: IDENTITY, **poses(model, tree, q)} for q in (start, model.qpos0))
    bodies = {link_name(model, body.id): body for body in spec.bodies} | {GROUND: spec.worldbody}
    for joint in tree.joints:
        if joint.name in spins:
            add_rod(spec, spin_rod(joint, spins[joint.name], at_start), bodies, reference)
    return compiled(spec)


def states_of(
    model: mujoco.MjModel, values: Mapping[str, Array], links: Mapping[str, Pose | LinkMotion]
) -> Array:
    """Return the coordinates of a model at n configurations of the mechanism read from it, (n, nq).

    Balls and free joints follow from the poses of links.

    Args:
        model: model compiled from `MjcfModel.spec`.
        values: hinge or slide -> its values, (n,).
        links: link -> its n poses.
    """
    tree = kinematic_tree(model)
    out = np.repeat(model.qpos0[None], len(next(iter(links.values())).position), 0)
    for j, joint in enumerate(tree.joints):
        address = int(model.jnt_qposadr[j])
        if int(model.jnt_type[j]) in SCALAR:
            out[:, address] = values[joint.name]
            continue
        link = links[link_name(model, int(model.jnt_bodyid[j]))]
        rotations = link.rotation @ joint.b.frame
        if int(model.jnt_type[j]) == FREE:
            out[:, address : address + 3] = link.position
            address += 3
        elif joint.a.link == GROUND:
            rotations = joint.a.frame.T @ rotations
        else:
            rotations = np.swapaxes(links[joint.a.link].rotation @ joint.a.frame, -1, -2) @ rotations
        for row, rotation in zip(out, rotations, strict=True):
            row[address : address + 4] = quaternion(rotation)
    return out
