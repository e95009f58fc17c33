import os
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from drawing import draws
from grids import grid
from picture_colours import coloured, hues
from processes import python

import mechsim as ms
from mechsim.errors import MissingToolError, OutputError
from mechsim.mechanism.links import GROUND
from mechsim.pictures import render
from mechsim.pictures.render import gl_backend, video
from mechsim.pictures.render.drawing import Source
from mechsim.pictures.render.drawn_model import DrawnModel, drawn_as
from mechsim.pictures.render.frame_poses import frame_poses
from mechsim.shapes import camera
from mechsim.shapes.body import link_colours, point_colours
from mechsim.shapes.shape import PALETTE

NAMES = list(ms.catalog.MECHANISMS)
ANGLES = np.linspace(0.0, 2.0 * np.pi, 37)
SIZE = (320, 240)


def test_a_mechanism_higher_than_180_m_is_framed():
    """MuJoCo treats the height of a parallel camera as an angle and rejects 180 and more."""
    linkage = ms.catalog.make("four_bar", ground=1000.0, crank=320.0, coupler=910.0, rocker=740.0)
    drawn = DrawnModel(
        linkage.mechanism, frame_poses(linkage.mechanism, linkage.solve(ANGLES, 60.0)), ms.Look(size=SIZE)
    )
    assert drawn.model.cam_fovy == pytest.approx([drawn.camera.height])
    assert drawn.camera.height > 180.0


def frames_of(mechanism, motion, **options):
    """Return frames with only the mechanism and the ground."""
    plain = {"size": SIZE, "paths": False, "labels": False, "notes": False}
    return render.frames(mechanism, motion, **{**plain, **options})


def crank_motion(angles):
    tip = (0.03, 0.0, 0.0)
    crank = ms.Joint("crank", "revolute", ms.End(GROUND), ms.End("crank"))
    lever = ms.Mechanism("lever", (ms.Link("crank", (tip,)),), (crank,), "crank", {"A": ("crank", tip)})
    return lever, ms.loops.solve(lever, angles)


def decoded(path, size):
    """Return the frames of a video decoded by ffmpeg: (n, height, width, 3)."""
    command = [render.find_ffmpeg(), "-v", "error", "-i", str(path)]
    command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


@pytest.mark.long
@draws
@pytest.mark.parametrize("name", grid(NAMES, ("rssr",)))
def test_every_link_is_visible_in_every_frame(name):
    linkage = ms.catalog.make(name)
    mechanism = linkage.mechanism
    for picture in frames_of(mechanism, linkage.solve(ANGLES[::12], 60.0)):
        for link, rgba in link_colours(mechanism).items():
            assert coloured(picture, rgba).sum() > 25, link


@pytest.mark.long
@draws
@pytest.mark.parametrize(
    ("name", "view"),
    grid([(name, view) for name in NAMES for view in camera.PRESETS], ("bennett",)),
)
def test_no_link_reaches_the_border(name, view):
    linkage = ms.catalog.make(name)
    for picture in frames_of(
        linkage.mechanism, linkage.solve(ANGLES[::36], 60.0), camera=view, paths="whole"
    ):
        _, saturation = hues(picture)
        edge = np.concatenate([saturation[:5].ravel(), saturation[-5:].ravel(), saturation[:, :5].ravel()])
        assert max(edge.max(), saturation[:, -5:].max()) < 0.2


@pytest.mark.long
@draws
def test_a_moving_point_is_drawn_at_its_projected_position():
    angles = np.linspace(0.0, 2.0 * np.pi, 9)
    mechanism, motion = crank_motion(angles)
    stage = DrawnModel(mechanism, frame_poses(mechanism, motion), ms.Look(size=SIZE, camera="shaft"))
    pictures = frames_of(mechanism, motion, camera="shaft")
    for picture, pin, tip in zip(pictures, np.zeros((9, 3)), stage.frames.points["A"], strict=True):
        observed = np.argwhere(coloured(picture, PALETTE[0]))[:, ::-1] + 0.5  # pixel centres
        start, end = stage.camera.pixel(pin), stage.camera.pixel(tip)
        direction = (end - start) / np.linalg.norm(end - start)
        along = (observed - start) @ direction
        # the ball at the tip is 1.5 rod radii in radius
        ball = 1.5 * stage.radius * stage.camera.scale
        assert along.max() == pytest.approx(np.linalg.norm(end - start) + ball, abs=1.6)
        tip_pixels = observed[along > np.linalg.norm(end - start) - 0.5 * ball]
        assert np.abs(tip_pixels.mean(0) - end) @ np.abs([direction[1], direction[0]]) < 1.0


