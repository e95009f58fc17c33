"""Wheels coupled by rods in a row, as of a locomotive: parallelograms, all of which lie in line at once."""

import numpy as np

from mechsim.model.joints import End, Joint
from mechsim.model.links import Link, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion

START = 0.9


def wheel_linkages(count: int, lag: float = 0.0) -> Mechanism:
    """Return a train of wheels at distances that differ, each rod on pins of its own radius.

    Args:
        count: of wheels; as many rods but one lie in line where the crank does.
        lag: angle in [rad] by which the last rod's pins lie behind the others.
    """
    links, guess, points = [Link("w0")], dict[str, Pose](), {}
    joints = [Joint("crank", "revolute", End("ground"), End("w0"))]
    along = 0.0
    for i in range(1, count):
        apart, radius, behind = 0.11 + 0.017 * i, 0.03 - 0.003 * i, -lag if i == count - 1 else 0.0
        pin = (radius * np.cos(behind), radius * np.sin(behind), 0.0)
        links += [Link(f"w{i}"), Link(f"rod{i}")]
        joints += [
            Joint(f"a{i}", "revolute", End(f"w{i - 1}", pin), End(f"rod{i}")),
            Joint(f"b{i}", "revolute", End(f"rod{i}", (apart, 0.0, 0.0)), End(f"w{i}", pin)),
            Joint(f"c{i}", "revolute", End("ground", (along + apart, 0.0, 0.0)), End(f"w{i}")),
        ]
        turned = about_z(START)
        guess[f"w{i}"] = Pose(np.array([along + apart, 0.0, 0.0]), turned)
        guess[f"rod{i}"] = Pose(np.array([along, 0.0, 0.0]) + turned @ pin, np.eye(3))
        points[f"P{i}"] = (f"w{i}", pin)
        along += apart
    return Mechanism(
        name="wheels",
        links=tuple(links),
        joints=tuple(joints),
        driver="crank",
        points=points,
        guess=guess,
        start=START,
    )


def about_z(angle: float) -> np.ndarray:
    """Return the rotation about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def assert_all_turn_alike(mechanism: Mechanism, motion: Motion, bounds: tuple[float, float, float]) -> None:
    """Every wheel turns as the crank does: places, velocities, accelerations in radii are within."""
    angle, speed = motion.angle, motion.speed
    for name, point in motion.points.items():
        pin = np.array(mechanism.points[name][1])
        centre = next(j.a.point for j in mechanism.joints if j.name == f"c{name[1:]}")
        radius = float(np.hypot(*pin[:2]))
        lies = angle + np.arctan2(pin[1], pin[0])
        out = radius * np.stack([np.cos(lies), np.sin(lies), 0.0 * lies], 1)
        along = radius * np.stack([-np.sin(lies), np.cos(lies), 0.0 * lies], 1)
        off = (
            point.position - centre - out,
            (point.velocity - along * speed[:, None]) / np.abs(speed).max(),
            (point.acceleration + out * speed[:, None] ** 2) / np.abs(speed).max() ** 2,
        )
        for gap, bound in zip(off, bounds, strict=True):
            assert np.abs(gap).max() <= bound * radius
