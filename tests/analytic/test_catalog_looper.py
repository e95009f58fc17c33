import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from mpmath import mp
from strategies import CLOSED, EPS, angles_of, longest, loopers

from mechsim import catalog, loops
from mechsim.analytic.catalog.looper import Looper
from mechsim.analytic.vector_method import trig_polynomial
from mechsim.errors import AssemblyError, InputError
from mechsim.model.joints import End, Joint
from mechsim.model.links import EX, EZ, GROUND, Pose

TABLE = Path(__file__).parents[2] / "validation" / "papers" / "looper_table.py"
# four roots of the quartic are real at this crank angle of the default linkage
FOURFOLD = 4.42


def exact_c(drive: Looper, f: float, near: np.ndarray) -> np.ndarray:
    """C and its two derivatives in 40 digits, (3, 3), by the follower's swing and not the cone angle.

    With y and z from the swing, x follows from AB . AC, and |AC| = k is left to solve, near a known C.
    """
    with mp.workdps(40):
        a, b, k, c, d = (
            mp.mpf(x) for x in (drive.crank, drive.coupler, drive.arm, drive.rocker, drive.frame)
        )
        omega, eta, reach = mp.mpf(drive.arm_angle), mp.mpf(drive.frame_angle), mp.mpf(drive.follower)
        q, p = mp.mpf(drive.axis_y), mp.mpf(drive.axis_z)
        begin = mp.atan2(mp.mpf(near[2]) - p, mp.mpf(near[1]) - q)

        def place(angle):
            ax, ay = a * mp.cos(angle), a * mp.sin(angle)
            ex, ey = ax - d * mp.cos(eta), ay - d * mp.sin(eta)
            span = mp.hypot(ex, ey)
            turn = mp.atan2(ey, ex) - drive.branch * mp.acos((span**2 + c**2 - b**2) / (2 * span * c))
            bx, by = d * mp.cos(eta) + c * mp.cos(turn) - ax, d * mp.sin(eta) + c * mp.sin(turn) - ay

            def c_at(swing):
                y = q + reach * mp.cos(swing) - ay
                return (k * b * mp.cos(omega) - by * y) / bx, y, p + reach * mp.sin(swing)

            swing = mp.findroot(lambda t: mp.fdot(c_at(t), c_at(t)) - k * k, begin)
            x, y, z = c_at(swing)
            return [x + ax, y + ay, z]

        columns = [mp.taylor(lambda t, i=i: place(t)[i], mp.mpf(float(f)), 2) for i in range(3)]
        return np.array([[float(value) for value in column] for column in columns]).T * [[1], [1], [2]]


@settings(max_examples=12)
@given(loopers())
def test_links_keep_their_lengths_and_the_follower_its_axis(drive):
    points = drive.positions(angles_of(drive))
    a, b, c, d, e = (points[name] for name in "ABCDE")
    bound = CLOSED * longest(drive)
    pivot = drive.pivot[:, 0]
    # the direction of a short coupler is known less well, and a long arm shows it where C meets the cylinder
    condition = max(1.0, drive.arm / drive.coupler)
    for vectors, length, factor in (
        (a, drive.crank, 1.0),
        (b - a, drive.coupler, 1.0),
        (b - pivot, drive.rocker, 1.0),
        (c - a, drive.arm, 1.0),
        (c - d, drive.follower, condition),
        (e - d, drive.follower_ratio * drive.follower, condition * max(1.0, drive.follower_ratio)),
    ):
        assert np.abs(np.linalg.norm(vectors, axis=1) - length).max() <= factor * bound
    along = ((b - a) * (c - a)).sum(1) / drive.coupler - drive.arm * np.cos(drive.arm_angle)
    assert np.abs(along).max() <= condition * bound
    assert np.abs(d[:, 1:] - [drive.axis_y, drive.axis_z]).max() == 0.0
    assert np.abs(d[:, 0] - c[:, 0]).max() == 0.0
    assert np.abs(e - d + drive.follower_ratio * (c - d)).max() <= bound * drive.follower_ratio