@pytest.mark.long
@draws
def test_labels_and_notes_cover_little_of_the_picture(linkage, motion):
    plain = next(iter(frames_of(linkage.mechanism, motion)))
    with_labels = next(iter(frames_of(linkage.mechanism, motion, labels=True, notes=True)))
    changed = (plain != with_labels).any(2)
    assert 0.002 < changed.mean() < 0.12


@pytest.mark.long
@draws
def test_a_still_picture_shows_the_requested_crank_angle(linkage, motion):
    picture_at_angle = render.still(linkage.mechanism, motion, size=SIZE, angle=float(ANGLES[2]), paths=False)
    frame = next(islice(render.frames(linkage.mechanism, motion, size=SIZE, paths=False), 2, None))
    assert (np.abs(picture_at_angle.astype(int) - frame).max(2) > 30).mean() < 1e-3


def test_frames_are_evenly_spaced_without_a_repeated_frame(linkage, motion):
    angles = render.turn_angles(linkage.mechanism, motion, 36)
    np.testing.assert_allclose(angles, np.deg2rad(10.0 * np.arange(36)), atol=1e-12)


def test_interpolated_frames_have_rigid_links(linkage):
    motion = linkage.solve(ANGLES, 60.0)
    between = frame_poses(linkage.mechanism, motion, ANGLES[:-1] + 0.03)
    exact = linkage.solve(ANGLES[:-1] + 0.03, 60.0)
    for name, pose in between.poses.items():
        if name != GROUND:
            np.testing.assert_allclose(
                pose.rotation.swapaxes(1, 2) @ pose.rotation, np.tile(np.eye(3), (36, 1, 1)), atol=1e-12
            )
            assert (
                np.abs(pose.position - exact.links[name].position).max()
                < 0.01 * linkage.mechanism.characteristic_length
            )


@pytest.mark.long
@draws
@pytest.mark.parametrize("name", grid(gl_backend.ORDER, gl_backend.ORDER[:1]))
def test_each_back_end_draws_the_same_picture(name, linkage, motion, tmp_path):
    if gl_backend.probe(name) is None:
        pytest.skip(
            f"{name} does not work here; the system package {gl_backend.PACKAGES.get(name, '?')} brings it"
        )
    # mujoco is imported first, as possible in a user's program
    script = f"""
import mujoco, sys
import numpy as np
from mechsim import catalog
from mechsim.pictures import render
drive = catalog.make("rssr")
motion = drive.solve(np.linspace(0.0, 2.0 * np.pi, 37), 60.0)
picture = render.still(drive.mechanism, motion, size={SIZE})
from OpenGL import GL
np.save(sys.argv[1], picture)
"""
    saved, package = tmp_path / "picture.npy", str(Path(render.__file__).parents[2])
    variables = {"MUJOCO_GL": name, "PYOPENGL_PLATFORM": None, "PYTHONPATH": package}
    completed = python("-W", "error", "-c", script, saved, **variables)
    assert (completed.returncode, completed.stderr) == (0, "")
    reference = render.still(linkage.mechanism, motion, size=SIZE)
    assert (np.abs(np.load(saved).astype(int) - reference).max(2) > 60).mean() < 0.01


def test_missing_opengl_is_reported_with_the_packages(monkeypatch):
    monkeypatch.setattr(gl_backend, "probe", lambda name: None)
    monkeypatch.delenv("PYOPENGL_PLATFORM", raising=False)
    with pytest.raises(MissingToolError, match="libegl1 or libosmesa6"):
        gl_backend.choose()
    assert [row["works"] for row in gl_backend.describe_backend()] == [False] * len(gl_backend.ORDER)


