from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mpmath import mp
from strategies import CLOSED, EPS, random_knitter
from two_cranks import velocities

from mechsim import catalog, loops
from mechsim.analytic.catalog.warp_knitter import WarpKnitter
from mechsim.analytic.vector_method import triad
from mechsim.errors import AssemblyError, InputError
from mechsim.model.links import Pose

TURN = 2 * np.pi
# a longer crank 1 cannot turn fully
BLOCKED = WarpKnitter(crank1=0.022)
# among random ones, a triad that passes into another assembly before it meets a dead centre
LONG = 10
seeds = st.integers(0, 10**6)


def angles_of(drive: WarpKnitter, count: int = 12) -> np.ndarray:
    low, high = drive.crank_range().arcs[0]
    return low + (high - low) * (np.arange(count) + 0.37) / count


def longest(drive: WarpKnitter) -> float:
    places = [(0.0, 0.0), drive.pivot2, drive.pivot_rocker]
    gaps = [np.hypot(*np.subtract(p, q)) for p in places for q in places]
    base = [np.hypot(*p) for p in (drive.base_c, drive.base_k, np.subtract(drive.base_c, drive.base_k))]
    return float(max(drive.rod3, drive.rod5, drive.rocker, *gaps, *base))


def open_loops(drive: WarpKnitter, points: dict[str, np.ndarray]) -> float:
    """Return by how much the longest or shortest link is wrong, in parts of the longest link."""
    fixed = {"O1": (0, 0), "O2": drive.pivot2, "E": drive.pivot_rocker}
    at = {**points, **{name: np.array([x, y, 0.0]) for name, (x, y) in fixed.items()}}
    lengths = {
        ("O1", "A"): drive.crank1,
        ("O2", "D"): drive.crank2,
        ("A", "B"): drive.rod3,
        ("D", "C"): drive.rod5,
        ("E", "K"): drive.rocker,
        ("B", "C"): np.hypot(*drive.base_c),
        ("B", "K"): np.hypot(*drive.base_k),
        ("C", "K"): np.hypot(*np.subtract(drive.base_c, drive.base_k)),
    }
    gaps = [np.linalg.norm(at[p] - at[q], axis=-1) - length for (p, q), length in lengths.items()]
    return float(max(np.abs(gap).max() for gap in gaps)) / longest(drive)


@settings(max_examples=15)
@given(seeds)
def test_links_keep_their_lengths_over_the_whole_range(seed):
    drive = random_knitter(seed)
    points = drive.positions(angles_of(drive, 40))
    assert open_loops(drive, points) <= CLOSED
    assert (drive.assembly_sign(points) > 0.0).all()


def test_the_default_assembly_mode_matches_the_paper():
    drive = WarpKnitter()
    motion = drive.solve([0.0])
    base = motion.links["base"]
    # printed with two and three decimals
    assert base.position[0, :2] == pytest.approx([0.00710, 0.07398], abs=0.6e-5)
    assert np.arctan2(base.rotation[0, 1, 0], base.rotation[0, 0, 0]) == pytest.approx(-1.558, abs=6e-4)
    swing = np.ptp(drive.solve(np.linspace(0, TURN, 1001)).joints["rocker"].value)
    assert np.rad2deg(swing) == pytest.approx(37.6, abs=0.06)


def test_the_catalogue_uses_the_documented_parameter_names():
    names = """crank1 crank2 rod3 rod5 rocker pivot2 pivot_rocker base_c base_k
    phase gear_ratio assembly"""
    drive = catalog.make("warp_knitter", crank1=0.008)
    assert [parameter.name for parameter in fields(drive)] == names.split()
    assert list(drive.mechanism.points) == list("ABCDK")
    assert drive.mechanism.driver == "crank"


