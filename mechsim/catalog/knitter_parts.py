"""Links and joints of the two-crank warp-knitting mechanism: their description and their motion."""

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mechsim.catalog import frames
from mechsim.catalog.base import Array
from mechsim.mechanism import GROUND, End, Gear, Joint, Link, Mechanism, Pose
from mechsim.motion import JointMotion, LinkMotion, PointMotion

if TYPE_CHECKING:
    from mechsim.catalog.warp_knitter import WarpKnitter

# gears have hardly more teeth than this
MOST_TEETH = 1000
# joint -> the links it joins, the one nearer the frame first
JOINED = {
    "crank": (GROUND, "crank1"),
    "crank2": (GROUND, "crank2"),
    "A": ("crank1", "rod3"),
    "B": ("rod3", "base"),
    "D": ("crank2", "rod5"),
    "C": ("rod5", "base"),
    "K": ("base", "rocker"),
    "rocker": (GROUND, "rocker"),
}


def description(drive: "WarpKnitter", guess: Mapping[str, Pose], start: float) -> Mechanism:
    """Return the mechanism of a warp knitter: six links, eight revolute joints and the gears.

    Frames: cranks and rocker at their pivots, rods at their cranks, x along the link; the base link
    at B as its parameters say.
    """

    def flat(x: float, y: float = 0.0) -> tuple[float, float, float]:
        return float(x), float(y), 0.0

    places = {
        ("crank2", GROUND): flat(*drive.pivot2),
        ("rocker", GROUND): flat(*drive.pivot_rocker),
        ("A", "crank1"): flat(drive.crank1),
        ("D", "crank2"): flat(drive.crank2),
        ("B", "rod3"): flat(drive.rod3),
        ("C", "rod5"): flat(drive.rod5),
        ("C", "base"): flat(*drive.base_c),
        ("K", "base"): flat(*drive.base_k),
        ("K", "rocker"): flat(drive.rocker),
    }

    def end(joint: str, link: str) -> End:
        return End(link, places.get((joint, link), flat(0.0)))

    points = {"A": "crank1", "B": "base", "C": "base", "D": "crank2", "K": "base"}
    return Mechanism(
        name=drive.name,
        links=tuple(Link(name) for name in ("crank1", "crank2", "rod3", "rod5", "base", "rocker")),
        joints=tuple(Joint(name, "revolute", end(name, a), end(name, b)) for name, (a, b) in JOINED.items()),
        driver="crank",
        points={name: (link, places.get((name, link), flat(0.0))) for name, link in points.items()},
        gears=(Gear("crank", "crank2", drive.gear_ratio, drive.phase),),
        guess=guess,
        start=start,
    )


def link_motions(
    drive: "WarpKnitter",
    angles: Array,
    speed: Array,
    acceleration: Array,
    points: Mapping[str, PointMotion],
    turn: NDArray[np.complex128],
    spin: Array,
    pull: Array,
) -> tuple[dict[str, LinkMotion], dict[str, JointMotion]]:
    """Return the motions of links and joints, given those of the points and of the base link.

    Angles of cranks are not wrapped; those of the other links are counted within half a turn of
    where they stand at crank angle 0, so that links that only rock never jump.
    """
    still = np.zeros((3, len(angles)))
    fixed = {
        name: frames.point(still + np.array([[x], [y], [0.0]]))
        for name, (x, y) in {"O1": (0.0, 0.0), "O2": drive.pivot2, "E": drive.pivot_rocker}.items()
    }
    places = {**points, **fixed}
    ratio = drive.gear_ratio
    turned: dict[str, tuple[Array, Array, Array]] = {
        "crank1": (angles, speed, acceleration),
        "crank2": (ratio * angles + drive.phase, ratio * speed, ratio * acceleration),
    }
    links: dict[str, LinkMotion] = {}
    bars = {
        "crank1": ("O1", "A", drive.crank1),
        "crank2": ("O2", "D", drive.crank2),
        "rod3": ("A", "B", drive.rod3),
        "rod5": ("D", "C", drive.rod5),
        "rocker": ("E", "K", drive.rocker),
    }
    for name, (near, far, size) in bars.items():
        a, b = places[near], places[far]
        rod, rod_v = (b.position - a.position).T, (b.velocity - a.velocity).T
        if name not in turned:
            rates = frames.planar_turn(rod, rod_v, (b.acceleration - a.acceleration).T)
            turned[name] = np.arctan2(rod[1], rod[0]), *rates
        links[name] = frames.planar_link(a, rod / size, *turned[name][1:])
    turned["base"] = np.angle(turn), spin, pull
    ahead = np.stack([turn.real, turn.imag, still[0]])
    links["base"] = frames.planar_link(points["B"], ahead, spin, pull)
    order = ("crank1", "crank2", "rod3", "rod5", "base", "rocker")
    return {name: links[name] for name in order}, _joint_motions(drive, turned)


def _joint_motions(
    drive: "WarpKnitter", turned: dict[str, tuple[Array, Array, Array]]
) -> dict[str, JointMotion]:
    counted = dict(turned)
    for name, zero in drive.angles_at_zero.items():
        value, rate, pull = turned[name]
        counted[name] = zero + (value - zero + np.pi) % (2.0 * np.pi) - np.pi, rate, pull
    nothing = np.zeros_like(turned["base"][0])
    counted[GROUND] = nothing, nothing, nothing

    def relative(a: str, b: str) -> JointMotion:
        value, rate, pull = (there - here for here, there in zip(counted[a], counted[b], strict=True))
        return JointMotion(value, rate, pull)

    return {joint: relative(a, b) for joint, (a, b) in JOINED.items()}


def period_of(ratio: float) -> float | None:
    """Return the crank angle in [rad] after which both cranks stand as before; None if no gear does so."""
    teeth = Fraction(ratio).limit_denominator(MOST_TEETH)
    if abs(float(teeth) - ratio) > 4.0 * np.finfo(np.float64).eps * abs(ratio):
        return None
    return 2.0 * np.pi * teeth.denominator


def xyz(point: Any) -> Array:
    """Return points of the plane as (3, n) vectors."""
    return np.stack([point.real, point.imag, np.zeros_like(point.real)])