@settings(max_examples=4)
@given(loopers())
def test_every_assembly_mode_has_its_own_sign(drive):
    angle = float(angles_of(drive, 1)[0])
    result = drive.assemblies(angle)
    signs = {(item.branch, item.side): item for item in result}
    assert len(signs) == len(result)
    for item in result:
        points = item.positions([angle])
        assert item.assembly_sign(points)[0] >= 0.0
        for other in result:
            if (other.branch, np.sign(other.side)) != (item.branch, np.sign(item.side)):
                assert other.assembly_sign(points)[0] <= 0.0


def test_assembly_modes_match_a_scan_of_the_coupler_circle():
    rng = np.random.default_rng(11)
    cone = np.linspace(-np.pi, np.pi, 20001)
    several = 0
    for _ in range(12):
        drive = Looper(
            crank=rng.uniform(4e-3, 14e-3),
            coupler=rng.uniform(15e-3, 35e-3),
            arm=rng.uniform(10e-3, 45e-3),
            arm_angle=rng.uniform(0.1, 3.0),
            frame_angle=rng.uniform(0.0, 6.28),
            follower=rng.uniform(5e-3, 40e-3),
            axis_y=rng.uniform(-0.04, 0.04),
            axis_z=rng.uniform(-0.02, 0.02),
        )
        angle = rng.uniform(-np.pi, np.pi)
        # the circle of C about AB against the cylinder, looked at all around
        observed = []
        o2, a = drive.frame * np.exp(1j * drive.frame_angle), drive.crank * np.exp(1j * angle)
        span = a - o2
        cosine = (abs(span) ** 2 + drive.rocker**2 - drive.coupler**2) / (2.0 * abs(span) * drive.rocker)
        if abs(cosine) < 1.0:
            for sign in (1, -1):
                b = o2 + drive.rocker * span / abs(span) * np.exp(1j * sign * np.arccos(cosine))
                along = (b - a) / drive.coupler * drive.arm
                out = np.sin(drive.arm_angle)
                flat = a + along * (np.cos(drive.arm_angle) + 1j * out * np.cos(cone))
                z = drive.arm * out * np.sin(cone)
                gap = (flat.imag - drive.axis_y) ** 2 + (z - drive.axis_z) ** 2 - drive.follower**2
                at = np.nonzero((gap[1:] > 0.0) != (gap[:-1] > 0.0))[0]
                observed += [(flat[i].real, flat[i].imag, z[i]) for i in at]
        result = [item.positions([angle])["C"][0] for item in drive.assemblies(angle)]
        several = max(several, len(result))
        assert len(result) == len(observed)
        for place in observed:
            # a step of the cone angle moves C by no more than arm * 2 pi / 20000
            assert min(np.linalg.norm(place - c) for c in result) < 2e-5
    assert several >= 4


@pytest.mark.parametrize("drive", [Looper(), Looper(side=-1), Looper(axis_z=0.009, follower_ratio=2.5)])
def test_poses_and_rates_agree_with_the_loop_equations(drive):
    low, high = drive.crank_range().arcs[0]
    angles = np.linspace(low + 0.05, high - 0.05, 17)
    speed, pull = 10.0, 3.0
    ours, theirs = drive.solve(angles, speed, pull), loops.solve(drive.mechanism, angles, speed, pull)
    # rates lose the inverse of the sine of the transmission angle, once for each differentiation
    sine = np.sin(drive.transmission_angle(angles).min())
    for name, point in ours.points.items():
        other, size = theirs.points[name], longest(drive)
        assert np.abs(point.position - other.position).max() <= 1e-13 * size / sine
        assert np.abs(point.velocity - other.velocity).max() <= 1e-12 * size * speed / sine**2
        assert np.abs(point.acceleration - other.acceleration).max() <= 1e-11 * size * speed**2 / sine**4
    for name, link in ours.links.items():
        other = theirs.links[name]
        assert np.abs(link.rotation - other.rotation).max() <= 1e-12 / sine
        assert np.abs(link.angular_velocity - other.angular_velocity).max() <= 1e-11 * speed / sine**2
        gap = np.abs(link.angular_acceleration - other.angular_acceleration).max()
        assert gap <= 1e-10 * speed**2 / sine**4
    for name, joint in ours.joints.items():
        other = theirs.joints[name]
        assert np.abs(np.sin(0.5 * (joint.value - other.value))).max() <= 1e-13
        assert np.abs(joint.rate - other.rate).max() <= 1e-12 * speed
        assert np.abs(joint.acceleration - other.acceleration).max() <= 1e-11 * speed**2


