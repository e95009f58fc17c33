"""Which link of a mechanism with several drivers is its platform, and how the drivers control it."""

from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from mechsim.analytic.loops.maximal_coordinates import equations, scaled
from mechsim.analytic.loops.start import start_poses
from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, ORIGIN, Pose, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import null_spaces, rank
from mechsim.pictures.view import POSE_COORDINATES, PlatformDrive

# smallest singular value, relative to the largest, of coordinates that count as independent: rotations are
# compared with displacements relative to the mechanism's size
INDEPENDENT = 1e-3
# largest angle about y in [rad] at the start: at pi/2 the angles about x and z are not unique
LARGEST_TILT = np.deg2rad(80.0)


def platform_of(mechanism: Mechanism, limits: Mapping[str, tuple[float, float]]) -> PlatformDrive | None:
    """Return the platform of a mechanism; None without one.

    The platform is the link with most joints among those not hinged to the ground that all drivers together
    move, with as many independent pose coordinates as there are drivers. Links next to the ground follow.

    Args:
        mechanism: with several drivers and no couplings or locked joints, else it has none.
        limits: driver -> lowest and highest value in SI, where a file states them.
    """
    drivers = mechanism.drivers
    simple = not (mechanism.laws or mechanism.locked) and all(
        KINDS[joint.kind].single for joint in mechanism.driven_joints
    )
    if len(drivers) < 2 or not simple:
        return None
    with suppress(AssemblyError):
        poses = start_poses(mechanism)[0]
        motions = _free_motions(mechanism, poses)
        for link in _candidates(mechanism):
            origin, point = _reference_point(mechanism, link)
            coordinates = _controlled(mechanism, link, poses[link], point, motions)
            if len(coordinates) == len(drivers):
                return PlatformDrive(link, point, origin, coordinates, poses, limits)
    return None


def _candidates(mechanism: Mechanism) -> list[str]:
    """Return the moving links, those not joined to the ground first, those with most joints before others."""
    grounded = {
        link
        for joint in mechanism.joints
        for link in (joint.a.link, joint.b.link)
        if GROUND in (joint.a.link, joint.b.link)
    }
    return sorted(
        (link.name for link in mechanism.links),
        key=lambda link: (link in grounded and not _named(mechanism, link), -len(mechanism.ends(link))),
    )


def _named(mechanism: Mechanism, link: str) -> bool:
    return any(own == link for own, _ in mechanism.points.values())


def _reference_point(mechanism: Mechanism, link: str) -> tuple[str, Vector]:
    """Return name and position in [m] of the reference point of a link: pivot, origin or named point."""
    for joint in mechanism.joints:
        for end, other in ((joint.a, joint.b), (joint.b, joint.a)):
            if KINDS[joint.kind].pivot and (end.link, other.link) == (link, GROUND):
                return joint.name, end.point
    points = {name: point for name, (own, point) in mechanism.points.items() if own == link}
    at_origin = not points or ORIGIN in points.values()
    return (link, ORIGIN) if at_origin else next(iter(points.items()))


def _free_motions(mechanism: Mechanism, poses: Mapping[str, Pose]) -> Array:
    """Return independent free motions of all links, (k, 6 links), lengths relative to the size."""
    stacked = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in poses.items()}
    jacobian = equations(mechanism, stacked, None).jacobian
    return null_spaces(scaled(mechanism, jacobian)[0])[1]


def _controlled(
    mechanism: Mechanism, link: str, pose: Pose, point: Vector, motions: Array
) -> tuple[str, ...]:
    """Return the independent pose coordinates of a link; none where its tilt is too large for angles."""
    if abs(np.arcsin(np.clip(pose.rotation[0, 2], -1.0, 1.0))) > LARGEST_TILT:
        return ()
    slot = 6 * [other.name for other in mechanism.links].index(link)
    linear, angular = motions[:, slot : slot + 3], motions[:, slot + 3 : slot + 6]
    arm = pose.rotation @ np.asarray(point) / mechanism.size
    rates = np.hstack([linear + np.cross(angular, arm), angular])  # (k, 6)
    chosen: list[int] = []
    for index in range(len(POSE_COORDINATES)):
        if rank(rates[:, [*chosen, index]], INDEPENDENT, INDEPENDENT) > len(chosen):
            chosen.append(index)
    return tuple(POSE_COORDINATES[index] for index in chosen)
