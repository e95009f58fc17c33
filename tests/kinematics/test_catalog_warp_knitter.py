import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import random_knitter

import mechsim as ms

REVOLUTION = 2 * np.pi
# a longer crank 1 cannot turn fully
SWINGING = ms.catalog.make("warp_knitter", crank1=0.022)
# seed of a triad that reaches another assembly mode before a dead centre
LONG_PATH_SEED = 10
seeds = st.integers(0, 10**6)


def test_the_default_assembly_mode_matches_the_paper():
    linkage = ms.catalog.make("warp_knitter")
    motion = linkage.solve([0.0])
    base = motion.links["base"]
    # printed with two and three decimals
    assert base.position[0, :2] == pytest.approx([0.00710, 0.07398], abs=0.6e-5)
    assert np.arctan2(base.rotation[0, 1, 0], base.rotation[0, 0, 0]) == pytest.approx(-1.558, abs=6e-4)


@pytest.mark.parametrize("assembly", [1, 2])
def test_the_motion_is_continuous_and_periodic(assembly):
    linkage = ms.catalog.make("warp_knitter", assembly=assembly)
    angles = np.linspace(0.0, 2 * REVOLUTION, 4001)
    points = linkage.positions(angles)
    rest = linkage.positions(angles - 2 * REVOLUTION)
    for name, position in points.items():
        assert np.abs(position - rest[name]).max() <= 1e-13
        assert np.abs(position[2000:] - position[:2001]).max() <= 1e-13
        # pins move by up to 4e-5 m between poses; the other assembly mode is a hundred times farther
        assert np.linalg.norm(np.diff(position, axis=0), axis=1).max() <= 1.5e-4
    assert (linkage.assembly_sign(points) > 0.3).all()


def test_a_gear_ratio_of_three_to_two_has_a_period_of_two_revolutions():
    linkage = ms.catalog.make("warp_knitter", gear_ratio=-1.5)
    angles = np.linspace(0.0, REVOLUTION, 40)
    first, once, twice = (linkage.positions(angles + n * REVOLUTION) for n in range(3))
    assert max(np.abs(first[name] - twice[name]).max() for name in first) <= 1e-15
    assert max(np.abs(first[name] - once[name]).max() for name in first) > 1e-3


@settings(max_examples=6)
@given(seeds)
def test_assembly_modes_are_numbered_by_increasing_base_angle(seed):
    drives = random_knitter(seed).assemblies(0.0)
    bases = [linkage.solve([0.0]).links["base"].rotation[0] for linkage in drives]
    angles = [float(np.arctan2(base[1, 0], base[0, 0])) % REVOLUTION for base in bases]
    assert [linkage.assembly for linkage in drives] == list(range(1, len(drives) + 1))
    assert angles == sorted(angles)


def test_an_assembly_mode_without_a_path_from_zero_has_no_number():
    linkage = random_knitter(7)
    listed = [linkage.assembly_points(f) for f in np.linspace(0, REVOLUTION, 40)]
    assert any(chosen["assembly"] is None for modes in listed for chosen, _ in modes)


@pytest.mark.parametrize("assembly", [1, 2])
def test_roots_of_the_sextic_coincide_at_the_ends_of_the_crank_range(assembly):
    linkage = SWINGING.with_parameters(assembly=assembly)
    arcs = linkage.crank_range()
    assert not arcs.full
    ((low, high),) = arcs.arcs
    for end, inward in ((low, 1.0), (high, -1.0)):
        # two poses inside, none outside, and the end known to 1e-12
        for direction, count in ((1e-12, 2), (-1e-12, 0)):
            assert len(linkage.assembly_points(end + inward * direction)) == count
    assert linkage.dead_centres() == (low, high)


def test_poses_exist_only_up_to_the_dead_centres():
    ((low, high),) = SWINGING.crank_range().arcs
    offsets = np.logspace(-15, -6, 19)
    angles = np.concatenate([low + offsets, high - offsets])
    # Newton's method stalls at the square root of rounding where the assembly modes meet
    points = SWINGING.positions(angles)
    for first, second, length in (("A", "B", SWINGING.rod3), ("D", "C", SWINGING.rod5)):
        assert np.linalg.norm(points[first] - points[second], axis=1) == pytest.approx(length, rel=1e-11)
    for beyond in (low - 1e-6, high + 1e-6):
        with pytest.raises(ms.AssemblyError, match=r"its range is from 1\.89557 to 7\.17315 rad"):
            SWINGING.positions([beyond])


def test_a_crank_range_above_one_revolution_stays_on_its_branch():
    # this triad reaches another assembly mode before a dead centre
    long = random_knitter(LONG_PATH_SEED)
    assert not long.crank_range().full
    ((low, high),) = long.crank_range().arcs
    assert low < 0.0 < high
    f = low + 0.3 * (high - low - REVOLUTION)
    first, second = long.positions([f]), long.positions([f + REVOLUTION])
    assert max(np.abs(first[name] - second[name]).max() for name in first) > 1e-3
    with pytest.raises(ms.AssemblyError):
        long.positions([low + 0.05, high + 0.1])
    # a single angle is counted on the previous revolution
    alone, before = long.positions([high + 0.1]), long.positions([high + 0.1 - REVOLUTION])
    assert max(np.abs(alone[name] - before[name]).max() for name in alone) <= 1e-15


def test_the_transmission_angle_vanishes_only_at_dead_centres():
    ((low, high),) = SWINGING.crank_range().arcs
    assert SWINGING.transmission_angle([low + 1e-9, high - 1e-9]).max() < 1e-3
    angles = ms.catalog.make("warp_knitter").transmission_angle(np.linspace(0, REVOLUTION, 361))
    assert np.rad2deg(angles.min()) == pytest.approx(47.66, abs=0.01)
    assert angles.max() <= np.pi / 2


def test_the_transmission_angle_follows_from_the_instant_centre():
    linkage = ms.catalog.make("warp_knitter")
    angles = np.linspace(0.2, 6.0, 9)
    points = linkage.positions(angles)
    for i, value in enumerate(linkage.transmission_angle(angles)):
        a, b, c, d, k = (points[name][i, :2] for name in "ABCDK")
        s, _ = np.linalg.solve(np.column_stack([b - a, d - c]), d - a)
        force, arm = a + s * (b - a) - k, k - linkage.pivot_rocker
        cosine = abs(force @ arm) / np.linalg.norm(force) / np.linalg.norm(arm)
        assert value == pytest.approx(np.arccos(cosine), rel=1e-12)