@pytest.mark.parametrize("drive", [WarpKnitter(), WarpKnitter(assembly=1), random_knitter(5, -1.5)])
def test_motion_agrees_with_the_loop_equations_of_the_description(drive):
    arcs = drive.crank_range()
    # closure turns the crank step by step from its start, so the angles rise from there
    angles = np.linspace(0.1, 5.0 if arcs.full else arcs.arcs[0][1] - 0.2, 6)
    here = drive.solve(angles, 3.0, 2.0)
    there = loops.solve(drive.mechanism, angles, 3.0, 2.0)
    for kind in ("points", "links", "joints"):
        for name, motion in getattr(here, kind).items():
            other = getattr(there, kind)[name]
            for part in motion.__dataclass_fields__:
                if part in ("unit", "index"):
                    continue
                gap = getattr(motion, part) - getattr(other, part)
                if part == "value":
                    gap = gap - TURN * np.round(gap / TURN)
                bound = 1e-12 * max(1.0, np.abs(getattr(other, part)).max())
                assert np.abs(gap).max() <= bound, (kind, name, part)


@settings(max_examples=6)
@given(seeds)
def test_the_motion_of_k_agrees_with_fifty_digits(seed):
    drive = random_knitter(seed)
    angles = angles_of(drive, 5)
    angles = angles[np.abs(drive.assembly_sign(drive.positions(angles))) > 0.2][:2]
    assume(len(angles) > 0)
    motion = drive.solve(angles, 3.0, 2.0)
    for i, f in enumerate(angles):
        p, d1, d2 = k_by_fifty_digits(
            drive, f, motion.points["B"].position[i], motion.links["base"].rotation[i]
        )
        expected = p, 3.0 * d1, 9.0 * d2 + 2.0 * d1
        k = motion.points["K"]
        for value, exact in zip((k.position, k.velocity, k.acceleration), expected, strict=True):
            scale = longest(drive) + np.abs(exact).max()
            assert np.abs(value[i, :2] - exact).max() <= 1e-12 * scale


def k_by_fifty_digits(drive, f, b, rotation):
    with mp.workdps(50):
        ratio, phase = mp.mpf(drive.gear_ratio), mp.mpf(drive.phase)
        sides = [mp.mpf(x) for x in drive.sides]
        platform = [mp.mpc(0), mp.mpc(*drive.base_c), mp.mpc(*drive.base_k)]
        start = [float(b[0]), float(b[1]), float(np.arctan2(rotation[1, 0], rotation[0, 0]))]

        def k(angle):
            pins = [
                mp.mpf(drive.crank1) * mp.expj(angle),
                mp.mpc(*drive.pivot2) + mp.mpf(drive.crank2) * mp.expj(ratio * angle + phase),
                mp.mpc(*drive.pivot_rocker),
            ]

            x, y, t = start
            for _ in range(3):  # each step doubles the digits that are right
                ends = [mp.mpc(x, y) + mp.expj(t) * point for point in platform]
                legs = [e - p for e, p in zip(ends, pins, strict=True)]
                swings = [
                    mp.re(v * mp.conj(1j * mp.expj(t) * p)) for v, p in zip(legs, platform, strict=True)
                ]
                rows = mp.matrix([[v.real, v.imag, swing] for v, swing in zip(legs, swings, strict=True)])
                gaps = [(abs(v) ** 2 - r**2) / 2 for v, r in zip(legs, sides, strict=True)]
                x, y, t = (old - new for old, new in zip((x, y, t), mp.lu_solve(rows, gaps), strict=True))
            return mp.mpc(x, y) + mp.expj(t) * platform[2]

        h = mp.mpf(10) ** -12
        before, here, after = k(mp.mpf(f) - h), k(mp.mpf(f)), k(mp.mpf(f) + h)
        first, second = (after - before) / (2 * h), (after - 2 * here + before) / h**2
        return [np.array([float(z.real), float(z.imag)]) for z in (here, first, second)]


@pytest.mark.parametrize("assembly", [1, 2])
def test_the_motion_is_continuous_and_periodic(assembly):
    drive = WarpKnitter(assembly=assembly)
    angles = np.linspace(0.0, 2 * TURN, 4001)
    points = drive.positions(angles)
    rest = drive.positions(angles - 2 * TURN)
    for name, place in points.items():
        assert np.abs(place - rest[name]).max() <= 1e-13
        assert np.abs(place[2000:] - place[:2001]).max() <= 1e-13
        # pins move by up to 4e-5 m from pose to pose; the other assembly is a hundred times as far
        assert np.linalg.norm(np.diff(place, axis=0), axis=1).max() <= 1.5e-4
    assert (drive.assembly_sign(points) > 0.3).all()


