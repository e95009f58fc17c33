"""Random gear trains: wheels, racks, bevel wheels and a screw on the frame and on an arm that turns."""

from dataclasses import dataclass, field

import numpy as np

from mechsim.mechanism.joint_kinds import KindName
from mechsim.mechanism.joints import Coupling, End, Gear, Joint
from mechsim.mechanism.links import GROUND, Inertia, Link, Pose
from mechsim.mechanism.mechanism import Mechanism


@dataclass
class RandomLinks:
    """Links in random poses, and joints between them with all coordinates zero."""

    chance: np.random.Generator
    poses: dict[str, Pose] = field(default_factory=dict)
    joints: list[Joint] = field(default_factory=list)

    def direction(self) -> np.ndarray:
        """Return a random unit vector."""
        result = self.chance.normal(size=3)
        return result / np.linalg.norm(result)

    def across(self, axis: np.ndarray) -> np.ndarray:
        """Return a random unit vector perpendicular to another."""
        result = np.cross(axis, self.direction())
        return result / np.linalg.norm(result)

    def link(self, name: str) -> None:
        """Add a link in a random pose."""
        rotated = np.linalg.qr(self.chance.normal(size=(3, 3)))[0]
        rotated *= np.linalg.det(rotated)
        self.poses[name] = Pose(self.chance.uniform(-0.1, 0.1, 3), rotated)

    def joint(
        self,
        name: str,
        kind: KindName,
        carrier: str,
        link: str,
        point: np.ndarray,
        axis: np.ndarray,
        **more: float,
    ) -> None:
        """Join a new link to another; side a and the sign of the axis are random."""
        if link not in self.poses:
            self.link(link)
        sides = [carrier, link]
        if self.chance.random() < 0.4:
            sides.reverse()
        self.between(name, kind, sides, point, axis * self.chance.choice([-1.0, 1.0]), **more)

    def between(
        self, name: str, kind: KindName, sides: list[str], point: np.ndarray, axis: np.ndarray, **more: float
    ) -> None:
        """Join two links in their poses, side a first."""
        reference = self.across(axis)
        ends = [self.end(side, point, axis, reference) for side in sides]
        self.joints.append(Joint(name, kind, *ends, **more))

    def end(self, link: str, point: np.ndarray, axis: np.ndarray, reference: np.ndarray) -> End:
        """Return a side of a joint at a position of the ground frame."""
        pose = self.poses.get(link, Pose(np.zeros(3), np.eye(3)))
        back = pose.rotation.T
        local = back @ (point - pose.position)
        return End(link, *(tuple(vector.tolist()) for vector in (local, back @ axis, back @ reference)))

    def inertia(self) -> Inertia:
        """Return a random inertia."""
        spread = self.chance.normal(size=(3, 3))
        spread = spread @ spread.T + 0.5 * np.eye(3)
        moments = 2e-4 * (np.trace(spread) * np.eye(3) - spread)
        rows = tuple(tuple(row) for row in moments.tolist())
        return Inertia(1.0, tuple(self.chance.uniform(-0.03, 0.03, 3).tolist()), rows)


