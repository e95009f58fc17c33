import mujoco
import numpy as np
import pytest
from test_render import coloured, hues

from mechsim import catalog, mjcf, render
from mechsim.errors import MissingToolError
from mechsim.mjcf.picture import CAMERA
from mechsim.render import backend
from mechsim.scene import Scene
from mechsim.shapes import link_colours
from mechsim.simulation import Settings, simulate

NAMES = list(catalog.DRIVES)


def full_turn(name):
    drive = catalog.make(name)
    return drive if drive.crank_range().full else catalog.make("rssr", crank=0.014, rocker=0.03)


def same(one, other):
    for name, point in one.points.items():
        for kind in ("position", "velocity", "acceleration"):
            np.testing.assert_array_equal(getattr(point, kind), getattr(other.points[name], kind))


def bare(monkeypatch):
    """From here on scenes of level "picture" are generated without their pictures."""
    monkeypatch.setattr("mechsim.mjcf.picture.add_picture", lambda *_: None)


@pytest.mark.parametrize("name", ["rssr", "warp_knitter", "looper"])
def test_a_run_with_pictures_is_the_run_without_to_the_last_bit(name, monkeypatch):
    drive = full_turn(name)

    def run():
        settings, scene = Settings(steps_per_turn=60), Scene(level="picture")
        return simulate(drive.mechanism, speed=60.0, settings=settings, scene=scene).motion

    drawn = run()
    bare(monkeypatch)
    same(drawn, run())


def test_drawing_a_run_does_not_touch_it():
    drive = full_turn("rssr")
    before = simulate(drive.mechanism, speed=60.0, settings=Settings(steps_per_turn=60)).motion
    try:
        render.still(drive.mechanism, before, size=(64, 48))
    except MissingToolError as missing:
        pytest.skip(str(missing))
    same(before, simulate(drive.mechanism, speed=60.0, settings=Settings(steps_per_turn=60)).motion)


@pytest.mark.parametrize("name", NAMES)
def test_geoms_neither_weigh_nor_collide(name, monkeypatch):
    mechanism = catalog.make(name).mechanism
    drawn = mjcf.assembled(mechanism, Scene(level="picture")).compile()
    bare(monkeypatch)
    plain = mjcf.assembled(mechanism, Scene(level="picture")).compile()
    assert plain.ngeom == 0
    assert drawn.ngeom > len(mechanism.links)
    assert not drawn.geom_contype.any()
    assert not drawn.geom_conaffinity.any()
    for array in ("body_mass", "body_inertia", "body_ipos", "body_invweight0", "dof_invweight0", "qpos0"):
        np.testing.assert_array_equal(getattr(drawn, array), getattr(plain, array))


@pytest.mark.parametrize("name", NAMES)
def test_an_exported_picture_shows_every_link_to_any_user_of_mujoco(name):
    try:
        found = backend.choose()
    except MissingToolError as missing:
        pytest.skip(str(missing))
    mechanism = catalog.make(name).mechanism
    model = mujoco.MjModel.from_xml_string(mjcf.to_xml(mjcf.assembled(mechanism, Scene(level="picture"))))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with backend.renderer(model, (320, 240), found) as drawing:
        drawing.update_scene(data, CAMERA)
        picture = drawing.render()
    for link, rgba in link_colours(mechanism).items():
        assert coloured(picture, rgba).sum() > 25, link
    _, saturation = hues(picture)
    rim = [saturation[:5], saturation[-5:], saturation[:, :5].T, saturation[:, -5:].T]
    assert max(edge.max() for edge in rim) < 0.2