def test_every_pose_is_a_root_of_the_sextic():
    drive = WarpKnitter()
    for f in np.linspace(0.0, TURN, 50):
        pivots = [(z.real, z.imag) for z in drive.pivots.positions(f)]
        poses = triad.triad_modes(pivots, [(0, 0), drive.base_c, drive.base_k], drive.sides)
        b = drive.positions([f])["B"][0, :2]
        assert np.nanmin(np.linalg.norm(poses[:, :2] - b, axis=1)) <= 1e-15


def test_the_order_of_angles_does_not_change_the_poses():
    angles = np.linspace(-9.0, 9.0, 101)
    shuffled = np.random.default_rng(1).permutation(101)
    here, there = WarpKnitter().positions(angles), WarpKnitter().positions(angles[shuffled])
    for name in here:
        assert (here[name][shuffled] == there[name]).all()


def test_a_gear_ratio_of_three_to_two_has_a_period_of_two_revolutions():
    drive = WarpKnitter(gear_ratio=-1.5)
    angles = np.linspace(0.0, TURN, 40)
    here, once, twice = (drive.positions(angles + n * TURN) for n in range(3))
    assert max(np.abs(here[name] - twice[name]).max() for name in here) <= 1e-15
    assert max(np.abs(here[name] - once[name]).max() for name in here) > 1e-3


def test_an_irrational_ratio_is_traced_revolution_by_revolution():
    drive = WarpKnitter(gear_ratio=-np.sqrt(2.0))
    assert open_loops(drive, drive.positions(np.linspace(-40.0, 40.0, 60))) <= CLOSED


@settings(max_examples=6)
@given(seeds)
def test_assembly_modes_are_numbered_by_increasing_base_angle(seed):
    drives = random_knitter(seed).assemblies(0.0)
    bases = [drive.solve([0.0]).links["base"].rotation[0] for drive in drives]
    angles = [float(np.arctan2(base[1, 0], base[0, 0])) % TURN for base in bases]
    assert [drive.assembly for drive in drives] == list(range(1, len(drives) + 1))
    assert angles == sorted(angles)


@settings(max_examples=6)
@given(seeds)
def test_every_assembly_mode_at_a_crank_angle_is_listed(seed):
    drive = random_knitter(seed)
    f = 0.8
    listed = [(chosen["assembly"], points) for chosen, points in drive.assembly_points(f)]
    pivots = [(z.real, z.imag) for z in drive.pivots.positions(f)]
    poses = triad.triad_modes(pivots, [(0, 0), drive.base_c, drive.base_k], drive.sides)
    assert len(listed) == np.isfinite(poses[:, 0]).sum()
    numbers = [number for number, _ in listed if number is not None]
    assert sorted(numbers) == [other.assembly for other in drive.assemblies(f)]
    for number, points in listed:
        assert open_loops(drive, {name: place[None] for name, place in points.items()}) <= CLOSED
        if number is not None:
            there = replace(drive, assembly=number).positions([f])
            assert max(np.abs(there[name][0] - points[name]).max() for name in points) <= 1e-12


def test_an_assembly_mode_without_a_path_from_zero_has_no_number():
    drive = random_knitter(7)
    listed = [drive.assembly_points(f) for f in np.linspace(0, TURN, 40)]
    assert any(chosen["assembly"] is None for here in listed for chosen, _ in here)


@pytest.mark.parametrize("assembly", [1, 2])
def test_roots_of_the_sextic_coincide_at_the_ends_of_the_crank_range(assembly):
    drive = replace(BLOCKED, assembly=assembly)
    arcs = drive.crank_range()
    assert not arcs.full
    ((low, high),) = arcs.arcs
    for end, inward in ((low, 1.0), (high, -1.0)):
        # two poses inside, none outside, and the end known to 1e-12
        for direction, count in ((1e-12, 2), (-1e-12, 0)):
            assert len(drive.assembly_points(end + inward * direction)) == count
    assert drive.dead_centres() == (low, high)


