import numpy as np
import pytest

import mechsim as ms

REVOLUTION = 2.0 * np.pi


def test_a_table_over_one_revolution_is_periodic():
    angles, values = np.linspace(0.5, 0.5 + REVOLUTION, 9), [0.0, 1.0, 4.0, 2.0, -1.0, -3.0, -2.0, 0.5, 0.0]
    for smooth in (False, True):
        load = ms.load_profile.table(angles, values, smooth=smooth)
        for turns in (-3, 0, 7):
            assert np.allclose(load.evaluate(angles + turns * REVOLUTION), values, atol=1e-13)
    straight = ms.load_profile.table(angles, values)
    assert straight.evaluate((angles[2] + angles[3]) / 2.0)[0] == pytest.approx(3.0)


def test_a_smooth_table_has_fourth_order():
    def error(rows):
        angles = np.linspace(0.0, REVOLUTION, rows + 1)
        values = np.sin(angles) + 0.3 * np.cos(3.0 * angles)
        values[-1] = values[0]
        x = np.linspace(0.0, REVOLUTION, 997)
        return np.abs(
            ms.load_profile.table(angles, values, smooth=True).evaluate(x) - np.sin(x) - 0.3 * np.cos(3.0 * x)
        ).max()

    assert 3.8 < np.log2(error(48) / error(96)) < 4.2


def test_a_period_rounded_to_six_digits_is_scaled_to_a_revolution():
    x = np.linspace(0.0, REVOLUTION, 9)
    exact, written = (ms.load_profile.table(angles, np.cos(x).round(12)) for angles in (x, x.round(5)))
    samples = np.linspace(0.0, REVOLUTION, 40)
    # half a unit of the sixth digit, at a derivative of one
    assert np.abs(exact.evaluate(samples, samples) - written.evaluate(samples, samples)).max() < 1e-5


def test_a_table_over_two_revolutions_repeats_after_them():
    x = np.linspace(0.0, 2.0 * REVOLUTION, 17)
    load = ms.load_profile.table(x.round(6), np.sin(x / 2.0))
    # the work of a four-stroke engine has the period of two revolutions
    assert np.abs(load.evaluate(x + 2.0 * REVOLUTION, x) - np.sin(x / 2.0)).max() < 1e-6
    assert np.abs(load.evaluate(x[:9] + REVOLUTION, x[:9]) + np.sin(x[:9] / 2.0)).max() < 1e-6


def test_a_table_that_is_not_periodic_is_not_extrapolated():
    for over, remedy in (("angle", "longer, or let it span whole revolutions, 6.28"), ("time", "longer$")):
        load = ms.load_profile.table([0.0, 1.0], [2.0, 3.0], over=over, periodic=False)
        assert load.evaluate([0.5], [0.5])[0] == 2.5
        with pytest.raises(
            ms.InputError, match=rf"covers .* 0 to 1, but the motion needs 1.5; make the table {remedy}"
        ):
            load.evaluate([1.5], [1.5])
