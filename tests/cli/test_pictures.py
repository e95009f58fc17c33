import shutil
import sys

import numpy as np
import pytest

import mechsim as ms
from mechsim.pictures.render.frame_poses import frame_poses

SMALL = ("--size", "96x72")


INITIAL = ("--initial", "crank.q=-95deg")


def test_a_missing_ffmpeg_is_rejected_before_rendering(mechsim, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    code, _, err = mechsim("render", "rssr", "-o", "a.mp4", *SMALL)
    assert code == 2
    assert "imageio-ffmpeg" in err


@pytest.mark.slow
def test_frames_of_a_swinging_run_have_their_time():
    run = ms.dynamics.run(
        ms.load("four_bar"),
        ms.Forces(gravity=(0.0, -9.81, 0.0)),
        initial={"crank.q": "30deg"},
        duration=0.6,
        samples=12,
    )
    frames = frame_poses(ms.catalog.make("four_bar").mechanism, run.motion, run.motion.angle[:-1])
    np.testing.assert_array_equal(frames.time, run.time[:-1])


@pytest.mark.parametrize(
    ("options", "frames", "least"),
    [
        (("four_bar", "-o", "a.png", "--positions", "6"), None, 360),
        (("four_bar", "-o", "a.gif", "--frames-per-turn", "12"), 12, 360),
        (("four_bar", "-o", "a.gif", *INITIAL, "--duration", "0.2"), 7, 360),
    ],
)
def test_paths_are_finer_than_frames(mechsim, monkeypatch, options, frames, least):
    drawn = []

    def write(path, mechanism, motion, look, **options):
        every = options.get("every", 1)
        drawn.append(frame_poses(mechanism, motion, options.get("angles"), every=every))
        return len(drawn[0])

    monkeypatch.setattr("mechsim.cli.render.write_picture", write)
    monkeypatch.setattr("mechsim.cli.render.write_video", write)
    assert mechsim("render", *options)[0] == 0
    assert frames is None or len(drawn[0]) == frames
    assert all(len(path) > least for path in drawn[0].paths.values())
