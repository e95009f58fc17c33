"""Belts and chains around pulleys: tangents, wrap angles and length.

A belt has the pulley with the centre c and the radius r to its left, where it runs counterclockwise (s = r),
or to its right (s = -r). The tangent from pulley i to j has the length l and the direction u with the left
normal n:

    c_j - c_i = l u + (s_j - s_i) n,    l**2 = abs(c_j - c_i)**2 - (s_j - s_i)**2

For two pulleys these are the formulas of open and crossed belts (Shigley, *Mechanical Engineering Design*,
sec. 17-1).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Belt, Coupling, End, Joint
from mechsim.mechanism.links import Vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array

# difference of a stated length and that of the path, relative to it, that is rounding of the text
STATED = 1e-3
# difference of axes that are parallel: rounding
PARALLEL = 1e-9


@dataclass(frozen=True)
class BeltPath:
    """The path of a belt around its pulleys, in the order in which it runs.

    Attributes:
        name: of the belt.
        joints: of the pulleys, the driver's first; None for a tensioner.
        centres: of the pulleys, (n, 2) in [m].
        radii: positive where the belt runs counterclockwise, (n,) in [m].
        tangents: both ends of the tangent from each pulley to the next, (n, 2, 2) in [m].
        wraps: wrap angles, (n,) in [rad].
        length: of the belt, in [m].
    """

    name: str
    joints: tuple[Joint | None, ...]
    centres: Array
    radii: Array
    tangents: Array
    wraps: Array
    length: float

    @property
    def carrier(self) -> End:
        """Side a of the driver's joint, in whose frame the path lies."""
        driver = self.joints[0]
        assert driver is not None
        return driver.a

    def points(self, chord: float) -> list[Array]:
        """Return the points of each strand, with the arc before it in chords of an angle in [rad], (k, 2)."""
        strands: list[Array] = []
        pulleys = zip(self.centres, self.radii, self.wraps, self.tangents, strict=True)
        for centre, radius, wrap, ends in pulleys:
            back = np.sign(radius) * np.linspace(wrap, 0.0, 2 + int(wrap / chord))
            (x, y), (c, s) = ends[0] - centre, (np.cos(back), -np.sin(back))
            strands.append(np.vstack([centre + np.stack([c * x - s * y, s * x + c * y], 1), ends[1:]]))
        return strands


def belts_of(mechanism: Mechanism) -> Iterator[BeltPath]:
    """Yield the paths of all belts between parallel shafts of one link.

    Raises:
        InputError: for pulleys that overlap, and for a length that is not that of the path.
    """
    joints = {joint.name: joint for joint in mechanism.joints if KINDS[joint.kind].hinge}
    for coupling in mechanism.couplings:
        if coupling.belt is None or not {*coupling.coordinates} <= joints.keys():
            continue
        driven, driver = (joints[name] for name in coupling.coordinates)
        parallel = abs(abs(np.dot(driver.a.axis, driven.a.axis)) - 1.0) < PARALLEL
        if driver.a.link == driven.a.link and parallel:
            yield _path(coupling, coupling.belt, driver, driven)


def _path(coupling: Coupling, belt: Belt, driver: Joint, driven: Joint) -> BeltPath:
    """Return the path of a belt; of two places of the tensioner in its order, that of the shorter belt."""
    sign = np.sign(coupling.ratio * np.dot(driver.a.axis, driven.a.axis))
    pulleys = [(driver, driver.a.point, belt.radii[0]), (driven, driven.a.point, sign * belt.radii[1])]
    orders = [pulleys]
    if belt.tensioner is not None:
        # it presses on the outside
        idler = (None, belt.tensioner, -belt.tensioner_radius)
        orders = [[*pulleys, idler], [pulleys[0], idler, pulleys[1]]]
    path = min((_around(coupling.name, order) for order in orders), key=lambda path: path.length)
    if any(joint is None and wrap > np.pi for joint, wrap in zip(path.joints, path.wraps, strict=True)):
        raise InputError(
            f"belt {coupling.name!r} does not touch its tensioner at {belt.tensioner}; move it closer"
        )
    if belt.length and not abs(belt.length - path.length) <= STATED * path.length:
        raise InputError(
            f"belt {coupling.name!r} has the length {belt.length:.6g} m, and its path around the pulleys "
            f"{path.length:.6g} m; change it, the radii, the distance, or add a tensioner"
        )
    return path


def _around(name: str, pulleys: Sequence[tuple[Joint | None, Vector, float]]) -> BeltPath:
    """Return the path around pulleys in order: joint, centre and signed radius in [m]."""
    joints, points, signed = zip(*pulleys, strict=True)
    centres, radii = (np.array(points) - points[0]) @ joints[0].a.frame[:, :2], np.array(signed)
    d = np.roll(centres, -1, 0) - centres
    k = np.roll(radii, -1) - radii
    squared = (d**2).sum(1)
    if not (squared > np.maximum(k, np.roll(np.abs(radii), -1) + np.abs(radii)) ** 2).all():
        i = int(np.argmin(squared))
        raise InputError(
            f"belt {name!r} has pulleys of {abs(radii[i]):g} m and {abs(np.roll(radii, -1)[i]):g} m at a "
            f"distance of {np.sqrt(squared[i]):.6g} m: they overlap; give smaller radii or move a shaft"
        )
    length = np.sqrt(squared - k**2)[:, None]
    u = (length * d - k[:, None] * np.stack([-d[:, 1], d[:, 0]], 1)) / squared[:, None]
    n = np.stack([-u[:, 1], u[:, 0]], 1)
    start = centres - radii[:, None] * n
    before = np.roll(u, 1, 0)
    angle = np.arctan2(before[:, 0] * u[:, 1] - before[:, 1] * u[:, 0], (before * u).sum(1))
    wraps = (np.sign(radii) * angle) % REVOLUTION
    total = float(length.sum() + (np.abs(radii) * wraps).sum())
    return BeltPath(name, joints, centres, radii, np.stack([start, start + length * u], 1), wraps, total)
