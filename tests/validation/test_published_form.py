"""The validation case of the published unit vector: it must go on showing what is wrong with it."""

import numpy as np
import published_form as case


def test_published_form_loses_two_digits_for_each_digit_of_nearness_and_the_sound_form_none():
    distances = np.array([1e-9, 1e-6, 1e-3, 1e-1])
    published, sound = case.errors_near_zero(distances)
    # a hundredth of rounding over the distance squared, within a factor of a hundred either way
    assert (published[:3] > 1e-20 / distances[:3] ** 2).all()
    assert (published[:3] < 1e-16 / distances[:3] ** 2).all()
    assert published[3] < 1e-14
    assert sound.max() <= 4e-16


def test_published_form_jumps_to_the_other_assembly_twice_a_turn():
    angles = np.linspace(0.0, 2 * np.pi, 720, endpoint=False) + 1e-3
    published, sound = case.assemblies_over_a_turn(angles)
    assert case.jumps(published) == 2
    assert (sound == 1).all()
    # the jumps are where V3x = P4P2_y changes sign
    v3x = case.LOOPER.crank * np.cos(angles) - case.LOOPER.pivot[1]
    assert (published == np.sign(v3x)).all()


def test_forms_agree_where_the_published_one_is_well_conditioned():
    angles = np.linspace(-1.0, 1.0, 9)
    v1, axis, angle = case.question(case.LOOPER, angles)
    sound = case.unit_at_angles(v1, axis, angle, np.pi / 2, 1)
    assert np.abs(case.unit_at_angles_published(v1, axis, angle, np.pi / 2, 1) - sound).max() <= 2e-15
