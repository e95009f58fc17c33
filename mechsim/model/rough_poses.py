"""Where assembly begins: the guess of a mechanism, completed link by link along its joints."""

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.joints import KINDS, displaced
from mechsim.model.mechanism import GROUND, IDENTITY, Joint, Mechanism, Pose


def rough_poses(mechanism: Mechanism) -> dict[str, Pose]:
    """Return one pose a moving link: the guess, else where its joints to placed links put it.

    Coordinates of these joints are those that the description tells, as of drivers and holds, else nought.

    Raises:
        AssemblyError: for links that no chain of joints leads to.
    """
    placed: dict[str, Pose] = {GROUND: IDENTITY, **mechanism.guess}
    told = starts(mechanism)
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
        near, far = (joint.a, joint.b) if forward else (joint.b, joint.a)
        if far.link not in placed:
            shift, turn = _displaced(joint, told, forward)
            pose = placed[near.link]
            frame = pose.rotation @ near.frame
            rotation = frame @ turn @ far.frame.T
            placed[far.link] = Pose(
                pose.point(near.point) + frame @ shift - rotation @ np.asarray(far.point), rotation
            )
    lost = [link.name for link in mechanism.links if link.name not in placed]
    if lost:
        raise AssemblyError(
            f"{mechanism.name}: no joint holds link {', '.join(lost)}; add one or leave it out"
        )
    del placed[GROUND]
    return placed


def starts(mechanism: Mechanism) -> dict[str, float]:
    """Return the values of coordinates at the guess that the description tells, in [m] and [rad]."""
    told = {**mechanism.counted, **mechanism.holds}
    if mechanism.has_crank:
        told[mechanism.crank.name] = mechanism.start
    return told


def _displaced(joint: Joint, told: dict[str, float], forward: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return where the far side's joint frame stands in the near side's: (3,) in [m] and (3, 3)."""
    values = [told.get(name, 0.0) for name in joint.coordinates]
    if not any(values):
        return np.zeros(3), np.eye(3)
    shift, turn = displaced(KINDS[joint.kind], values, joint.cross_angle)
    return (shift, turn) if forward else (-turn.T @ shift, turn.T)
