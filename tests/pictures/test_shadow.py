import mujoco
import numpy as np
import pytest
from grids import grid

from mechsim import catalog
from mechsim.errors import MissingToolError
from mechsim.pictures.render import gl_backend
from mechsim.pictures.render.drawing import DECOR, Shadow, Source
from mechsim.pictures.render.drawn_model import CAMERA
from mechsim.pictures.render.look import Look

ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)
SIZE = (320, 240)
OPTIONS = {"size": SIZE, "labels": False, "notes": False, "paths": False}

try:
    BACKEND = gl_backend.choose()
except MissingToolError as missing:
    REASON = str(missing)
else:
    REASON = ""
draws = pytest.mark.skipif(bool(REASON), reason=REASON or "OpenGL works")


def stage_of(name, exact=False, **look):
    linkage = catalog.make(name)
    motion = linkage.solve(ANGLES, 60.0)
    return Source(linkage.mechanism, motion, motion if exact else None).drawn(Look(**{**OPTIONS, **look}))


@draws
@pytest.mark.parametrize("name", grid(("rssr", "warp_knitter")))
def test_flat_shadows_agree_with_a_shadow_map(name):
    stage = stage_of(name)
    shadow = Shadow(stage)
    stage.set_frame(4)
    pictures = []
    stage.model.vis.quality.shadowsize = 4096
    # MuJoCo's own shadow map is the reference; it is drawn only if enabled from the start
    stage.model.light_castshadow[:] = True
    with gl_backend.renderer(stage.model, SIZE, BACKEND) as drawing:
        for flat, mapped in ((False, False), (True, False), (False, True)):
            stage.model.light_castshadow[:] = mapped
            drawing.update_scene(stage.data, CAMERA)
            if flat:
                shadow.put(drawing.scene)
            pictures.append(drawing.render().astype(int).sum(2) / 3.0)
        drawing.update_scene(stage.data, CAMERA)
        drawing.enable_segmentation_rendering()
        observed = drawing.render()[:, :, 0]
    wall = stage.model.geom_type[observed] == mujoco.mjtGeom.mjGEOM_PLANE
    bare, flat, mapped = pictures
    flat_shadow, mapped_shadow = (bare - flat > 20.0) & wall, (bare - mapped > 20.0) & wall
    assert mapped_shadow.sum() > 600
    # the edges are soft: one or two pixels of difference
    assert (flat_shadow & mapped_shadow).sum() > 0.8 * (flat_shadow | mapped_shadow).sum()
    assert np.median((bare - flat)[flat_shadow & mapped_shadow]) == pytest.approx(
        np.median((bare - mapped)[flat_shadow & mapped_shadow]), rel=0.15
    )
    # solids keep their brightness except at edges that share a pixel with the wall
    assert (np.abs(bare - flat)[~wall] > 8.0).mean() < 0.1


def test_a_ghost_has_no_shadow():
    plain, with_ghost = (Shadow(stage_of("four_bar", exact=exact)) for exact in (False, True))
    assert len(plain.geoms) == len(with_ghost.geoms) > 0
    assert with_ghost.drawn.model.ngeom > plain.drawn.model.ngeom


def test_shadow_layers_are_ordered_close_to_the_wall():
    stage = stage_of("looper")
    scene = mujoco.MjvScene(stage.model, 2000)
    stage.set_frame(0)
    shadow = Shadow(stage)
    shadow.put(scene)
    assert scene.ngeom == 3 * len(shadow.geoms)
    heights = np.array([(geom.pos - shadow.point) @ shadow.normal for geom in scene.geoms[: scene.ngeom]])
    assert heights.min() > 0.0
    assert heights.max() < 2e-3 * stage.camera.height
    # the darkest layer is on top
    by_height = np.argsort(heights, kind="stable").reshape(3, -1)
    tones = [{float(scene.geoms[i].rgba[0]) for i in layer} for layer in by_height]
    assert [len(tone) for tone in tones] == [1, 1, 1]
    assert max(tones[2]) < max(tones[1]) < max(tones[0])
    assert all(geom.category == DECOR for geom in scene.geoms[: scene.ngeom])
    full = mujoco.MjvScene(stage.model, 7)
    shadow.put(full)
    assert full.ngeom == 7


@pytest.mark.parametrize("look", [{"camera": "shaft"}, {"overlay": 4}])
def test_other_views_have_no_wall_shadow(look):
    assert not stage_of("rssr", **look).stands_on_wall
    assert stage_of("rssr").stands_on_wall
