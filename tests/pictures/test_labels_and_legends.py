from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND
from mechsim.pictures.render.drawing import Source, named
from mechsim.pictures.render.labels import foot, letters
from mechsim.shapes import camera
from mechsim.studies.drawn_motion import drawn_motion
from mechsim.studies.motions import profile_of


@pytest.mark.parametrize("name", ["four_bar", "rsur", "humanoid_ankle", "parallel_gripper"])
def test_every_pivot_on_the_ground_has_a_label(name):
    solver = ms.load(name)
    mechanism = solver.mechanism
    motion = drawn_motion(solver, "closed", profile_of(solver, 1.0, 0.1), 3)
    written = named(Source(mechanism, motion).drawn(ms.Look()), 0)
    positions = np.array(list(written.values()))
    for joint in mechanism.joints:
        for end in (joint.a, joint.b):
            if end.link == GROUND and KINDS[joint.kind].pivot:
                assert np.abs(positions - end.point).max(1).min() < 1e-12, joint.name


@pytest.mark.parametrize("size", [(400, 300), (1280, 720)])
@pytest.mark.parametrize("lines", [0, 1, 4])
def test_a_legend_does_not_cover_the_mechanism_and_nothing_reaches_the_border(size, lines):
    rng, mechanism, free = np.random.default_rng(4), ms.load("rssr").mechanism, foot(size, lines)
    for preset, stretch in product(camera.PRESETS, ((1.0, 1.0, 1.0), (1.0, 9.0, 1.0), (9.0, 1.0, 1.0))):
        points, radii = rng.normal(size=(50, 3)) * stretch, rng.uniform(0.0, 0.3, 50)
        view = camera.framed(*camera.directions(mechanism, preset), points, radii, size, foot=free)
        np.testing.assert_allclose(np.cross(view.right, view.up), view.back, atol=1e-12)
        pixels, reach = view.pixel(points), (radii * view.scale)[:, None]
        assert ((pixels - reach) >= np.array(size) * camera.BORDER - 1e-6).all()
        lowest = [1.0 - camera.BORDER, 1.0 - max(free, camera.BORDER)]
        assert ((pixels + reach) <= np.multiply(size, lowest) + 1e-6).all()
        # scale bar and the lines above it
        assert lines == 0 or size[1] * free >= letters(size) * (1.2 + 1.4 * lines)


def test_a_picture_is_scaled_to_fit_its_legend():
    linkage = ms.catalog.make("four_bar")
    motion = linkage.solve(np.linspace(0.0, 2.0 * np.pi, 25), 60.0)
    look = ms.Look(arrows=("velocity", "acceleration"), caption="slow")
    with_legend, without = (
        Source(linkage.mechanism, motion).drawn(item).camera for item in (look, replace(look, notes=False))
    )
    free, legend_fraction = 1.0 - 2.0 * camera.BORDER, foot(look.size, 3) - camera.BORDER
    assert with_legend.height * (free - legend_fraction) == pytest.approx(without.height * free)