def test_residuals_are_eight_ulp_at_most_with_one_degree_of_freedom():
    drive, angles = Looper(), np.linspace(0.0, 2.0 * np.pi, 181)
    poses = {name: Pose(link.position, link.rotation) for name, link in drive.solve(angles).links.items()}
    lengths_open, angles_open = loops.residual_norms(drive.mechanism, poses, angles)
    assert lengths_open.max() <= 8 * EPS * longest(drive)
    assert angles_open.max() <= 8 * EPS
    freedom = loops.dof_count(drive.mechanism, poses)
    assert (freedom.mobility, freedom.passive, freedom.redundant) == (1, 0, 0)


@pytest.mark.parametrize("drive", [Looper(), Looper(side=-1)])
def test_c_agrees_with_forty_digits(drive):
    angles = np.array([0.3, 1.9, 2.7, 4.1])
    point = drive.solve(angles).points["C"]
    for i, angle in enumerate(angles):
        place, velocity, acceleration = exact_c(drive, angle, point.position[i])
        assert np.abs(point.position[i] - place).max() <= 40 * EPS * longest(drive)
        assert np.abs(point.velocity[i] - velocity).max() <= 1e3 * EPS * longest(drive)
        assert np.abs(point.acceleration[i] - acceleration).max() <= 1e5 * EPS * longest(drive)


def test_the_other_assembly_mode_has_a_crank_range_above_one_revolution():
    assert Looper().crank_range().full
    other = Looper(side=-1)
    ((low, high),) = other.crank_range().arcs
    assert high - low > 2.0 * np.pi
    assert np.rad2deg(other.transmission_angle([low + 1e-6, high - 1e-6])).max() < 0.5
    # where its two ends overlap lies the further root, and nowhere else
    ((begin, end),) = Looper(side=-2).crank_range().arcs
    assert (begin, end) == pytest.approx((low, high - 2.0 * np.pi))
    with pytest.raises(AssemblyError, match="its range is"):
        Looper(side=-2).positions([end + 0.01])
    # a turn apart the same crank angle has two poses: which one is meant is said by counting turns
    first, second = other.positions([FOURFOLD])["C"], other.positions([FOURFOLD - 2.0 * np.pi])["C"]
    assert np.linalg.norm(first - second) > 1e-3
    assert {(item.branch, item.side) for item in other.assemblies(FOURFOLD)} == {
        (1, 1),
        (1, 2),
        (1, -1),
        (1, -2),
    }


def test_positions_are_a_continuous_function_of_the_crank_angle():
    angles = np.linspace(0.0, 4.0 * np.pi, 4001)
    drive = Looper()
    c = drive.positions(angles)["C"]
    assert np.linalg.norm(np.diff(c, axis=0), axis=1).max() < 4e-5  # 3.1 mrad at 0.0083 m/rad
    order = np.random.default_rng(2).permutation(len(angles))
    assert np.array_equal(drive.positions(angles[order])["C"], c[order])


def test_the_default_assembly_mode_matches_the_paper():
    c = Looper().planar_point(np.linspace(0.0, 2.0 * np.pi, 2001))
    assert np.round(1e3 * c.min(0), 2).tolist() == [9.50, 23.68, 0.0]
    assert np.round(1e3 * c.max(0), 2).tolist() == [12.98, 37.29, 0.0]
    other = Looper(branch=-1).planar_point(np.linspace(0.0, 2.0 * np.pi, 101))
    assert other[:, 1].max() < 0.0


