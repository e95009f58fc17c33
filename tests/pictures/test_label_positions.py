import numpy as np

from mechsim.pictures.label_positions import Rectangle, placed, shared

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
