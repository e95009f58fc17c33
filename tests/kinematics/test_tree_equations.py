"""Equations of a spanning tree: Jacobians, twists and velocity products for every kind of joint."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import end_at

import mechsim as ms
from mechsim.kinematics.loops.constraints import TreeLoops, cuts_of
from mechsim.kinematics.loops.kinematics import Coordinates, link_poses, twists, velocity_products
from mechsim.kinematics.loops.tree import spanning_tree
from mechsim.mechanism.links import GROUND

STEP, MIDDLE = 2e-3, 4
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / STEP
CROSS = 1.2
KINDS = ("revolute", "prismatic", "cylindrical", "universal", "spherical", "planar", "fixed")


def joint(name, kind, a, b):
    return ms.Joint(name, kind, a, b, CROSS) if kind == "universal" else ms.Joint(name, kind, a, b)


def branched(swap):
    """Return chains with joints of every kind, each described from either side."""
    chain = [
        ("universal", GROUND, "a"),
        ("spherical", "a", "b"),
        ("cylindrical", "b", "c"),
        ("spherical", "c", "d"),
        ("prismatic", GROUND, "e"),
        ("revolute", "e", "f"),
        ("universal", "f", "g"),
        ("cylindrical", "g", "h"),
        ("spherical", "g", "i"),
        ("planar", "i", "j"),
        ("floating", "j", "k"),
        ("fixed", "k", "l"),
        ("fixed", "shaft", "m"),
    ]
    random = np.random.default_rng(3)
    joints = []
    for i, (kind, inner, outer) in enumerate(chain):
        ends = [
            end_at(link, tuple(random.uniform(-0.2, 0.2, 3)), tuple(random.uniform(0.2, 1.0, 3)))
            for link in (inner, outer)
        ]
        joints.append(joint(f"j{i}", kind, *(ends[::-1] if (i + swap) % 2 else ends)))
    shaft = ms.Joint("shaft", "revolute", end_at(GROUND), end_at("shaft"))
    links = tuple(ms.Link(name) for name in ("shaft", *"abcdefghijklm"))
    return ms.Mechanism("branched", links, (shaft, *joints), "shaft", {})


class Moving:
    """A tree at nine instants of constant coordinate rates, optionally with a cut joint."""

    def __init__(self, swap, cut):
        mechanism = branched(swap)
        tree = spanning_tree(mechanism)
        assert not tree.cuts
        self.tree = replace(tree, cuts=(cut,) if cut else ())
        self.loops = TreeLoops(self.tree, cuts_of(self.tree), (), (0,))
        random = np.random.default_rng(8)
        turns = np.linalg.qr(random.normal(size=(len(tree.balls), 3, 3)))[0]
        turns *= np.sign(np.linalg.det(turns))[:, None, None]
        start = Coordinates(random.uniform(-0.7, 0.7, (tree.count, 9)), np.repeat(turns[..., None], 9, 3))
        start = Coordinates(np.repeat(start.values[:, :1], 9, 1), start.turns)
        rates = random.uniform(-1.0, 1.0, tree.count)
        self.rates = np.repeat((rates * self.loops.units)[:, None], 9, 1)
        self.coordinates = self.loops.displaced(start, np.outer(rates, STEP * (np.arange(9) - MIDDLE)))
        self.poses = link_poses(self.tree, self.coordinates)
        self.twist = twists(self.tree, self.poses, self.rates)
        self.drift = velocity_products(self.tree, self.poses, self.twist, self.rates)
        self.bias = self.loops.velocity_products(
            self.coordinates, self.poses, self.rates, self.twist, self.drift
        )


def assert_close(result, expected, tolerance=1e-9):
    assert np.abs(result - expected).max() <= tolerance * max(1.0, np.abs(expected).max())


def rotation_of(poses, link):
    """The link's axes as columns, (n, 3, 3)."""
    return poses.rotation[link].transpose(2, 0, 1)


