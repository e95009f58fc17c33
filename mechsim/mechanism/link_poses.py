"""Initial poses for assembly: the guess of a mechanism, completed link by link along its joints."""

from collections import Counter
from collections.abc import Collection, Container, Mapping
from dataclasses import replace
from heapq import heapify, heappop, heappush

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import FIXED, KINDS, displaced
from mechsim.mechanism.joints import End, Joint, Sides, joint_coordinate
from mechsim.mechanism.links import (
    GROUND,
    IDENTITY,
    VIRTUAL_PREFIX,
    Inertia,
    Link,
    Pose,
    Vector,
    rows,
    vector,
)
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array


def guessed_poses(mechanism: Mechanism, *, stiff_first: bool = False) -> dict[str, Pose]:
    """Return a pose of each moving link: its guess, or the pose that its joints to placed links give.

    Coordinates of these joints have the values that the description states (such as those of drivers), else
    0.

    Args:
        mechanism: the mechanism.
        stiff_first: whether joints with fewer rotations, such as prismatic joints, are used first; else
            joints are used in their order.

    Raises:
        InputError: if no chain of joints connects a link with the frame.
    """
    sides = {joint.name: joint.sides for joint in mechanism.joints}
    if stiff_first:
        joints = sorted(mechanism.joints, key=lambda joint: len(KINDS[joint.kind].turns))
        mechanism = replace(mechanism, joints=tuple(joints))
    return complete_guess(mechanism, sides, mechanism.guess, initial_coordinates(mechanism))


def complete_guess(
    mechanism: Mechanism,
    sides: Mapping[str, Sides],
    guess: Mapping[str, Pose],
    coordinates: Mapping[str, float] | Mapping[str, Array],
) -> dict[str, Pose]:
    """Return poses of all moving links, of one mechanism or of d designs of the same structure.

    Args:
        mechanism: one of the designs.
        sides: joint -> its sides; of d designs (d, 3) and (d, 3, 3).
        guess: poses of some links.
        coordinates: coordinate -> its value, or (d,).

    Raises:
        InputError: if no chain of joints connects a link with the frame.
    """
    placed: dict[str, Pose] = {GROUND: IDENTITY, **guess}
    joints_of: dict[str, list[int]] = {}
    for i, joint in enumerate(mechanism.joints):
        for link in joint.links:
            joints_of.setdefault(link, []).append(i)
    # the displacement of a screw is seldom stated: another joint places its links better
    attached = [
        (KINDS[mechanism.joints[i].kind].helical, i) for link in placed for i in joints_of.get(link, ())
    ]
    heapify(attached)
    while attached:
        joint = mechanism.joints[heappop(attached)[1]]
        forward = joint.a.link in placed
        placed_link, next_link = joint.links if forward else joint.links[::-1]
        if next_link not in placed:
            near_point, near_frame, far_point, far_frame = sides[joint.name]
            if not forward:
                near_point, near_frame, far_point, far_frame = far_point, far_frame, near_point, near_frame
            pose, (shift, relative) = placed[placed_link], _displaced(joint, coordinates, forward)
            frame = pose.rotation @ near_frame
            rotation = frame @ relative @ np.swapaxes(far_frame, -1, -2)
            position = pose.position + rotated(pose.rotation, near_point) + rotated(frame, shift)
            placed[next_link] = Pose(position - rotated(rotation, far_point), rotation)
            for i in joints_of[next_link]:
                heappush(attached, (KINDS[mechanism.joints[i].kind].helical, i))
    require_placed(mechanism, placed)
    del placed[GROUND]
    return placed


def require_placed(mechanism: Mechanism, placed: Container[str]) -> None:
    """Raise InputError for links that no chain of joints, and no guess, places."""
    if lost := [link.name for link in mechanism.links if link.name not in placed]:
        raise InputError(
            f"{mechanism.name}: no chain of joints leads from the frame to {', '.join(lost)}; add a joint, "
            "or leave the link out"
        )


def rotated(rotation: Array, vector: Array) -> Array:
    """Return vectors (..., 3) rotated by matrices (..., 3, 3)."""
    return (rotation @ vector[..., None])[..., 0]


