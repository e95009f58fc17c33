import mujoco
import numpy as np
import pytest
from grids import grid

from mechsim import catalog
from mechsim.errors import MissingToolError
from mechsim.pictures.render import gl_backend
from mechsim.pictures.render.drawing import Shadow, Source
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