@pytest.mark.parametrize("swap", [0, 1])
def test_twists_and_velocity_products_are_derivatives(swap):
    moving = Moving(swap, None)
    for link in range(len(moving.tree.branches)):
        rotated = rotation_of(moving.poses, link)
        position, twist = moving.poses.position[link].T, moving.twist[link].T
        assert_close(rotated @ rotated.transpose(0, 2, 1), np.eye(3), 1e-13)
        spin = np.tensordot(FIRST, rotated, 1) @ rotated[MIDDLE].T
        assert_close(twist[MIDDLE, 3:], spin[[2, 0, 1], [1, 2, 0]])
        assert_close(twist[MIDDLE, :3] + np.cross(twist[MIDDLE, 3:], position[MIDDLE]), FIRST @ position)
        assert_close(moving.drift[link, :, MIDDLE], FIRST @ twist)


@pytest.mark.parametrize("swap", [0, 1])
def test_coordinates_are_read_back_from_poses(swap):
    moving = Moving(swap, None)
    poses = {
        name: ms.Pose(moving.poses.position[i].T, rotation_of(moving.poses, i))
        for i, name in enumerate(moving.tree.links)
    }
    read = moving.loops.read(poses)
    scalars = np.delete(np.arange(moving.tree.count), moving.tree.ball_indices)
    assert_close(read.values[scalars], moving.coordinates.values[scalars], 1e-13)
    assert_close(read.turns, moving.coordinates.turns, 1e-13)


@pytest.mark.long
@pytest.mark.parametrize("swap", [0, 1])
@pytest.mark.parametrize("sides", ["dh", "hd", "d-", "-d"])
@pytest.mark.parametrize("kind", KINDS)
def test_jacobian_and_velocity_products_are_derivatives_of_the_residual(kind, sides, swap):
    ends = [
        end_at(GROUND if item == "-" else item, (0.05, -0.03, 0.08 + 0.02 * i), (0.3, 1.0 - i, 0.4))
        for i, item in enumerate(sides)
    ]
    cut = joint("cut", kind, *ends)
    # a slide without references gets those of the smallest rotation
    ends = (cut.a, cut.b)
    moving = Moving(swap, cut)
    residual, gradient, _ = moving.loops.linearise(moving.coordinates)
    rate = np.einsum("mkn,kn->mn", gradient, moving.rates / moving.loops.units[:, None])
    assert_close(rate[:, MIDDLE], residual @ FIRST)
    assert_close(moving.bias[:, MIDDLE], rate @ FIRST)
    # by hand, from the poses of the links
    ends_in_ground = []
    for end in ends:
        link = moving.tree.links.get(end.link, -1)
        rotation = np.broadcast_to(np.eye(3), (9, 3, 3)) if link < 0 else rotation_of(moving.poses, link)
        position = 0.0 if link < 0 else moving.poses.position[link].T
        ends_in_ground.append(
            (position + rotation @ np.array(end.point), (rotation @ end.frame).transpose(2, 0, 1))
        )
    (point_a, (xa, ya, za)), (point_b, (_, yb, zb)) = ends_in_ground
    offset = (point_b - point_a) / moving.tree.mechanism.characteristic_length
    aligned = [xa * zb, ya * zb]
    expected = {
        "revolute": [xa * offset, ya * offset, za * offset, *aligned],
        "prismatic": [xa * offset, ya * offset, *aligned, xa * yb],
        "cylindrical": [xa * offset, ya * offset, *aligned],
        "universal": [xa * offset, ya * offset, za * offset, za * zb - np.cos(CROSS) / 3.0],
        "spherical": [xa * offset, ya * offset, za * offset],
        "planar": [za * offset, *aligned],
        "fixed": [xa * offset, ya * offset, za * offset, *aligned, xa * yb],
    }[kind]
    assert_close(residual, np.array([row.sum(1) for row in expected]), 1e-13)
