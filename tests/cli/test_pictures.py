import shutil
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from drawing import draws

import mechsim as ms
from mechsim.model.forces import Forces
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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--from", "nowhere"), "there is no method 'nowhere'"),
        (("--slow", "10", "--frames-per-turn", "12"), "leave out --frames-per-turn"),
        (("--slow", "-1"), "give numbers above 0"),
        (("--frames-per-turn", "0"), "0 frames or samples"),
        (("--turns", "nan"), "nan turns"),
        (("--arrows", "speed"), "no arrow 'speed'"),
        (("--angle", "30deg"), "only on a .png file"),
        (("--from", "foo"), "choose closed, simulated or both"),
        (("--turns", "1e9"), "fewer than 10000"),
    ],
)
def test_invalid_options_of_render_are_rejected(mechsim, tmp_path, options, message):
    code, _, err = mechsim("render", "rssr", "-o", "a.gif", *options, *SMALL)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--fps", "20"), "--fps has no effect on a picture"),
        (("--slow", "10"), "--slow has no effect on a picture"),
        (("--positions", "3", "--angle", "20deg"), "--angle has no effect with --positions"),
        (("--drive", "crank=sin(t)", "--speed", "5rpm"), "--speed has no effect under motion laws"),
    ],
)
def test_animation_options_for_a_still_picture_are_rejected(mechsim, tmp_path, options, message):
    code, _, err = mechsim("render", "rssr", "-o", "a.png", *options, *SMALL)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_scene_options_for_a_toml_export_are_rejected(mechsim, tmp_path):
    code, _, err = mechsim("export", "rssr", "--format", "toml", "--scene", "pose", "-o", "a.toml")
    assert code == 2
    assert "--scene, --cut, --speed and settings are for MuJoCo models" in err
    assert not list(tmp_path.iterdir())


INITIAL = ("--initial", "crank.q=-95deg")


@pytest.mark.long
@pytest.mark.parametrize("kind", plot_table.PLOTS)
def test_every_kind_of_plot_is_drawn(mechsim, tmp_path, monkeypatch, kind):
    for name in ("SAMPLES", "ERROR_SAMPLES"):
        monkeypatch.setattr(plot_table, name, 36)
    quantities = ("--of", "crank.v,distance:A,C,torque") if kind == "quantities" else ()
    assert mechsim("plot", "warp_knitter", "--kind", kind, *quantities, "-o", "a.svg")[0] == 0
    assert ET.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--kind", "motion", "--of", "A.x,A.y"), "takes no --of, which is of quantities; leave it out"),
        (("--kind", "transmission", "--from", "simulated"), "takes no --from, which is of motion, curve, "),
        (("--kind", "error", "--points", "A"), "takes no --points"),
        (("--kind", "quantities"), "no quantity is named; give --of"),
        (("--kind", "phase"), "there is no plot 'phase'; choose from error, poses, motion, curve, "),
        (("--drive", "crank=sin(t)", "--speed", "5rpm"), "--speed has no effect under motion laws"),
    ],
)
def test_an_option_of_another_kind_of_plot_is_rejected(mechsim, tmp_path, options, message):
    code, _, err = mechsim("plot", "four_bar", *options, "-o", "a.png")
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


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


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--mode", "2", *INITIAL), "there is no mode 2; this equilibrium has modes 1 to 1"),
        ((*INITIAL, "--angle", "3deg"), "--angle has no effect on drivers that are free"),
        ((*INITIAL, "--duration", "1e9s"), "frames; give a shorter --duration"),
    ],
)
def test_invalid_options_of_a_released_run_are_rejected(mechsim, options, message):
    code, _, error = mechsim("render", "four_bar", *options, "-o", "a.png")
    assert code == 2
    assert message in error


@pytest.mark.slow
def test_frames_of_a_swinging_run_have_their_time():
    run = ms.dynamics.run(
        ms.load("four_bar"),
        Forces(gravity=(0.0, -9.81, 0.0)),
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
