import numpy as np
import pytest

import mechsim as ms
from mechsim.pictures.render.frame_poses import frame_poses

INITIAL = ("--initial", "crank.q=-95deg")


@pytest.mark.slow
def test_frames_of_a_swinging_run_have_their_time():
    weight = ms.Forces(gravity=(0.0, -9.81, 0.0))
    run = ms.dynamics.run("four_bar", weight, initial={"crank.q": "30deg"}, duration=0.6, samples=12)
    frames = frame_poses(ms.catalog.make("four_bar").mechanism, run.motion, run.motion.angle[:-1])
    np.testing.assert_array_equal(frames.time, run.time[:-1])


@pytest.mark.parametrize(
    ("options", "frames"),
    [
        (("four_bar", "-o", "a.png", "--positions", "6"), None),
        (("four_bar", "-o", "a.gif", "--frames-per-turn", "12"), 12),
        (("four_bar", "-o", "a.gif", *INITIAL, "--duration", "0.2"), 7),
    ],
)
def test_paths_are_finer_than_frames(mechsim, monkeypatch, options, frames):
    drawn = []

    def write(path, mechanism, motion, look, **options):
        every = options.get("every", 1)
        drawn.append(frame_poses(mechanism, motion, options.get("angles"), every=every))
        return len(drawn[0])

    monkeypatch.setattr("mechsim.cli.render.write_picture", write)
    monkeypatch.setattr("mechsim.cli.render.write_video", write)
    assert mechsim("render", *options)[0] == 0
    assert frames is None or len(drawn[0]) == frames
    assert all(len(path) > 360 for path in drawn[0].paths.values())
