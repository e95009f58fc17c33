import shutil
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from drawing import draws

import mechsim as ms
from mechsim.pictures.render.frame_poses import frame_poses
from mechsim.report import plot_table

SMALL = ("--size", "96x72")


@pytest.mark.long
@draws
@pytest.mark.parametrize("angle", ["60deg", "-60deg", "119deg"])
def test_a_swinging_crank_is_rendered_within_its_range(mechsim, tmp_path, angle):
    options = ("render", "four_bar", "--set", "crank=90mm", "--angle", angle)
    code, _, err = mechsim(*options, "-o", "a.png", *SMALL)
    assert code == 0, err
    code, _, err = mechsim(*options[:-1], "160deg", "-o", "b.png", *SMALL)
    assert code == 2
    assert "its range is from -2.10243" in err
    assert not (tmp_path / "b.png").exists()


@pytest.mark.long
@draws
@pytest.mark.parametrize("method", ["closed", "simulated", "both"])
def test_pictures_are_rendered_from_either_method_or_both(mechsim, tmp_path, method):
    code, out, err = mechsim("render", "rssr", "--from", method, "--angle", "40deg", "-o", "a.png", *SMALL)
    assert (code, out) == (0, "wrote a.png\n"), err
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


INITIAL = ("--initial", "crank.q=-95deg")


@pytest.mark.long
@pytest.mark.parametrize("kind", plot_table.PLOTS)
def test_every_kind_of_plot_is_drawn(mechsim, tmp_path, monkeypatch, kind):
    monkeypatch.setattr(plot_table, "ERROR_SAMPLES", 36)
    quantities = ("--of", "crank.v,distance:A,C,torque") if kind == "quantities" else ()
    assert mechsim("plot", "warp_knitter", "--kind", kind, *quantities, "-o", "a.svg")[0] == 0
    assert ET.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")


@pytest.mark.long
@draws
@pytest.mark.parametrize("name", ["landing_gear", "spring_gripper"])
def test_a_file_without_a_motion_law_is_rendered(mechsim, tmp_path, name):
    code, out, err = mechsim("render", name, "-o", "a.png", *SMALL)
    assert (code, out.splitlines()[0]) == (0, "wrote a.png"), err
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    # a law of the crank has no meaning there
    assert mechsim("render", name, "--speed", "60rpm", "-o", "b.png", *SMALL)[0] == 2


def test_a_missing_ffmpeg_is_rejected_before_rendering(mechsim, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    code, _, err = mechsim("render", "rssr", "-o", "a.mp4", *SMALL)
    assert code == 2
    assert "imageio-ffmpeg" in err


@pytest.mark.long
@draws
@pytest.mark.parametrize(
    ("name", "options", "count"),
    [
        ("four_bar", ("--frames-per-turn", "6", "--turns", "1.5"), 10),
        # after a turn of the carrier the planet has another angle
        ("planetary_gear", ("--frames-per-turn", "6"), 7),
        # periodic motion laws
        ("five_bar", ("--fps", "8"), 8),
    ],
)
def test_a_periodic_video_omits_its_repeated_last_frame(mechsim, name, options, count):
    assert mechsim("render", name, "-o", "frames", "--size", "32x24", *options)[:2] == (
        0,
        f"wrote {count} frames to frames\n",
    )


@pytest.mark.slow
@draws
def test_released_runs_and_modes_are_rendered_and_viewed(mechsim, tmp_path):
    small = ("--size", "96x64")
    run = (*INITIAL, *small, "--duration", "0.1s")
    code, out, _ = mechsim("render", "four_bar", *run, "-o", "run.gif", "--slow", "2")
    assert (code, out.splitlines()[0]) == (0, "wrote 7 frames to run.gif")
    code, out, _ = mechsim(
        "render", "four_bar", *INITIAL, *small, "--mode", "1", "--fps", "5", "-o", "mode.gif"
    )
    # one cycle of two seconds without the repeated last frame
    assert (code, out.splitlines()[0]) == (0, "wrote 10 frames to mode.gif")
    for options in (INITIAL, (*INITIAL, "--mode", "1")):
        assert mechsim("view", "four_bar", *options, "-o", "page.html")[0] == 0
        assert ("four_bar, mode 1" if "--mode" in options else "four_bar, released") in (
            tmp_path / "page.html"
        ).read_text()


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
