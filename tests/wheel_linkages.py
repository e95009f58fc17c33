"""Wheels coupled by rods in a row: parallelograms with coincident change points."""

import numpy as np

import mechsim as ms

START = 0.9


def wheel_linkages(count: int, lag: float = 0.0) -> ms.Mechanism:
    """Return wheels at different distances, each rod on pins of its own radius.

    Args:
        count: number of wheels.
        lag: angle in [rad] by which the pins of the last rod lag the others.
    """
    links, guess, points = [ms.Link("w0")], dict[str, ms.Pose](), {}
    joints = [ms.Joint("crank", "revolute", ms.End("ground"), ms.End("w0"))]
    along = 0.0
    for i in range(1, count):
        distance, radius, behind = 0.11 + 0.017 * i, 0.03 - 0.003 * i, -lag if i == count - 1 else 0.0
        pin = (radius * np.cos(behind), radius * np.sin(behind), 0.0)
        links += [ms.Link(f"w{i}"), ms.Link(f"rod{i}")]
        joints += [
            ms.Joint(f"a{i}", "revolute", ms.End(f"w{i - 1}", pin), ms.End(f"rod{i}")),
            ms.Joint(f"b{i}", "revolute", ms.End(f"rod{i}", (distance, 0.0, 0.0)), ms.End(f"w{i}", pin)),
            ms.Joint(f"c{i}", "revolute", ms.End("ground", (along + distance, 0.0, 0.0)), ms.End(f"w{i}")),
        ]
        rotated = about_z(START)
        guess[f"w{i}"] = ms.Pose(np.array([along + distance, 0.0, 0.0]), rotated)
        guess[f"rod{i}"] = ms.Pose(np.array([along, 0.0, 0.0]) + rotated @ pin, np.eye(3))
        points[f"P{i}"] = (f"w{i}", pin)
        along += distance
    return ms.Mechanism(
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


def assert_equal_rotation(
    mechanism: ms.Mechanism, motion: ms.Motion, bounds: tuple[float, float, float]
) -> None:
    """Assert that every wheel rotates as the crank, within bounds in radii on positions and rates."""
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
        for difference, limit in zip(off, bounds, strict=True):
            assert np.abs(difference).max() <= limit * radius