@pytest.mark.long
@draws
@pytest.mark.parametrize("extension", grid((*video.CODECS,), (".mp4",)))
def test_videos_contain_every_frame_at_the_requested_size(extension, linkage, motion, tmp_path):
    path = tmp_path / f"turn{extension}"
    angles = render.turn_angles(linkage.mechanism, motion, 12)
    count = render.write_video(path, linkage.mechanism, motion, angles=angles, size=SIZE, fps=12.0)
    assert count == 12
    observed = decoded(path, SIZE)
    assert len(observed) == 12
    drawn = next(iter(render.frames(linkage.mechanism, motion, angles=angles, size=SIZE)))
    assert np.abs(observed[0].astype(int) - drawn).mean() < 6.0
    assert [written.name for written in tmp_path.iterdir()] == [path.name]


@draws
def test_a_path_without_extension_becomes_a_directory_of_pictures(linkage, motion, tmp_path):
    from PIL import Image

    assert (
        render.write_video(tmp_path / "frames", linkage.mechanism, motion, angles=ANGLES[:3], size=SIZE) == 3
    )
    names = sorted(path.name for path in (tmp_path / "frames").iterdir())
    assert names == ["00000.png", "00001.png", "00002.png"]
    with Image.open(tmp_path / "frames" / names[0]) as image:
        assert image.size == SIZE
    with pytest.raises(OutputError, match="not an empty directory"):
        render.write_video(tmp_path / "frames", linkage.mechanism, motion, size=SIZE)
    assert len(list(tmp_path.iterdir())) == 1


def test_a_missing_ffmpeg_is_rejected_before_the_first_frame(linkage, motion, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingToolError, match="imageio-ffmpeg"):
        render.write_video(tmp_path / "a.mp4", linkage.mechanism, motion)
    assert not list(tmp_path.iterdir())


def test_a_broken_ffmpeg_is_skipped(tmp_path, monkeypatch):
    broken = tmp_path / "ffmpeg"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert render.find_ffmpeg() != str(broken)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingToolError, match=r"ffmpeg does not run; install"):
        render.find_ffmpeg()


@pytest.mark.long
@pytest.mark.parametrize("extension", [".mp4", ".gif"])
def test_a_video_cut_short_by_an_encoder_that_reports_success_is_not_written(
    linkage, motion, tmp_path, monkeypatch, extension
):
    # as ffmpeg 5.1 does on a full disk
    cutting = tmp_path / "ffmpeg"
    script = """#!{python}
import os, subprocess, sys
code = subprocess.run([{ffmpeg!r}, *sys.argv[1:]]).returncode
if sys.argv[-2] == "-y":
    os.truncate(sys.argv[-1], os.path.getsize(sys.argv[-1]) * 9 // 10)
sys.exit(code)
"""
    cutting.write_text(script.format(python=sys.executable, ffmpeg=render.find_ffmpeg()))
    cutting.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    assert render.find_ffmpeg() == str(cutting)
    path = tmp_path / f"video{extension}"
    path.write_bytes(b"earlier")
    with pytest.raises(OutputError, match="of 6 frames"):
        render.write_video(path, linkage.mechanism, motion, angles=motion.angle[:6], size=(64, 48))
    assert path.read_bytes() == b"earlier"


def test_paths_pass_through_the_exact_curve_between_frames():
    linkage = ms.catalog.make("four_bar")
    motion = linkage.solve(np.linspace(0.0, 2.0 * np.pi, 6 * 60 + 1), 60.0)
    frames = frame_poses(linkage.mechanism, motion, every=60)
    np.testing.assert_array_equal(frames.angle, motion.angle[::60])
    np.testing.assert_array_equal(frames.passed, np.arange(7) * 60 + 1)
    # the frames alone make a hexagon
    np.testing.assert_allclose(frames.paths["B"], motion.points["B"].position, atol=1e-15)


def test_the_last_state_of_a_run_is_a_frame():
    linkage = ms.catalog.make("four_bar")
    motion = linkage.solve(np.linspace(0.0, 1.0, 12), 60.0)
    frames = frame_poses(linkage.mechanism, motion, every=4)
    np.testing.assert_array_equal(frames.angle, motion.angle[[0, 4, 8, 11]])
    with_ghost = Source(linkage.mechanism, motion, exact=motion, every=4).drawn(ms.Look(size=SIZE))
    assert with_ghost.ghost is not None
    assert len(with_ghost.ghost.poses["rocker"].position) == 4


