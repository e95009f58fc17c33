"""Mechanisms for each kind of joint, loop and gear that the catalogue does not contain."""

from dataclasses import replace

import numpy as np
from model_files import model_mechanism

from mechsim import loops
from mechsim.mechanism.joints import End, Gear, Joint
from mechsim.mechanism.links import GROUND, Link, Pose, Vector
from mechsim.mechanism.mechanism import Mechanism

START = 0.7


def end_at(link: str, point: Vector = (0.0, 0.0, 0.0), axis: Vector = (0.0, 0.0, 1.0)) -> End:
    return End(link, point, axis)


def rsup() -> Mechanism:
    """Spatial slider-crank R-S-U-P, the universal joint's axes crossing at 70 degrees."""
    return model_mechanism("mechanisms_rsup.toml")


def rscr() -> Mechanism:
    """Spatial four-link R-S-C-R: the rod slides and turns in the lever."""
    return model_mechanism("mechanisms_rscr.toml")


def bennett() -> Mechanism:
    """Bennett's overconstrained spatial 4R: cut at a revolute joint, three of its six equations redundant."""
    return model_mechanism("mechanisms_bennett.toml")


def geared_five_bar(ratio: float = -1.5) -> Mechanism:
    """Planar five-bar whose two cranks are geared; a half-integer ratio has a period of two revolutions."""
    return placed(
        Mechanism(
            "geared_five_bar",
            (Link("one"), Link("two"), Link("rod"), Link("arm")),
            (
                Joint("shaft", "revolute", end_at(GROUND), end_at("one")),
                Joint("second", "revolute", end_at(GROUND, (0.09, 0.01, 0.0)), end_at("two")),
                Joint("A", "revolute", end_at("one", (0.021, 0.0, 0.0)), end_at("rod")),
                Joint("B", "revolute", end_at("two", (0.017, 0.0, 0.0)), end_at("arm")),
                Joint("C", "revolute", end_at("rod", (0.083, 0.0, 0.0)), end_at("arm", (0.071, 0.0, 0.0))),
            ),
            "shaft",
            {"C": ("rod", (0.083, 0.0, 0.0)), "B": ("two", (0.017, 0.0, 0.0))},
            gears=(Gear("shaft", "second", ratio, 0.4),),
            start=START,
        ),
        {
            "one": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.7)),
            "two": ((0.09, 0.01, 0.0), (0.0, 0.0, -0.65)),
            "rod": ((0.016, 0.014, 0.0), (0.0, 0.0, 0.69)),
            "arm": ((0.104, 0.0, 0.0), (0.0, 0.0, 1.91)),
        },
    )


def three_cranks(
    third_pivot: tuple[float, float], crank: float = 0.03, ground: float = 0.1, start: float = 0.35
) -> Mechanism:
    """Return a parallelogram with a third parallel crank, pivoted at a position of frame and coupler."""
    out, pivots = (crank, 0.0, 0.0), {"crank": (0.0, 0.0, 0.0), "rocker": (ground, 0.0, 0.0)}
    pivots["third"] = (*third_pivot, 0.0)
    joints = [Joint(name, "revolute", End(GROUND, position), End(name)) for name, position in pivots.items()]
    joints += [
        Joint(f"{name} pin", "revolute", End(name, out), End("coupler", position))
        for name, position in pivots.items()
    ]
    rotation = np.array(
        [[np.cos(start), -np.sin(start), 0], [np.sin(start), np.cos(start), 0], [0, 0, 1]], dtype=float
    )
    guess = {name: Pose(np.array(position), rotation) for name, position in pivots.items()}
    guess["coupler"] = Pose(rotation @ np.array(out), np.eye(3))
    point = {"B": ("coupler", (ground, 0.0, 0.0))}
    links = tuple(Link(name) for name in guess)
    return Mechanism("three cranks", links, tuple(joints), "crank", point, guess=guess, start=start)


def swapped(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with exchanged sides of every joint but the crank's."""
    fixed = {mechanism.driver, *(gear.driven for gear in mechanism.gears)}
    joints = tuple(
        joint if joint.name in fixed else replace(joint, a=joint.b, b=joint.a) for joint in mechanism.joints
    )
    return replace(mechanism, joints=joints)


def everything() -> list[Mechanism]:
    return [rsup(), rscr(), bennett(), geared_five_bar()]


def placed(mechanism: Mechanism, guess: dict[str, tuple[Vector, Vector]]) -> Mechanism:
    """Return the mechanism with a guess: link -> position and rotation vector."""
    poses = {
        name: Pose(np.array(position), loops.turned_by(np.eye(3)[None], np.array([rotation]))[0])
        for name, (position, rotation) in guess.items()
    }
    return mechanism.with_guess(poses, mechanism.start)
