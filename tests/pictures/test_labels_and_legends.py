from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.links import GROUND
from mechsim.pictures.label_positions import Rectangle, placed, shared
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


RANDOM = np.random.default_rng(2)
SIZE = (400, 300)


def overlaps(spots):
    return sum(a.meets(b) for i, a in enumerate(spots) for b in spots[:i])


def test_crowded_labels_do_not_overlap():
    points = [np.array(position) for position in RANDOM.uniform([150.0, 100.0], [250.0, 170.0], (9, 2))]
    note = Rectangle(0.0, 270.0, 160.0, 300.0)
    spots = [spot for spot, _ in placed(points, [45.0] * 9, 14.0, 8.0, SIZE, [note])]
    assert overlaps([*spots, note]) == 0
    assert all(spot.inside(SIZE) for spot in spots)
    without_placement = [Rectangle(x + 8.0, y - 22.0, x + 53.0, y - 8.0) for x, y in points]
    assert overlaps(without_placement) > 3  # without placement the labels overlap


def test_a_label_at_the_border_moves_inwards():
    ((spot, _),) = placed([np.array([395.0, 5.0])], [60.0], 14.0, 6.0, SIZE)
    assert spot.inside(SIZE)


def test_coincident_points_share_one_label():
    named = shared({"A": np.array([10.0, 10.0]), "B": np.array([50.0, 50.0]), "crank": np.array([10.4, 9.8])})
    assert [name for name, _ in named] == ["A, crank", "B"]


def pivot(point, before, occupied=()):
    """Return where the label of a pivot stands, next to that of a point."""
    points = [np.array([200.0, 150.0]), np.array(point)]
    return placed(points, [40.0, 10.0], 14.0, 8.0, SIZE, occupied, [before, None])[0]


def test_a_label_keeps_its_side_until_a_nearer_point_or_another_label_occupies_it():
    corner = [300.0, 250.0]
    spot, usual = pivot(corner, None)
    passing = np.array([200.0, 150.0]) + np.array([70.0, 25.0]) * np.array(usual[0])
    assert spot.distance(passing) > spot.distance(np.array([200.0, 150.0]))
    assert pivot(passing, usual)[1] == usual
    nearer = np.array([200.0, 150.0]) + 20.0 * np.array(usual[0])
    assert pivot(nearer, None)[1] != usual
    assert pivot(nearer, usual)[1] != usual
    assert pivot(corner, usual, [spot])[1] != usual


def test_every_label_is_nearest_to_its_own_point():
    for seed in range(20):
        points = [
            np.array(position)
            for position in np.random.default_rng(seed).uniform([100, 80], [300, 220], (6, 2))
        ]
        result = placed(points, [40.0] * 6, 14.0, 8.0, SIZE)
        nearest_is_own = [
            min(points, key=spot.distance) is point for (spot, _), point in zip(result, points, strict=True)
        ]
        assert sum(nearest_is_own) >= 5
