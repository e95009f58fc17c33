import mujoco
import numpy as np
import pytest
from drawing import draws, viewer_scene
from grids import grid
from picture_colours import coloured, hues

import mechsim as ms
from mechsim.pictures.render import gl_backend
from mechsim.pictures.render.scenery import CAMERA
from mechsim.shapes.body import link_colours
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled
from mechsim.studies.export import exported

NAMES = list(ms.catalog.MECHANISMS)


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_visual_geoms_have_no_mass_and_no_contact(name):
    mechanism = ms.catalog.make(name).mechanism
    drawn = exported(mechanism, ms.Scene(level="picture")).compile()
    plain = assembled(mechanism, ms.Scene(level="picture")).compile()
    assert plain.ngeom == 0
    assert drawn.ngeom > len(mechanism.links)
    assert not drawn.geom_contype.any()
    assert not drawn.geom_conaffinity.any()
    for array in ("body_mass", "body_inertia", "body_ipos", "body_invweight0", "dof_invweight0", "qpos0"):
        np.testing.assert_array_equal(getattr(drawn, array), getattr(plain, array))


@pytest.mark.long
@draws
@pytest.mark.parametrize("name", grid(NAMES, ("rssr",)))
def test_an_exported_picture_scene_shows_every_link_in_mujoco(name):
    mechanism = ms.catalog.make(name).mechanism
    model = mujoco.MjModel.from_xml_string(to_xml(exported(mechanism, ms.Scene(level="picture"))))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with gl_backend.renderer(model, (320, 240), gl_backend.choose()) as drawing:
        drawing.update_scene(data, CAMERA)
        picture = drawing.render()
    for link, rgba in link_colours(mechanism).items():
        assert coloured(picture, rgba).sum() > 25, link
    _, saturation = hues(picture)
    rim = [saturation[:5], saturation[-5:], saturation[:, :5].T, saturation[:, -5:].T]
    assert max(edge.max() for edge in rim) < 0.2


@pytest.mark.parametrize("name", ["four_bar", "rssr"])
def test_the_viewer_of_mujoco_starts_from_the_side_of_the_camera(name):
    model = mujoco.MjModel.from_xml_string(ms.export(name, scene="picture").text)
    data = mujoco.MjData(model)
    scene = viewer_scene(model, data)
    back = data.cam_xmat.reshape(-1, 3, 3)[model.camera("view").id][:, 2]
    # MuJoCo stores both in single precision
    assert np.dot(scene.camera[0].forward, back) == pytest.approx(-1.0, abs=1e-6)
