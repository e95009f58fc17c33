import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.vector_method import trig_quartic
from mechsim.mechanism.links import EX, EZ, GROUND

TABLE = Path(__file__).parents[2] / "validation" / "papers" / "looper_table.py"
# four roots of the quartic are real at this crank angle of the default linkage
FOURFOLD = 4.42


@pytest.mark.long
def test_assembly_modes_match_a_scan_of_the_coupler_circle():
    rng = np.random.default_rng(11)
    cone = np.linspace(-np.pi, np.pi, 20001)
    several = 0
    for _ in range(12):
        linkage = ms.catalog.make(
            "looper",
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
        # intersections of the circle of C about AB with the cylinder, by a scan
        observed = []
        o2, a = linkage.frame * np.exp(1j * linkage.frame_angle), linkage.crank * np.exp(1j * angle)
        span = a - o2
        cosine = (abs(span) ** 2 + linkage.rocker**2 - linkage.coupler**2) / (
            2.0 * abs(span) * linkage.rocker
        )
        if abs(cosine) < 1.0:
            for sign in (1, -1):
                b = o2 + linkage.rocker * span / abs(span) * np.exp(1j * sign * np.arccos(cosine))
                along = (b - a) / linkage.coupler * linkage.arm
                out = np.sin(linkage.arm_angle)
                flat = a + along * (np.cos(linkage.arm_angle) + 1j * out * np.cos(cone))
                z = linkage.arm * out * np.sin(cone)
                difference = (
                    (flat.imag - linkage.axis_y) ** 2 + (z - linkage.axis_z) ** 2 - linkage.follower**2
                )
                crossings = np.nonzero((difference[1:] > 0.0) != (difference[:-1] > 0.0))[0]
                observed += [(flat[i].real, flat[i].imag, z[i]) for i in crossings]
        result = [item.positions([angle])["C"][0] for item in linkage.assemblies(angle)]
        several = max(several, len(result))
        assert len(result) == len(observed)
        for position in observed:
            # a step of the cone angle moves C by no more than arm * 2 pi / 20000
            assert min(np.linalg.norm(position - c) for c in result) < 2e-5
    assert several >= 4


def test_the_other_assembly_mode_has_a_crank_range_above_one_revolution():
    assert ms.catalog.make("looper").crank_range().full
    other = ms.catalog.make("looper", side=-1)
    ((low, high),) = other.crank_range().arcs
    assert high - low > 2.0 * np.pi
    assert np.rad2deg(other.transmission_angle([low + 1e-6, high - 1e-6])).max() < 0.5
    # the further root exists only where both ends overlap
    ((start, end),) = ms.catalog.make("looper", side=-2).crank_range().arcs
    assert (start, end) == pytest.approx((low, high - 2.0 * np.pi))
    with pytest.raises(ms.AssemblyError, match="its range is"):
        ms.catalog.make("looper", side=-2).positions([end + 0.01])
    # one crank angle has two poses, which the count of revolutions distinguishes
    first, second = other.positions([FOURFOLD])["C"], other.positions([FOURFOLD - 2.0 * np.pi])["C"]
    assert np.linalg.norm(first - second) > 1e-3
    assert {(item.branch, item.side) for item in other.assemblies(FOURFOLD)} == {
        (1, 1),
        (1, 2),
        (1, -1),
        (1, -2),
    }


def test_the_default_assembly_mode_matches_the_paper():
    c = ms.catalog.make("looper").closed_form.planar_point(np.linspace(0.0, 2.0 * np.pi, 2001))
    assert np.round(1e3 * c.min(0), 2).tolist() == [9.50, 23.68, 0.0]
    assert np.round(1e3 * c.max(0), 2).tolist() == [12.98, 37.29, 0.0]
    other = ms.catalog.make("looper", branch=-1).closed_form.planar_point(np.linspace(0.0, 2.0 * np.pi, 101))
    assert other[:, 1].max() < 0.0


def test_the_misprinted_cylinder_axis_is_rejected():
    linkage, angles = ms.catalog.make("looper"), np.linspace(0.0, 2.0 * np.pi, 5)
    sound = linkage.mechanism
    line = ms.End(GROUND, (0.0, linkage.axis_y, linkage.axis_z), axis=EZ, reference=EX)
    slide = ms.Joint("slide", "cylindrical", line, ms.End("follower", axis=EZ, reference=EX))
    misprinted = replace(sound, joints=(*sound.joints[:-1], slide))
    with pytest.raises(ms.AssemblyError, match="do not close"):
        ms.loops.solve(misprinted, angles, 1.0)
    # with a guess for the misprinted axis it assembles as another mechanism
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    guess = {**sound.guess, "follower": ms.Pose(np.array([0.0, linkage.axis_y, 0.0]), quarter)}
    c = ms.loops.solve(misprinted.with_guess(guess, 0.0), angles, 1.0).points["C"].position
    assert np.linalg.norm(c - linkage.positions(angles)["C"], axis=1).min() > 5e-3


def test_a_vanishing_leading_coefficient_loses_no_root():
    # the leading coefficient of the quartic in the half angle vanishes
    for opposite in (0.0, 1e-17, 1e-9):
        polynomial = np.array([[1.0 + opposite], [1.0], [0.3], [0.0], [0.0]])
        roots = np.sort(trig_quartic.real_roots(polynomial)[:, 0])
        real = roots[~np.isnan(roots)]
        assert len(real) == 2
        assert np.abs(trig_quartic.polynomial_value(polynomial, real[:, None])).max() <= 1e-14


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
    failed = {row.quantity for row in table.table(ms.catalog.make("looper", axis_z=0.0115)) if not row.passed}
    assert {"C: plane against space", "E: half the band over 33 mm"} <= failed


def test_figures_of_the_paper_are_reproduced(table):
    linkage = ms.catalog.make("looper")
    assert np.ptp(table.figure_3(linkage)["y"]) == pytest.approx(40.85, abs=0.005)
    assert np.abs(linkage.positions(np.linspace(0.0, 2.0 * np.pi, 721))["C"][:, 2]).max() < 1.31e-3
