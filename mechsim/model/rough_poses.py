"""Where assembly begins: the guess of a mechanism, completed link by link along its joints."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.joint_kinds import KINDS, displaced
from mechsim.model.joints import Joint, joint_coordinate
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array

# of one joint: points (..., 3) and frames (..., 3, 3) of its sides a and b, in their links' frames
Sides = tuple[Array, Array, Array, Array]


def rough_poses(mechanism: Mechanism, *, stiff_first: bool = False) -> dict[str, Pose]:
    """Return one pose a moving link: the guess, else where its joints to placed links put it.

    Coordinates of these joints are those that the description tells, as of drivers and holds, else nought.

    Args:
        mechanism: the mechanism.
        stiff_first: whether joints that turn links less go before others, as slides, which leave no turn
            open; else they are taken as they come.

    Raises:
        AssemblyError: for links that no chain of joints leads to.
    """
    sides = {
        joint.name: (np.asarray(joint.a.point), joint.a.frame, np.asarray(joint.b.point), joint.b.frame)
        for joint in mechanism.joints
    }
    if stiff_first:
        joints = sorted(mechanism.joints, key=lambda joint: len(KINDS[joint.kind].turns))
        mechanism = replace(mechanism, joints=tuple(joints))
    return completed(mechanism, sides, mechanism.guess, starts(mechanism))


def completed(
    mechanism: Mechanism,
    sides: Mapping[str, Sides],
    guess: Mapping[str, Pose],
    told: Mapping[str, float] | Mapping[str, Array],
) -> dict[str, Pose]:
    """Return poses of all moving links, of one mechanism or of d that are alike.

    Args:
        mechanism: one of them.
        sides: of its joints; of d designs (d, 3) and (d, 3, 3).
        guess: of some links.
        told: coordinate -> its value, or (d,).

    Raises:
        AssemblyError: for links that no chain of joints leads to.
    """
    placed: dict[str, Pose] = {GROUND: IDENTITY, **guess}
    waiting = list(mechanism.joints)
    while waiting:
        joint = next((j for j in waiting if j.a.link in placed or j.b.link in placed), None)
        if joint is None:
            lost = [link.name for link in mechanism.links if link.name not in placed]
            raise AssemblyError(
                f"{mechanism.name}: no chain of joints leads from the frame to {', '.join(lost)}; add one"
            )
        waiting.remove(joint)
        forward = joint.a.link in placed
        near, far = (joint.a.link, joint.b.link) if forward else (joint.b.link, joint.a.link)
        if far not in placed:
            point_a, frame_a, point_b, frame_b = sides[joint.name]
            ends = (point_a, frame_a, point_b, frame_b) if forward else (point_b, frame_b, point_a, frame_a)
            placed[far] = _hung(placed[near], ends, _displaced(joint, told, forward))
    lost = [link.name for link in mechanism.links if link.name not in placed]
    if lost:
        raise AssemblyError(
            f"{mechanism.name}: no joint holds link {', '.join(lost)}; add one or leave it out"
        )
    del placed[GROUND]
    return placed


def _hung(pose: Pose, ends: Sides, displacement: tuple[Array, Array]) -> Pose:
    """Return the pose of a link that a joint holds to one that is placed, its near side first."""
    (near, near_frame, far, far_frame), (shift, turn) = ends, displacement
    frame = pose.rotation @ near_frame
    rotation = frame @ turn @ np.swapaxes(far_frame, -1, -2)
    at = pose.position + turned(pose.rotation, near)
    return Pose(at + turned(frame, shift) - turned(rotation, far), rotation)


def turned(rotation: Array, vector: Array) -> Array:
    """Return vectors (..., 3) turned by rotations (..., 3, 3)."""
    return (rotation @ vector[..., None])[..., 0]


def starts(mechanism: Mechanism) -> dict[str, float]:
    """Return the values of coordinates at the guess that the description tells, in [m] and [rad].

    Of a screw between guessed links the turns that lead to where these stand.
    """
    told = {**_wound(mechanism), **mechanism.counted, **mechanism.locked}
    if mechanism.has_crank:
        told[mechanism.crank.name] = mechanism.start
    return told


def _wound(mechanism: Mechanism) -> dict[str, float]:
    """Return by how much screws between guessed links have turned to stand as far out, in [rad]."""
    placed = {GROUND: IDENTITY, **mechanism.guess}
    found: dict[str, float] = {}
    for joint in mechanism.joints:
        if KINDS[joint.kind].led and joint.a.link in placed and joint.b.link in placed:
            way = float(joint_coordinate(joint, placed[joint.a.link], placed[joint.b.link])[0])
            found[joint.coordinates[1]] = TURN * way / joint.lead
    return found


def _displaced(
    joint: Joint, told: Mapping[str, float] | Mapping[str, Array], forward: bool
) -> tuple[Array, Array]:
    """Return where the far side's joint frame stands in the near side's: (..., 3) in [m] and (..., 3, 3)."""
    values = [told.get(name, 0.0) for name in joint.coordinates]
    if not (KINDS[joint.kind].crossed or any(np.any(value) for value in values)):
        return np.zeros(3), np.eye(3)
    shift, turn = displaced(KINDS[joint.kind], np.broadcast_arrays(*values), joint.cross_angle)
    if forward:
        return shift, turn
    turn = np.swapaxes(turn, -1, -2)
    return -turned(turn, shift), turn