def test_the_misprinted_cylinder_axis_is_rejected():
    drive, angles = Looper(), np.linspace(0.0, 2.0 * np.pi, 5)
    sound = drive.mechanism
    line = End(GROUND, (0.0, drive.axis_y, drive.axis_z), axis=EZ, reference=EX)
    slide = Joint("slide", "cylindrical", line, End("follower", axis=EZ, reference=EX))
    misprinted = replace(sound, joints=(*sound.joints[:-1], slide))
    with pytest.raises(AssemblyError, match="do not close"):
        loops.solve(misprinted, angles, 1.0)
    # started from a follower that lies as the misprint wants it, it closes, and is another mechanism
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    guess = {**sound.guess, "follower": Pose(np.array([0.0, drive.axis_y, 0.0]), quarter)}
    c = loops.solve(misprinted.with_guess(guess, 0.0), angles, 1.0).points["C"].position
    assert np.linalg.norm(c - drive.positions(angles)["C"], axis=1).min() > 5e-3


def test_a_link_too_long_by_a_thousandth_is_detected():
    angles = np.linspace(0.0, 2.0 * np.pi, 91)
    right = Looper().positions(angles)["E"]
    for name in ("crank", "coupler", "arm", "rocker", "frame", "follower"):
        wrong = replace(Looper(), **{name: 1.001 * getattr(Looper(), name)}).positions(angles)["E"]
        assert np.linalg.norm(wrong - right, axis=1).max() > 5e-6


@pytest.mark.parametrize("angle", [0.0, np.pi, -np.pi])
def test_a_point_c_on_the_line_ab_is_rejected(angle):
    with pytest.raises(InputError, match="no multiple of pi"):
        Looper(arm_angle=angle)


def test_a_cylinder_out_of_reach_cannot_close():
    drive = catalog.make("looper", axis_y=0.3)
    assert drive.assemblies(0.3) == []
    with pytest.raises(AssemblyError, match="cannot close at any crank angle"):
        drive.positions([0.3])


def test_a_vanishing_leading_coefficient_loses_no_root():
    # there the quartic in the half angle loses its highest power
    for opposite in (0.0, 1e-17, 1e-9):
        polynomial = np.array([[1.0 + opposite], [1.0], [0.3], [0.0], [0.0]])
        roots = np.sort(trig_polynomial.real_roots(polynomial)[:, 0])
        here = roots[~np.isnan(roots)]
        assert len(here) == 2
        assert np.abs(trig_polynomial.polynomial_value(polynomial, here[:, None])).max() <= 1e-14


@pytest.fixture(scope="module")
def table():
    spec = importlib.util.spec_from_file_location("looper_table", TABLE)
    module = importlib.util.module_from_spec(spec)
    sys.modules["looper_table"] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_every_number_of_the_paper_is_reproduced(table):
    rows = table.table()
    assert len(rows) == 11
    assert [row.quantity for row in rows if not row.passed] == []


def test_the_table_of_the_paper_rejects_another_axis_height(table):
    missed = {row.quantity for row in table.table(Looper(axis_z=0.0115)) if not row.passed}
    assert {"C: plane against space", "E: half the band over 33 mm"} <= missed


def test_figures_of_the_paper_are_reproduced(table):
    drive = Looper()
    assert np.ptp(table.figure_3(drive)["y"]) == pytest.approx(40.85, abs=0.005)
    five, six, seven = table.figure_5(drive), table.figure_6(drive), table.figure_7(drive)
    for name in "xy":
        assert np.abs(six[name] - five[name] - seven[name]).max() <= 1e-13
    assert np.abs(five["z"]).max() < 1.31
    four = table.figure_4(drive)
    assert np.abs(four["space x"] - five["x"]).max() == 0.0
