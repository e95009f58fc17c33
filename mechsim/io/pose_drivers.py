"""Drivers that are coordinates of a point, or the position or rotation of a link: inverse kinematics.

A chain of slides from the ground to the point, closed by a spherical joint, has the coordinates of the point
as joint coordinates and leaves the mobility unchanged. Three hinges instead of the spherical joint add the
rotation of a link. Both methods then solve an ordinary mechanism whose drivers are joints of the chain.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.joint_kinds import KindName
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import EX, EY, EZ, GROUND, ORIGIN, VIRTUAL_PREFIX, Inertia, Link, Pose, Vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import State
from mechsim.mechanism.quantities import moving_points
from mechsim.numerics.arrays import Array

POSITIONS, ROTATIONS = ("x", "y", "z"), ("rx", "ry", "rz")
DIRECTIONS: tuple[Vector, ...] = (EX, EY, EZ)
# reference directions of the axes of a chain
REFERENCES: tuple[Vector, ...] = (EY, EZ, EX)
# inertia of a link of a chain: negligible for any motor, but accepted by MuJoCo
NEGLIGIBLE = Inertia(1e-9, ORIGIN, ((1e-12, 0.0, 0.0), (0.0, 1e-12, 0.0), (0.0, 0.0, 1e-12)))
# smallest distance from ry = 90 deg, in [rad], at which rz and rx are distinct
GIMBAL_LOCK = 1e-3


def with_pose_drivers(mechanism: Mechanism, names: Iterable[str]) -> Mechanism:
    """Return a mechanism with a chain for each point or link whose coordinates are driven.

    A point has the coordinates P.x, P.y and P.z in the ground frame in [m]. A link has those of its origin,
    and LINK.rx, LINK.ry and LINK.rz in [rad]: the Cardan angles of its rotation about x, the rotated y and
    the rotated z.

    Raises:
        InputError: for the rotation of a point.
        AssemblyError: if the mechanism does not close at its guess, or a link starts at ry = 90 deg.
    """
    links = {link.name for link in mechanism.links}
    moving = {*links, *moving_points(mechanism)}
    # point or link -> whether its rotation is driven, too; names of joints come first
    subjects: dict[str, bool] = {}
    for name in names:
        subject, _, suffix = name.rpartition(".")
        if name in mechanism.coordinates or suffix not in (*POSITIONS, *ROTATIONS):
            continue
        if suffix in ROTATIONS and subject in mechanism.points and subject not in links:
            raise InputError(f"{name} cannot be driven: {subject} is a point; drive the rotation of its link")
        if subject in moving:
            subjects[subject] = subjects.get(subject, False) or suffix in ROTATIONS
    if not subjects:
        return mechanism
    poses, _ = start_poses(mechanism)
    mechanism = replace(mechanism, guess={**mechanism.guess, **poses})
    for subject, rotates in subjects.items():
        mechanism = _with_chain(mechanism, subject, rotates)
    return mechanism


def _with_chain(mechanism: Mechanism, subject: str, rotates: bool) -> Mechanism:
    """Return a mechanism with the chain of a point or link."""
    from scipy.spatial.transform import Rotation

    is_link = subject not in mechanism.points or rotates
    link, point = (subject, ORIGIN) if is_link else mechanism.points[subject]
    pose = mechanism.guess[link]
    position = pose.point(point)
    suffixes = POSITIONS + (ROTATIONS if rotates else ())
    joints, guess, before, rotation = list[Joint](), dict[str, Pose](), GROUND, np.eye(3)
    values = [*position.tolist(), *(_cardan_angles(subject, pose.rotation) if rotates else ())]
    for i, suffix in enumerate(suffixes):
        last = suffix == "rz"
        name, after = f"{subject}.{suffix}", link if last else f"{VIRTUAL_PREFIX}{subject}.{suffix}"
        kind: KindName = "prismatic" if i < 3 else "revolute"
        axis, reference = DIRECTIONS[i % 3], REFERENCES[i % 3]
        joints.append(
            Joint(name, kind, End(before, ORIGIN, axis, reference), End(after, ORIGIN, axis, reference))
        )
        if i >= 3:
            rotation = rotation @ Rotation.from_euler("xyz"[i - 3], values[i]).as_matrix()
        reached = np.where(np.arange(3) <= i, position, 0.0)
        if not last:
            guess[after] = Pose(reached, rotation)
        before = after
    if not rotates:
        ball = f"{VIRTUAL_PREFIX}{subject}"
        joints.append(Joint(ball, "spherical", End(before), End(link, point)))
    guess_coordinates = {f"{subject}.{suffix}": value for suffix, value in zip(suffixes, values, strict=True)}
    return replace(
        mechanism,
        links=(*mechanism.links, *(Link(name, inertia=NEGLIGIBLE) for name in guess)),
        joints=(*mechanism.joints, *joints),
        guess={**mechanism.guess, **guess},
        guess_coordinates={**mechanism.guess_coordinates, **guess_coordinates},
    )


def _cardan_angles(link: str, rotation: Array) -> list[float]:
    """Return the Cardan angles (x, rotated y, rotated z) of a rotation matrix, (3, 3), in [rad]."""
    from scipy.spatial.transform import Rotation

    if abs(abs(rotation[0, 2]) - 1.0) < 0.5 * GIMBAL_LOCK**2:
        raise InputError(f"link {link} starts at {link}.ry = 90 deg, where rx and rz coincide; drive joints")
    return Rotation.from_matrix(rotation).as_euler("XYZ").tolist()


def is_pose_driven(mechanism: Mechanism) -> bool:
    """Whether a driver is a coordinate of a chain that `with_pose_drivers` added."""
    ends = tuple(f".{suffix}" for suffix in POSITIONS + ROTATIONS)
    links = [link for joint in mechanism.driven_joints for link in joint.links]
    return any(link.startswith(VIRTUAL_PREFIX) and link.endswith(ends) for link in links)


def motor_laws(solver: KinematicSolver, own: Mechanism) -> dict[str, State]:
    """Return motion laws of the actual drivers that move a mechanism as its pose drivers prescribe.

    Args:
        solver: solver under motion laws of points or links.
        own: the same mechanism with its actual drivers; redundant drivers are left out.

    Returns:
        Driver -> function of times, as exact as the loop closure.

    Raises:
        InputError: if the mechanism has no drivers of its own.
    """
    redundant = driver_determinacy(own).redundant_drivers if own.drivers else ()
    names = [name for name in own.drivers if name not in redundant]
    if not names:
        raise InputError(f"{own.name} has no drivers of its own; name the joints that its motors drive")
    return {name: _solved_law(solver, name) for name in names}


def _solved_law(solver: KinematicSolver, name: str) -> State:
    def state(time: Array) -> tuple[Array, Array, Array]:
        joint = solver.solve(t=np.atleast_1d(time)).joints[name]
        return joint.value, joint.rate, joint.acceleration

    return state