def test_the_ring_of_a_bushing_lies_about_its_core():
    from mechsim.shapes.joints import link_shapes

    solver = ms.catalog.make("slider_crank")
    a, b = ms.End("rod", (0.1, 0.0, 0.0)), ms.End("slider")
    stiffness = tuple(map(tuple, np.eye(6)))
    bushings = ms.Forces(bushings=(ms.Bushing("mount", a, b, stiffness),))
    plain, shapes = (link_shapes(solver.mechanism, forces=forces) for forces in (None, bushings))
    (ring,), (core,) = ([s for s in shapes[link] if s not in plain[link]] for link in ("rod", "slider"))
    assert ring.centre == pytest.approx(a.point)
    assert ring.sizes[0] > core.sizes[0]
    assert np.ptp([core.frm, core.to], axis=0)[2] > np.ptp([ring.frm, ring.to], axis=0)[2]


@pytest.mark.long
@draws
def test_springs_are_drawn_between_their_ends():
    model = ms.load("bicycle_suspension", drive={"pivot": "0.1rad*sin(2*pi*t)"})
    look = replace(ms.Look(size=SIZE, labels=False, notes=False, paths=False), **drawn_as(model))
    motion = model.solve(t=np.linspace(0.0, 1.0, 5))
    ends = np.array(model.mechanism.points["frame"][1]), motion.points["shock"].position[0]

    def share_of_dark_pixels(chosen):
        """Return where dark grey pixels near the line of the ends lie along it, 0 to 1 between them."""
        image = next(render.frames(model.mechanism, motion, chosen)).astype(int)
        dark = np.argwhere((image.max(-1) < 130) & (np.ptp(image, axis=-1) < 25))[:, ::-1]
        camera = Source(model.mechanism, motion).drawn(chosen).camera
        a, b = (camera.pixel(end) for end in ends)
        along = (b - a) / np.linalg.norm(b - a)
        close = np.abs((dark - a) @ np.array([-along[1], along[0]])) < 12.0
        return (dark[close] - a) @ along / np.linalg.norm(b - a)

    share = share_of_dark_pixels(look)
    # the ball on the frame and the eye of the link cover the ends
    assert share.min() > -0.1
    assert share.max() < 1.1
    assert np.ptp(share) > 0.7
    assert share_of_dark_pixels(replace(look, forces=None)).size < 0.1 * share.size


@draws
def test_a_path_that_returns_on_itself_keeps_the_colour_of_its_point():
    model = ms.load("klann")
    motion = model.solve(np.linspace(0.0, 2.0 * np.pi, 181))
    look = ms.Look(size=SIZE, labels=False, notes=False, paths="whole")
    image = next(render.frames(model.mechanism, motion, look)).astype(float)
    view = Source(model.mechanism, motion).drawn(look).camera
    # E swings on a rocker: it passes each point twice
    path = np.array([view.pixel(point) for point in motion.points["E"].position])
    x, y = np.rint(path).astype(int).T
    shown = np.array([image[y + dy, x + dx] for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    own = 255.0 * 0.9 * np.array(point_colours(model.mechanism)["E"][:3])
    assert np.median(np.abs(shown - own).max(-1).min(0)) < 30.0


@pytest.mark.parametrize("look", [{"camera": "shaft"}, {"overlay": 4}])
def test_other_views_have_no_wall_shadow(look, linkage, motion):
    source = Source(linkage.mechanism, motion)
    assert not source.drawn(ms.Look(**look)).stands_on_wall
    assert source.drawn(ms.Look()).stands_on_wall


@draws
def test_a_mechanism_on_a_wall_darkens_it(monkeypatch, linkage, motion):
    def picture():
        plain = {"size": (320, 240), "labels": False, "notes": False, "paths": False}
        return render.still(linkage.mechanism, motion, **plain).astype(int).sum(2) / 3.0

    shadowed = picture()
    monkeypatch.setattr("mechsim.pictures.render.drawn_model.DrawnModel.stands_on_wall", False)
    lit = picture()
    darker = lit - shadowed > 20.0
    # a half to ten percent of the picture, and nothing is brighter
    assert 0.005 < darker.mean() < 0.1
    assert (shadowed - lit > 20.0).mean() < 0.001
