"""Links between several joints of one body: no motion tells of them, and pictures need their places."""

from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError
from mechsim.model.link_poses import moved_links

LOOPER = Path(__file__).parents[2] / "models" / "looper.xml"
ANGLES = np.linspace(0.0, 6.0, 7)


@pytest.fixture(scope="module")
def form():
    return ms.load(str(LOOPER))


def test_their_joints_state_where_they_are(form):
    unseen = [link.name for link in form.mechanism.links if not link.is_body]
    assert unseen == ["~slide.way"]
    everything = LoopForm.solve_along(form, ANGLES)
    for motion in (
        form.solve(ANGLES),
        ms.simulate(form, speed=1.0, turns=6.0 / (2 * np.pi), samples=6).motion,
    ):
        assert unseen[0] not in motion.links
        placed = moved_links(form.mechanism, motion)
        for name, pose in placed.items():
            wanted = everything.links[name]
            # rounding of a turn of six radians
            assert np.abs(pose.position - wanted.position).max() < 1e-13, name
            assert np.abs(pose.rotation - wanted.rotation).max() < 1e-12, name


def test_a_link_that_stands_for_a_body_has_to_be_reported(form):
    motion = form.solve(ANGLES)
    motion.links.pop("crank")
    with pytest.raises(InputError, match="does not say where link 'crank' is"):
        moved_links(form.mechanism, motion)
