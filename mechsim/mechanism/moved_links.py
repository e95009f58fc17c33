"""Poses of all links of a motion, those without a body and those of rods included."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import KINDS, KindName, displaced
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.link_poses import rotated
from mechsim.mechanism.links import EX, EY, EZ, GROUND, IDENTITY, ORIGIN, VIRTUAL_PREFIX, Link, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import Array


def moved_links(mechanism: Mechanism, motion: Motion) -> dict[str, Pose]:
    """Return the poses of all links except ground, and of rods, at the n instants of a motion.

    Raises:
        InputError: if the motion lacks a link that is a body.
    """
    poses = {GROUND: IDENTITY}
    # links without a body are placed about the others
    for link in sorted(mechanism.links, key=lambda link: not link.is_body):
        if link.name in motion.links:
            moved = motion.links[link.name]
            poses[link.name] = Pose(moved.position, moved.rotation)
        elif link.is_body:
            raise InputError(
                f"the motion has no pose of link {link.name!r}, so the link cannot be drawn; "
                "solve it with links"
            )
        else:
            poses[link.name] = _hidden_link_pose(mechanism, link.name, poses, motion)
    return with_rods(mechanism, {link.name: poses[link.name] for link in mechanism.links})[1]


def _hidden_link_pose(mechanism: Mechanism, name: str, poses: dict[str, Pose], motion: Motion) -> Pose:
    """Return the pose of a link without body that a joint without ball connects to another link."""
    joint = next(candidate for candidate in mechanism.joints if candidate.b.link == name)
    carrier, values = poses[joint.a.link], [motion.joints[name].value for name in joint.coordinates]
    shift, relative = displaced(KINDS[joint.kind], values, joint.cross_angle)
    frame = carrier.rotation @ joint.a.frame
    rotation = np.broadcast_to(frame @ relative @ joint.b.frame.T, (len(values[0]), 3, 3))
    position = carrier.point(joint.a.point) + rotated(frame, shift)
    return Pose(position - rotation @ joint.b.point, rotation)


def with_rods(
    mechanism: Mechanism, poses: Mapping[str, Pose], at_origin: KindName = "spherical"
) -> tuple[Mechanism, dict[str, Pose]]:
    """Return a mechanism with a link for each distance joint, and poses with its own.

    Its length is along its x axis. It has a pose if both links that it connects have one.

    Args:
        mechanism: the mechanism.
        poses: link -> its pose or poses.
        at_origin: kind of the joint at its origin; the other joint is spherical.
    """
    placed, links, joints = {GROUND: IDENTITY, **poses}, [*mechanism.links], list[Joint]()
    for joint in mechanism.joints:
        if not KINDS[joint.kind].rod:
            joints.append(joint)
            continue
        name, tip = f"{VIRTUAL_PREFIX}{joint.name}", (joint.length, 0.0, 0.0)
        links.append(Link(name, (ORIGIN, tip)))
        joints.append(Joint(joint.name, at_origin, joint.a, End(name, axis=EY)))
        joints.append(Joint(name, "spherical", End(name, tip), joint.b))
        if joint.a.link in placed and joint.b.link in placed:
            first, second = (placed[end.link].point(end.point) for end in (joint.a, joint.b))
            placed[name] = Pose(np.broadcast_to(first, (second - first).shape), _along_x(second - first))
    del placed[GROUND]
    return replace(mechanism, links=tuple(links), joints=tuple(joints)), placed


def _along_x(gap: Array) -> Array:
    """Return rotations whose x axes lie along gaps, (..., 3, 3)."""
    x = gap / np.linalg.norm(gap, axis=-1, keepdims=True)
    y = np.cross(np.where(np.abs(x[..., 2:]) < 0.9, EZ, EX), x)
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], -1)
