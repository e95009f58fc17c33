"""Virtual bodies between several joints of one body: motions omit them, and pictures need their poses."""

from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.moved_links import moved_links

LOOPER = Path(__file__).parents[2] / "models" / "looper.xml"
ANGLES = np.linspace(0.0, 6.0, 7)


@pytest.fixture(scope="module")
def solver():
    return ms.load(str(LOOPER))


def test_poses_of_virtual_bodies_follow_from_their_joints(solver):
    unseen = [link.name for link in solver.mechanism.links if not link.is_body]
    assert unseen == ["~slide.way"]
    everything = solver.whole_motion(ANGLES)
    for motion in (
        solver.solve(ANGLES),
        ms.simulate(solver, speed=1.0, turns=6.0 / (2 * np.pi), samples=6).motion,
    ):
        assert unseen[0] not in motion.links
        placed = moved_links(solver.mechanism, motion)
        for name, pose in placed.items():
            expected = everything.links[name]
            # rounding of a turn of six radians
            assert np.abs(pose.position - expected.position).max() < 1e-13, name
            assert np.abs(pose.rotation - expected.rotation).max() < 1e-12, name


def test_a_motion_must_contain_every_body(solver):
    motion = solver.solve(ANGLES)
    motion.links.pop("crank")
    with pytest.raises(ms.InputError, match="the motion has no pose of link 'crank'"):
        moved_links(solver.mechanism, motion)
