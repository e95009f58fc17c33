import mujoco
import numpy as np
import pytest
from grids import grid
from motions import largest_difference
from picture_colours import coloured, hues

import mechsim as ms
from mechsim.errors import MissingToolError
from mechsim.pictures.render import gl_backend
from mechsim.pictures.render.scenery import CAMERA
from mechsim.shapes.body import link_colours
from mechsim.simulation import simulate
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled
from mechsim.studies.export import exported

NAMES = list(ms.catalog.MECHANISMS)


def full_turn(name):
    linkage = ms.catalog.make(name)
    return linkage if linkage.crank_range().full else ms.catalog.make("rssr", crank=0.014, rocker=0.03)


def assert_same(item, other):
    for quantity in ("position", "velocity", "acceleration"):
        assert largest_difference(item, other, quantity) == 0.0


@pytest.mark.long
@pytest.mark.parametrize("name", ["rssr", "warp_knitter", "looper"])
def test_visual_geoms_do_not_change_a_run_by_a_bit(name):
    linkage = full_turn(name)

    def run(spec):
        return simulate(spec, speed=60.0, settings=ms.Settings(steps_per_turn=60)).motion

    scene = ms.Scene(level="picture")
    assert_same(run(exported(linkage.mechanism, scene)), run(assembled(linkage.mechanism, scene)))


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
@pytest.mark.parametrize("name", grid(NAMES, ("rssr",)))
def test_an_exported_picture_scene_shows_every_link_in_mujoco(name):
    try:
        result = gl_backend.choose()
    except MissingToolError as missing:
        pytest.skip(str(missing))
    mechanism = ms.catalog.make(name).mechanism
    model = mujoco.MjModel.from_xml_string(to_xml(exported(mechanism, ms.Scene(level="picture"))))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with gl_backend.renderer(model, (320, 240), result) as drawing:
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
    data, free, scene = mujoco.MjData(model), mujoco.MjvCamera(), mujoco.MjvScene(model, 100)
    mujoco.mj_forward(model, data)
    mujoco.mjv_defaultFreeCamera(model, free)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, free, mujoco.mjtCatBit.mjCAT_ALL, scene)
    back = data.cam_xmat.reshape(-1, 3, 3)[model.camera("view").id][:, 2]
    # MuJoCo stores both in single precision
    assert np.dot(scene.camera[0].forward, back) == pytest.approx(-1.0, abs=1e-6)