def test_poses_exist_only_up_to_the_dead_centres():
    ((low, high),) = BLOCKED.crank_range().arcs
    near = np.logspace(-15, -6, 19)
    angles = np.concatenate([low + near, high - near])
    # Newton's method stalls at the square root of rounding where the assembly modes meet
    assert open_loops(BLOCKED, BLOCKED.positions(angles)) <= 1e-11
    for beyond in (low - 1e-6, high + 1e-6):
        with pytest.raises(AssemblyError, match=r"its range is from 1\.89557 to 7\.17315 rad"):
            BLOCKED.positions([beyond])


def test_crank_angles_one_revolution_apart_give_the_same_pose():
    here, there = BLOCKED.positions([2.5]), BLOCKED.positions([2.5 - TURN])
    assert max(np.abs(here[name] - there[name]).max() for name in here) <= 1e-15


def test_a_crank_range_above_one_revolution_stays_on_its_branch():
    # found among random ones: the triad passes into another assembly before it meets a dead centre
    long = random_knitter(LONG)
    assert not long.crank_range().full
    ((low, high),) = long.crank_range().arcs
    assert low < 0.0 < high
    f = low + 0.3 * (high - low - TURN)
    here, there = long.positions([f]), long.positions([f + TURN])
    assert max(np.abs(here[name] - there[name]).max() for name in here) > 1e-3
    with pytest.raises(AssemblyError):
        long.positions([low + 0.05, high + 0.1])
    # alone it is counted on the revolution before, as on the other methods
    alone, before = long.positions([high + 0.1]), long.positions([high + 0.1 - TURN])
    assert max(np.abs(alone[name] - before[name]).max() for name in alone) <= 1e-15


def test_the_transmission_angle_vanishes_only_at_dead_centres():
    ((low, high),) = BLOCKED.crank_range().arcs
    assert BLOCKED.transmission_angle([low + 1e-9, high - 1e-9]).max() < 1e-3
    open_ = WarpKnitter().transmission_angle(np.linspace(0, TURN, 361))
    assert np.rad2deg(open_.min()) == pytest.approx(47.66, abs=0.01)
    assert open_.max() <= np.pi / 2


def test_the_transmission_angle_follows_from_the_instant_centre():
    drive = WarpKnitter()
    angles = np.linspace(0.2, 6.0, 9)
    points = drive.positions(angles)
    for i, value in enumerate(drive.transmission_angle(angles)):
        a, b, c, d, k = (points[name][i, :2] for name in "ABCDK")
        s, _ = np.linalg.solve(np.column_stack([b - a, d - c]), d - a)
        force, arm = a + s * (b - a) - k, k - drive.pivot_rocker
        cosine = abs(force @ arm) / np.linalg.norm(force) / np.linalg.norm(arm)
        assert value == pytest.approx(np.arccos(cosine), rel=1e-12)


def test_without_gears_the_mechanism_has_two_degrees_of_freedom():
    drive = WarpKnitter()
    links = drive.solve([0.4]).links
    poses = {name: Pose(link.position, link.rotation) for name, link in links.items()}
    assert loops.dof_count(replace(drive.mechanism, gears=()), poses).mobility == 2
    assert loops.dof_count(drive.mechanism, poses).mobility == 1
    assert loops.dof_count(drive.mechanism, poses).redundant == 6


def test_velocities_of_both_cranks_superpose():
    drive = WarpKnitter()
    f = np.linspace(0.0, TURN, 13)
    geared = drive.gear_ratio * f + drive.phase
    exact = drive.solve(f, 3.0)
    item, two = velocities(drive, f, geared, 3.0, 0.0), velocities(drive, f, geared, 0.0, -6.0)
    for name, point in exact.points.items():
        scale = np.abs(point.velocity).max()
        assert np.abs(item[name] + two[name] - point.velocity).max() <= 1e-13 * scale
    assert np.abs(item["D"]).max() == 0.0
    assert np.abs(two["A"]).max() == 0.0


