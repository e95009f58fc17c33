"""Mechanisms for each kind of joint, loop and gear that the catalogue does not contain."""

from dataclasses import replace

import numpy as np
from model_files import model_mechanism, stated_mechanism

from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Link, Pose, Vector
from mechsim.mechanism.mechanism import Mechanism


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


def geared_five_bar() -> Mechanism:
    """Planar five-bar whose two cranks are geared."""
    return stated_mechanism("mechanisms_geared_five_bar.toml")


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


def on_one_crank(item: Mechanism, other: Mechanism) -> Mechanism:
    """Return two linkages on one crank."""
    names = {name: f"{name}'" for name in [link.name for link in other.links]} | {other.driver: item.driver}
    crank = item.crank.b.link
    names[other.crank.b.link] = crank

    def moved(end: End) -> End:
        return replace(end, link=names.get(end.link, end.link))

    joints = [
        replace(joint, name=f"{joint.name}'", a=moved(joint.a), b=moved(joint.b))
        for joint in other.joints
        if joint.name != other.driver
    ]
    return replace(
        item,
        links=(*item.links, *(Link(names[k.name]) for k in other.links if names[k.name] != crank)),
        joints=(*item.joints, *joints),
        points={
            **item.points,
            **{f"{p}'": (names[link], point) for p, (link, point) in other.points.items()},
        },
        guess={**item.guess, **{names[k]: v for k, v in other.guess.items() if names[k] != crank}},
    )
