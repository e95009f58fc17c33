"""Bodies of a user's file are drawn with the positions and colours of the file and few triangles."""

import json
import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from drawing import viewer_scene
from model_files import FOLDER, model_text

import mechsim as ms
from mechsim.pictures.render.drawing import Source, named, still
from mechsim.pictures.render.drawn_model import drawn_as, file_bodies
from mechsim.pictures.render.look import Look
from mechsim.pictures.render.scenery import PAPER
from mechsim.pictures.view.offline_page import page
from mechsim.report.views import mechanism_view
from mechsim.shapes.shape import TriangleMesh
from mechsim.studies.drawn_motion import initial_pose, is_undriven

SCENE = model_text("file_bodies_scene.xml")


@pytest.fixture
def solver(file):
    return ms.load(file(SCENE))


def drawn_bodies(solver, motion=None):
    """Return the drawing of a file's bodies."""
    motion = solver.solve([0.0, 1.0]) if motion is None else motion
    return Source(solver.mechanism, motion).drawn(Look(**drawn_as(solver)))


def test_geoms_have_the_poses_and_colours_of_the_file(solver):
    bodies = file_bodies(solver.source)
    assert set(bodies) == {"ground", "arm"}
    (box,) = bodies["ground"]  # a plane is infinite
    assert (box.kind, box.half_sizes) == ("box", pytest.approx((0.1, 0.02, 0.03)))
    wedge, capsule, ball = bodies["arm"]  # collision geoms are not drawn
    assert wedge.rgba == pytest.approx((0.8, 0.1, 0.1, 1.0))
    corners = np.array([[0.1, 0, 0], [0.1, 0.1, 0], [0, 0, 0], [0.1, 0, 0.1]])
    result = wedge.facets.vertices
    assert sorted(map(tuple, result.round(6))) == sorted(map(tuple, corners.round(6)))
    assert capsule.rgba[1] == pytest.approx(0.5)
    assert sorted([capsule.frm, capsule.to])[1] == pytest.approx((0.2, 0.0, 0.0), abs=1e-12)
    low, high = ball.facets.vertices.min(0), ball.facets.vertices.max(0)
    np.testing.assert_allclose((low + high) / 2, [0.2, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose((high - low) / 2, [0.03, 0.02, 0.01], rtol=0.02)


def test_a_pivot_at_a_point_is_labelled_with_the_name_of_the_point():
    linkage = ms.catalog.make("four_bar")
    mechanism = linkage.mechanism
    both = {**mechanism.points, "motor": ("crank", (0.0, 0.0, 0.0))}
    for points, reported in ((mechanism.points, {"crank", "rocker"}), (both, {"motor", "rocker"})):
        with_points = replace(mechanism, points=points)
        motion = ms.loops.solve(with_points, [0.0, 1.0])
        names = set(named(Source(with_points, motion).drawn(Look()), 0))
        assert names == reported | {"A", "B", "C"}


def test_a_coarser_mesh_keeps_its_size():
    azimuth, height = np.meshgrid(np.linspace(0, 2 * np.pi, 80), np.linspace(0, np.pi, 40))
    ball = np.stack([np.sin(height) * np.cos(azimuth), np.sin(height) * np.sin(azimuth), np.cos(height)], -1)
    a = (np.arange(39)[:, None] * 80 + np.arange(79)).ravel()
    fine = TriangleMesh(ball.reshape(-1, 3), np.stack([a, a + 1, a + 80], -1).astype(np.int32))
    coarse = fine.coarser(0.2)
    assert len(coarse.faces) < 0.3 * len(fine.faces)
    np.testing.assert_allclose(np.ptp(coarse.vertices, axis=0), 2.0, atol=0.2)
    assert coarse.faces.max() < len(coarse.vertices)


def test_every_solid_is_drawn_in_its_own_colour(solver):
    drawn = drawn_bodies(solver)
    assert drawn.camera.up @ [0.0, 0.0, 1.0] == pytest.approx(1.0)
    model = drawn.model
    drawn.set_frame(0)
    scene = viewer_scene(model, drawn.data)
    colours = {
        geom.objid: geom.rgba for geom in scene.geoms[: scene.ngeom] if geom.dataid >= 0 or geom.type != 0
    }
    expected = [shape.rgba for shapes in file_bodies(solver.source).values() for shape in shapes]
    assert (0.5, 0.5, 0.5, 1.0) in expected
    solids = [i for i in colours if model.geom_type[i] != mujoco.mjtGeom.mjGEOM_PLANE]
    np.testing.assert_allclose(sorted(colours[i].tolist() for i in solids), sorted(expected), atol=1e-6)


def test_a_body_as_light_as_the_background_is_drawn_darker(file):
    text = SCENE.replace('size="0.1 0.02 0.03"', 'size="0.1 0.02 0.03" rgba="0.9 1 0.8 0.5"')
    path = file(text.replace("0 0.5 0 1", "0.7 0.7 0.7 1"))
    bodies = file_bodies(ms.load(path).source)
    (box,) = bodies["ground"]
    rgb = np.array(box.rgba[:3])
    assert rgb / rgb[1] == pytest.approx([0.9, 1.0, 0.8], abs=1e-6)
    # two greys are distinguishable from a tenth of their luminance
    assert rgb @ [0.2126, 0.7152, 0.0722] < 0.9 * min(PAPER)
    assert box.rgba[3] == 0.5
    assert bodies["arm"][1].rgba[:3] == pytest.approx((0.7, 0.7, 0.7))


# a crank-rocker in the plane XZ that starts upright; its loop closes at (0.2, 0, 0.1)


def loop(tmp_path, visual="", colour="", axis="0 1 0", reach=""):
    path = tmp_path / "loop.xml"
    path.write_text(model_text("file_bodies_loop.xml", visual=visual, colour=colour, axis=axis, range=reach))
    return ms.load(str(path))


def mujoco_camera(spec):
    """Return the directions (back, up) of MuJoCo's free camera on a file, from MuJoCo's own scene."""
    model = spec.compile()
    (camera, _) = viewer_scene(model, mujoco.MjData(model)).camera
    return -np.array(camera.forward), np.array(camera.up)


@pytest.mark.long
@pytest.mark.parametrize("angles", ["", 'azimuth="120" elevation="-20"'])
def test_a_spatial_file_is_seen_through_its_own_camera(tmp_path, angles):
    path = tmp_path / "arm.xml"
    visual = f"<visual><global {angles}/></visual>" if angles else ""
    # a second joint makes it spatial
    text = SCENE.replace("<asset>", f"{visual}<asset>", 1)
    text = text.replace('pos="0.2 0 0">', 'pos="0.2 0 0"><joint name="wrist" axis="1 0 0"/>')
    path.write_text(text)
    solver = ms.load(str(path), drive={"crank": "0.5*t", "wrist": "0.3*t"})
    camera = drawn_bodies(solver, solver.solve(t=np.array([0.0, 1.0]))).camera
    back, up = mujoco_camera(solver.source.spec.copy())
    np.testing.assert_allclose([camera.back, camera.up], [back, up], atol=1e-6)
    cameras = page_data(solver)["cameras"]
    np.testing.assert_allclose([cameras[0]["back"], cameras[0]["up"]], [back, up], atol=1e-6)


def page_data(solver):
    """Return the data of the page of a file."""
    text = page(mechanism_view(solver, 10.0, {}), library="three.js")
    return json.loads(re.search(r'id="data"[^>]*>(.*?)</script>', text, re.S)[1])


@pytest.mark.parametrize("axis", ["0 1 0", "0 -1 0"])
@pytest.mark.parametrize("azimuth", [90, -70])
def test_a_planar_file_is_not_mirrored_against_mujoco(tmp_path, axis, azimuth):
    solver = loop(tmp_path, f'<visual><global azimuth="{azimuth}"/></visual>', axis=axis)
    camera = drawn_bodies(solver).camera
    back, up = mujoco_camera(solver.source.spec.copy())
    # straight on, from MuJoCo's side of the plane: x points to the same side of both pictures
    assert abs(camera.back[1]) == pytest.approx(1.0)
    assert camera.right[0] * np.cross(up, back)[0] > 0.3


@pytest.mark.long
def test_loop_closures_are_marked(tmp_path):
    solver = loop(tmp_path, colour='rgba="0.2 0.2 0.2 1"')
    look = Look(**drawn_as(solver))
    assert look.closures == ("pin",)
    motion = solver.solve([0.0, 0.4])
    drawn = Source(solver.mechanism, motion).drawn(look)
    (marked, unmarked) = (
        still(solver.mechanism, motion, shown, angle=0.0).astype(int)
        for shown in (look, replace(look, closures=()))
    )
    column, row = drawn.camera.pixel(np.array([0.2, 0.0, 0.1])).round().astype(int)
    red, green, blue = marked[row, column]
    assert red > green + 80
    assert blue > green + 80
    # nothing else changes: all differences lie within the mark
    changed = np.argwhere(np.abs(marked - unmarked).max(-1) > 3)
    reach = 0.6 * drawn.radius * drawn.camera.scale
    assert np.linalg.norm(changed - [row, column], axis=1).max() < reach + 2.0
    (closure,) = page_data(solver)["closures"]
    assert closure["link"] == "coupler"
    assert closure["at"] == pytest.approx([0.2, 0.0, 0.04])


def test_links_whose_meshes_are_missing_are_drawn_from_their_joints():
    solver = ms.load(str(FOLDER / "missing_meshes_bar.xml"))
    assert file_bodies(solver.source) is None
    drawn = drawn_bodies(solver)
    # the point that stands for a mesh has a radius of 1 mm; the arm is 100 mm long
    lengths = [np.ptp(shape.bounds[0], axis=0).max() for shape in drawn.shapes["arm"]]
    assert max(lengths) == pytest.approx(0.1, rel=0.05)


def test_the_camera_follows_a_fall():
    solver = ms.load(str(FOLDER / "falling_arm.xml"), still=True)
    motion = ms.dynamics.run(solver, duration=1.0, samples=20).motion
    drawn = drawn_bodies(solver, motion)
    # the machine is 420 mm long and falls 4.9 m
    assert drawn.camera.height < 0.6
    positions = []
    for frame in (0, 10, 20):
        drawn.set_frame(frame)
        positions.append(drawn.camera.position)
        foot = drawn.camera.pixel(motion.points["foot"].position[frame])
        assert foot.min() > 0.0
        assert (foot < drawn.look.size).all()
        np.testing.assert_array_equal(drawn.data.cam_xpos[0], drawn.camera.position)
    # without moments and contacts all of it falls by g t^2 / 2
    for time, position in zip((0.5, 1.0), positions[1:], strict=True):
        np.testing.assert_allclose(position - positions[0], [0.0, 0.0, -9.81 * time**2 / 2], atol=1e-9)


def test_the_initial_pose_is_drawn_without_a_motion_law():
    solver = ms.load(str(FOLDER / "falling_arm.xml"), still=True)
    assert [is_undriven(solver), is_undriven(ms.load("four_bar"))] == [True, False]
    pose = initial_pose(solver.mechanism)
    # the base is 1 m above the ground, the hip 0.1 m and the foot 0.3 m before it
    np.testing.assert_allclose(pose.points["foot"].position, [[0.3, 0.0, 1.0]], atol=1e-12)
    drawn = Source(solver.mechanism, pose).drawn(Look())
    assert not drawn.drift.any()