def train(seed: int, pressure_angle: float | None = None) -> Mechanism:
    """Return a train: a pair and a bevel pair on the frame, a planet, a wheel and a rack on an arm, a nut.

    Its crank is the arm. The wheel `skew` has a skew axis and no teeth; `cam`
    slides by a polynomial.
    """
    chance = np.random.default_rng(seed)
    shop = RandomLinks(chance)
    main, origin = shop.direction(), chance.uniform(-0.05, 0.05, 3)
    shop.joint("crank", "revolute", GROUND, "arm", origin, main)

    def offset(point: np.ndarray) -> np.ndarray:
        away = chance.uniform(0.03, 0.08) * shop.across(main)
        return point + away + chance.uniform(-0.02, 0.02) * main

    def ratio() -> float:
        return float(chance.uniform(0.4, 0.8) ** chance.choice([-1.0, 1.0]) * chance.choice([-1.0, 1.0]))

    planet_at = offset(origin)
    shop.joint("wheel", "revolute", GROUND, "wheel", offset(origin), main)
    shop.joint("planet", "revolute", "arm", "planet", planet_at, main)
    shop.joint("second", "revolute", "arm", "second", offset(planet_at), main)
    shop.joint("rack", "prismatic", "arm", "rack", offset(planet_at), shop.across(main))
    bevel = shop.across(main) + chance.uniform(-0.8, 0.8) * main
    bevel /= np.linalg.norm(bevel)
    apex = origin + chance.uniform(0.02, 0.04) * main
    shop.joint("bevel", "revolute", GROUND, "bevel", apex + chance.uniform(0.03, 0.05) * bevel, bevel)
    shop.joint("skew", "revolute", GROUND, "skew", offset(apex) + 0.05 * bevel, bevel)
    shop.joint("cam", "prismatic", "wheel", "cam", offset(origin), shop.direction())
    nut, guide = shop.across(main), offset(origin)
    shop.joint("thread", "screw", "bevel", "nut", apex + 0.1 * bevel, bevel, lead=0.004)
    shop.joint("guide", "prismatic", GROUND, "nut", guide + 0.03 * nut, bevel)
    angles = chance.uniform(0.2, 0.5, 5) if pressure_angle is None else np.full(5, pressure_angle)
    gears = (
        Gear("crank", "wheel", ratio(), 0.0, float(angles[0])),
        Gear("crank", "planet", ratio(), 0.0, float(angles[1])),
        Gear("planet", "second", ratio(), 0.0, float(angles[2])),
        Gear("crank", "bevel", ratio(), 0.0, float(angles[3])),
        Gear("crank", "skew", ratio()),
    )
    couplings = (
        Coupling("mesh", "rack", "planet", (0.0, 0.03 * ratio()), pressure_angle=float(angles[4])),
        Coupling("groove", "cam", "wheel", (0.0, 0.01, 0.004, -0.002)),
    )
    links = tuple(Link(name, inertia=shop.inertia()) for name in shop.poses)
    points = {name: (name, (0.01, -0.02, 0.015)) for name in shop.poses}
    return Mechanism("train", links, tuple(shop.joints), "crank", points, gears, shop.poses, 0.0, couplings)


def spindle_and_rack(seed: int, spindle_first: bool) -> Mechanism:
    """Return a spindle on an arm, whose nut turns a pinion on the arm by a rack: all joints drive or couple.

    In MuJoCo's model the joint of the spindle leads to a virtual body of its link b.
    """
    chance = np.random.default_rng(seed)
    shop = RandomLinks(chance)
    main, origin = shop.direction(), chance.uniform(-0.05, 0.05, 3)
    across = shop.across(main)
    shop.joint("crank", "revolute", GROUND, "arm", origin, main)
    spindle = origin + 0.05 * across
    shop.link("spindle")
    sides = ["spindle", "arm"] if spindle_first else ["arm", "spindle"]
    shop.between("spindle", "revolute", sides, spindle, main)
    shop.joint("thread", "screw", "spindle", "nut", spindle + 0.03 * main, main, lead=0.02)
    shop.between("guide", "prismatic", ["nut", "arm"], spindle + 0.04 * np.cross(main, across), main)
    shop.joint("pinion", "revolute", "arm", "pinion", origin + 0.01 * main, across)
    gears = (Gear("crank", "spindle", -1.6, 0.0, 0.3),)
    rack = Coupling("rack", "pinion", "guide", (0.0, 1.0 / 0.015), pressure_angle=0.4)
    links = tuple(Link(name, inertia=shop.inertia()) for name in shop.poses)
    points = {name: (name, (0.01, -0.02, 0.015)) for name in shop.poses}
    return Mechanism(
        "spindle_and_rack", links, tuple(shop.joints), "crank", points, gears, shop.poses, 0.0, (rack,)
    )