def initial_coordinates(mechanism: Mechanism, poses: Mapping[str, Pose] | None = None) -> dict[str, float]:
    """Return the coordinates at the guess that the description states, in [m] and [rad].

    The angle of a screw between placed links follows from its displacement, and a coordinate that is a
    function of others from these.

    Args:
        mechanism: the mechanism.
        poses: link -> its pose; default those of the guess.
    """
    placed, coordinates = {GROUND: IDENTITY, **(mechanism.guess if poses is None else poses)}, {}
    for joint in mechanism.joints:
        if KINDS[joint.kind].helical and joint.a.link in placed and joint.b.link in placed:
            displacement = float(joint_coordinate(joint, placed[joint.a.link], placed[joint.b.link])[0])
            coordinates[joint.coordinates[1]] = REVOLUTION * displacement / joint.lead
    coordinates |= {**mechanism.guess_coordinates, **mechanism.locked}
    if mechanism.has_crank:
        coordinates[mechanism.crank.name] = mechanism.start
    for law in mechanism.laws:
        if law.function is not None and isinstance(law.left, str) and law.left not in coordinates:
            low, high = law.function.interval
            for name in law.right_terms:
                # a table need not contain 0
                coordinates.setdefault(name, 0.0 if low < 0.0 < high else 0.5 * (low + high))
            right = sum(weight * coordinates[name] for name, weight in law.right_terms.items())
            coordinates[law.left] = law.zeros[0] + float(law.polynomial(np.array([right]))[0][0])
    return coordinates


def _displaced(
    joint: Joint, coordinates: Mapping[str, float] | Mapping[str, Array], forward: bool
) -> tuple[Array, Array]:
    """Return the joint frame of the far side in that of the near side: (..., 3) in [m] and (..., 3, 3)."""
    pairs = zip(joint.coordinates, joint.unguessed, strict=True)
    values = [coordinates.get(name, unguessed) for name, unguessed in pairs]
    if not (KINDS[joint.kind].crossed or any(np.any(value) for value in values)):
        return np.zeros(3), np.eye(3)
    shift, rotation = displaced(KINDS[joint.kind], np.broadcast_arrays(*values), joint.cross_angle)
    if forward:
        return shift, rotation
    rotation = np.swapaxes(rotation, -1, -2)
    return -rotated(rotation, shift), rotation


# separates the names of a joint and of its link in the name of a virtual body
VIRTUAL_BODY_SEPARATOR = "@"


def virtual_body(joint: Joint) -> str:
    """Return the name of the virtual body of a split joint."""
    return f"{joint.name}{VIRTUAL_BODY_SEPARATOR}{_replaced_end(joint).link}"


def with_virtual_bodies(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, Pose]:
    """Return poses of links and of the virtual bodies of split joints."""
    all_poses = {GROUND: IDENTITY, **poses}
    virtual_poses = {
        joint.a.link: all_poses[joint.b.link]
        for joint in mechanism.joints
        if joint.kind == FIXED and joint.name == joint.a.link and joint.b.link in all_poses
    }
    return {**virtual_poses, **poses}


def split_joints(mechanism: Mechanism, names: Collection[str]) -> Mechanism:
    """Return a mechanism in which some joints end on virtual bodies, fixed to the links of these joints.

    A virtual body has the frame of its link and a share of its inertia. The fixed joint, which has the name
    of the body, can be cut.
    """
    shares = Counter(_replaced_end(joint).link for joint in mechanism.joints if joint.name in names)
    links, joints = [*mechanism.links], list[Joint]()
    for i, link in enumerate(links):
        if link.inertia and shares[link.name]:
            count, whole = 1 + shares[link.name], link.inertia
            share = Inertia(whole.mass / count, whole.centre, rows(whole.matrix / count))
            links[i] = replace(link, inertia=share)
    inertias = {link.name: link.inertia for link in links}
    for joint in mechanism.joints:
        if joint.name not in names:
            joints.append(joint)
            continue
        name, end = virtual_body(joint), _replaced_end(joint)
        links.append(Link(name, inertia=inertias[end.link]))
        own: End = replace(end, link=name)
        moved_joint = replace(joint, a=own) if end is joint.a else replace(joint, b=own)
        joints += [moved_joint, Joint(name, FIXED, own, end)]
    return replace(mechanism, links=tuple(links), joints=tuple(joints))


def spin_rod(ball: Joint, spin: Vector, poses: Mapping[str, Pose]) -> Joint:
    """Return a massless rod next to a ball, which locks one of its three rotations.

    It joins a point of link b, at right angles to the axis of the rotation, to one of link a at right angles
    to both, so that only a rotation about the axis changes their distance.

    Args:
        ball: the ball.
        spin: axis of the rotation in the frame of link b; its length is that of both arms, in [m].
        poses: poses of both links, the ground included.
    """
    a, b, arm = poses[ball.a.link], poses[ball.b.link], float(np.linalg.norm(spin))
    across, above, _ = arm * End(ball.b.link, axis=spin).frame.T
    ends = (
        End(ball.a.link, vector(np.array(ball.a.point) + a.rotation.T @ b.rotation @ above)),
        End(ball.b.link, vector(np.array(ball.b.point) + across)),
    )
    return Joint(f"{VIRTUAL_PREFIX}{ball.name}", "distance", *ends, length=float(np.sqrt(2.0) * arm))


def _replaced_end(joint: Joint) -> End:
    """Return the end of a joint that its virtual body replaces: side b, or side a if b is the frame."""
    return joint.a if joint.b.link == GROUND else joint.b
