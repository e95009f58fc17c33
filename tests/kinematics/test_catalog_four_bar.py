import numpy as np
import pytest
from hypothesis import given
from strategies import CLOSED, EPS, angles_of, four_bars, longest

import mechsim as ms


@given(four_bars())
def test_the_coupler_point_lies_on_the_side_of_its_angle(linkage):
    points = linkage.positions(angles_of(linkage))
    along, arm = points["B"] - points["A"], points["C"] - points["A"]
    sine = np.cross(along, arm)[:, 2] / (linkage.coupler * linkage.arm)
    assert np.abs(sine - np.sin(linkage.arm_angle)).max() <= 32 * EPS * longest(linkage) / linkage.coupler


@given(four_bars())
def test_branch_selects_the_side_of_the_rocker(linkage):
    points = linkage.positions(angles_of(linkage))
    line = np.array([linkage.ground, 0.0, 0.0]) - points["A"]
    side = np.cross(line, points["B"] - points["A"])[:, 2]
    assert (np.sign(side) == linkage.branch).all()
    assert (linkage.assembly_sign(points) > 0.0).all()


@given(four_bars())
def test_coupler_and_rocker_are_collinear_at_dead_centres(linkage):
    ends = []
    for reach in (linkage.coupler + linkage.rocker, abs(linkage.coupler - linkage.rocker)):
        cosine = (linkage.ground**2 + linkage.crank**2 - reach**2) / (2 * linkage.ground * linkage.crank)
        if abs(cosine) < 1.0:
            ends += [np.arccos(cosine), -np.arccos(cosine)]
    result = [(f + np.pi) % (2 * np.pi) - np.pi for f in linkage.dead_centres()]
    assert len(result) == len(ends)
    for end in ends:
        # the cosine has an error of a few ulp of the squares, the angle that divided by its sine
        slack = 64 * EPS * (longest(linkage) ** 2 / (linkage.ground * linkage.crank)) / abs(np.sin(end))
        assert min(abs((f - end + np.pi) % (2 * np.pi) - np.pi) for f in result) <= slack


def test_a_grashof_crank_turns_fully():
    assert ms.catalog.make("four_bar").crank_range().full
    assert ms.catalog.make("four_bar").dead_centres() == ()


def test_a_loop_that_cannot_close_reports_the_crank_range():
    linkage = ms.catalog.make("four_bar").with_parameters(crank=0.08)
    (low, high), *_ = linkage.crank_range().arcs
    with pytest.raises(
        ms.AssemblyError, match=r"does not close at crank angle .* its range is from .* to .* rad"
    ):
        linkage.positions([high + 0.1])
    assert np.isfinite(linkage.positions([low + 1e-9, high - 1e-9])["B"]).all()


@pytest.mark.parametrize("branch", [1, -1])
@pytest.mark.parametrize(
    "lengths",
    [(0.1, 0.04, 0.1, 0.04), (0.1, 0.04, 0.04, 0.1), (0.05, 0.05, 0.05, 0.05), (0.05, 0.05, 0.08, 0.08)],
    ids=["parallelogram", "kite", "rhombus", "galloway"],
)
def test_linkages_with_change_points_start_away_from_them(lengths, branch):
    linkage = ms.catalog.make(
        "four_bar", **dict(zip(("ground", "crank", "coupler", "rocker"), lengths, strict=True)), branch=branch
    )
    mechanism = linkage.mechanism
    poses = ms.loops.assemble(mechanism, [mechanism.start])
    tip = poses["rocker"].point((linkage.rocker, 0.0, 0.0))
    assert np.abs(tip - linkage.positions([mechanism.start])["B"]).max() <= CLOSED * longest(linkage)
    locked = ms.loops.equations(mechanism, poses, mechanism.start).jacobian
    # 3 of the 25 equations of a planar loop are redundant
    values = np.linalg.svd(locked[0] * np.tile([0.1] * 3 + [1.0] * 3, 3), compute_uv=False)
    assert values[17] > 1e-3 * values[0]