def test_velocities_agree_with_another_gear_ratio_at_the_same_angles():
    # the same two crank angles reached by another gear, whose motion passes through them
    drive, f1, f2 = WarpKnitter(), 0.7, 0.9
    other = replace(drive, gear_ratio=(f2 - drive.phase) / f1)
    exact = other.solve([f1], 3.0)
    result = velocities(drive, f1, f2, 3.0, 3.0 * other.gear_ratio)
    for name, point in exact.points.items():
        assert np.abs(result[name] - point.velocity).max() <= 1e-14


def test_a_second_crank_without_full_rotation_is_rejected():
    # lengthened, crank 2 meets a dead centre of its own
    drive = WarpKnitter(crank2=0.028)
    with pytest.raises(AssemblyError, match="crank 2 cannot turn"):
        velocities(drive, 0.0, np.linspace(0.0, TURN, 12), 1.0, 1.0)


@pytest.mark.parametrize("assembly", [0, 3, -1])
def test_an_invalid_assembly_number_is_rejected(assembly):
    with pytest.raises(InputError, match=rf"assembly is {assembly}, but at crank angle 0 there are 2"):
        WarpKnitter(assembly=assembly)


@pytest.mark.parametrize(
    ("name", "value"),
    [("assembly", 1.5), ("gear_ratio", 0.0), ("gear_ratio", np.nan), ("rod3", -1.0), ("base_c", (1.0,))],
)
def test_invalid_parameters_are_rejected_by_name(name, value):
    with pytest.raises(InputError, match=name):
        WarpKnitter(**{name: value})


def test_dimensions_without_assembly_mode_are_rejected_when_solved():
    drive = WarpKnitter(rod3=0.2)
    assert drive.crank_range().arcs == ()
    assert drive.assembly_points(0.3) == []
    with pytest.raises(AssemblyError, match="does not close"):
        drive.positions([0.0])


def test_a_gear_ratio_wrong_by_a_hundredth_moves_the_points():
    angles = np.linspace(0.0, TURN, 73)
    right, wrong = WarpKnitter().positions(angles), WarpKnitter(gear_ratio=-2.02).positions(angles)
    assert max(np.abs(right[name] - wrong[name]).max() for name in right) > 1e-4


def test_scaling_all_lengths_scales_the_motion():
    drive = WarpKnitter()
    scale = 2.0**5
    lengths = {name: scale * getattr(drive, name) for name in ("crank1", "crank2", "rod3", "rod5", "rocker")}
    places = ("pivot2", "pivot_rocker", "base_c", "base_k")
    vectors = {name: tuple(scale * x for x in getattr(drive, name)) for name in places}
    angles = np.linspace(0.0, 6.0, 11)
    here, there = drive.solve(angles, 3.0, 2.0), replace(drive, **lengths, **vectors).solve(angles, 3.0, 2.0)
    for name, point in here.points.items():
        other = there.points[name]
        for part in ("position", "velocity", "acceleration"):
            gap = scale * getattr(point, part) - getattr(other, part)
            assert np.abs(gap).max() <= 1e-13 * np.abs(getattr(other, part)).max()


def test_the_other_assembly_mode_differs_in_sign_and_position():
    angles = np.linspace(0.0, TURN, 73)
    mine, other = WarpKnitter(), WarpKnitter(assembly=1).positions(angles)
    assert (mine.assembly_sign(other) < 0.0).all()
    assert np.abs(mine.positions(angles)["K"] - other["K"]).max() > 0.01


def test_a_wrong_rod_or_gear_ratio_violates_the_loop_equations():
    drive = WarpKnitter()
    motion = drive.solve(np.linspace(0.0, 6.0, 9))
    poses = {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}
    for wrong in (replace(drive, rod5=drive.rod5 * 1.001), replace(drive, gear_ratio=-2.02)):
        gaps = loops.residual_norms(wrong.mechanism, poses, motion.angle)
        assert max(gap.max() for gap in gaps) > 1e-5
    gaps = loops.residual_norms(drive.mechanism, poses, motion.angle)
    assert gaps[0].max() <= CLOSED * longest(drive)
    assert gaps[1].max() <= 64 * EPS
