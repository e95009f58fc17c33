"""Bodies of a user's file are drawn with the positions and colours of the file and few triangles."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.pictures.render.drawing import Shadow, Source, named
from mechsim.pictures.render.drawn_model import drawn_as, file_bodies
from mechsim.pictures.render.look import Look
from mechsim.pictures.render.scenery import PAPER
from mechsim.pictures.view.offline_page import page
from mechsim.report.views import mechanism_view
from mechsim.shapes.shape import TriangleMesh

SCENE = """
<mujoco model="arm">
  <asset>
    <material name="red" rgba="0.8 0.1 0.1 1"/>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
  </asset>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <geom type="box" size="0.1 0.02 0.03" pos="0 0 -0.1"/>
    <body name="arm">
      <joint name="crank" axis="0 1 0"/>
      <geom type="mesh" mesh="wedge" material="red" pos="0.1 0 0" euler="0 0 90"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.01" rgba="0 0.5 0 1"/>
      <geom type="sphere" size="0.5" group="3"/>
      <body name="tip" pos="0.2 0 0"><geom type="ellipsoid" size="0.03 0.02 0.01"/></body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def solver(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(SCENE)
    return ms.load(str(path))


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


def test_a_scene_is_drawn_with_z_upwards_and_mesh_shadows(solver):
    drawn = Source(solver.mechanism, solver.solve([0.0, 1.0])).drawn(Look(**drawn_as(solver)))
    assert drawn.camera.up @ [0.0, 0.0, 1.0] == pytest.approx(1.0)
    scene = mujoco.MjvScene(drawn.model, maxgeom=200)
    Shadow(drawn).put(scene)
    meshes = {geom.dataid for geom in scene.geoms[: scene.ngeom] if geom.type == mujoco.mjtGeom.mjGEOM_MESH}
    assert len(meshes) == drawn.model.nmesh == 2


def test_a_pivot_at_a_point_is_labelled_with_the_name_of_the_point():
    linkage = ms.catalog.make("four_bar")
    mechanism = linkage.mechanism
    both = {**mechanism.points, "motor": ("crank", (0.0, 0.0, 0.0))}
    for points, reported in ((mechanism.points, {"crank", "rocker"}), (both, {"motor", "rocker"})):
        with_points = replace(mechanism, points=points)
        motion = ms.loops.solve(with_points, [0.0, 1.0])
        names = set(named(Source(with_points, motion).drawn(Look()), 0))
        assert names == reported | {"A", "B", "C"}


def test_the_page_contains_the_file_bodies(solver):
    view = mechanism_view(solver, 6.0, solver.source.limits)
    assert page(view).count('"kind":"facets"') == 2
    assert '"kind":"facets"' not in page(replace(view, bodies=None))


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
    drawn = Source(solver.mechanism, solver.solve([0.0, 1.0])).drawn(Look(**drawn_as(solver)))
    model, scene = drawn.model, mujoco.MjvScene(drawn.model, maxgeom=200)
    drawn.set_frame(0)
    mujoco.mjv_updateScene(
        model, drawn.data, mujoco.MjvOption(), None, mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    colours = {
        geom.objid: geom.rgba for geom in scene.geoms[: scene.ngeom] if geom.dataid >= 0 or geom.type != 0
    }
    expected = [shape.rgba for shapes in file_bodies(solver.source).values() for shape in shapes]
    assert (0.5, 0.5, 0.5, 1.0) in expected
    solids = [i for i in colours if model.geom_type[i] != mujoco.mjtGeom.mjGEOM_PLANE]
    np.testing.assert_allclose(sorted(colours[i].tolist() for i in solids), sorted(expected), atol=1e-6)


def test_a_body_too_small_to_see_is_omitted(tmp_path, monkeypatch):
    screw = '<mesh name="screw" vertex="0 0 0  1e-5 0 0  0 1e-5 0  0 0 1e-5"/></asset>'
    geom = '<geom type="mesh" mesh="screw" pos="0.1 0.013 0.05"/><geom type="capsule"'
    text = SCENE.replace("</asset>", screw).replace('<geom type="capsule"', geom)
    (tmp_path / "arm.xml").write_text(text)
    solver = ms.load(str(tmp_path / "arm.xml"))
    before = [shape for shapes in file_bodies(solver.source).values() for shape in shapes]
    monkeypatch.setattr("mechsim.pictures.render.drawn_model.MAX_TRIANGLES", 60)
    after = [shape for shapes in file_bodies(solver.source).values() for shape in shapes]
    assert len(after) == len(before) - 1
    assert all(len(shape.facets.vertices) >= 4 for shape in after if shape.facets)


def test_a_body_as_light_as_the_background_is_drawn_darker(tmp_path):
    path = tmp_path / "white.xml"
    path.write_text(
        SCENE.replace('size="0.1 0.02 0.03"', 'size="0.1 0.02 0.03" rgba="0.9 1 0.8 0.5"').replace(
            "0 0.5 0 1", "0.7 0.7 0.7 1"
        )
    )
    bodies = file_bodies(ms.load(str(path)).source)
    (box,) = bodies["ground"]
    rgb = np.array(box.rgba[:3])
    assert rgb / rgb[1] == pytest.approx([0.9, 1.0, 0.8], abs=1e-6)
    # two greys are distinguishable from a tenth of their luminance
    assert rgb @ [0.2126, 0.7152, 0.0722] < 0.9 * min(PAPER)
    assert box.rgba[3] == 0.5
    assert bodies["arm"][1].rgba[:3] == pytest.approx((0.7, 0.7, 0.7))
