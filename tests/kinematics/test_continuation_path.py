"""Continuation of the loop equations: segments, step control, change points and dead centres."""

from pathlib import Path

import mpmath
import numpy as np
import pytest
from change_point_linkages import named, smooth_b, worst
from mechanisms import three_cranks
from motions import largest_difference, started_at

import mechsim as ms
from mechsim import loops
from mechsim.kinematics.loops.motion import driven_path
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics import continuation
from mechsim.numerics.loop_solver import LoopSolver, loop_solver
from mechsim.numerics.path_segments import CONTROL

GALLERY = Path(__file__).parents[2] / "models" / "gallery"
NAMES = ("ground", "crank", "coupler", "rocker")
ANGLES = np.unique([*np.linspace(-4 * np.pi, 4 * np.pi, 49), 1e-6, -3e-5, np.pi + 1e-4, 1e-3])


def segments_tried(path, stops):
    """Trace a path to successive parameters; return the numbers of tried and accepted segments."""
    tried, close = [], path.closed
    path.closed = lambda *arguments: tried.append(arguments) or close(*arguments)
    for stop in stops:
        path.extend(stop)
    return len(tried), sum(map(len, path.segments.values()))


@pytest.mark.parametrize(("name", "most"), [("four_bar", 25), ("rssr", 39), ("slider_crank", 22)])
def test_a_smooth_path_needs_few_segments_and_none_is_rejected(name, most):
    path = driven_path(ms.catalog.make(name).mechanism)
    tried, accepted = segments_tried(path, (1.0, 4.0, 2 * np.pi, -1.0, -2 * np.pi))
    # measured 24, 37 and 21: the smoothness of a segment limits the length of the next
    assert tried == accepted <= most
    # a tangent predicts the first segment, which predicts a longer one in the other direction
    first, other = (np.ptp(path.segments[direction][0].nodes) for direction in (1, -1))
    assert 2.0 * first < other


def test_a_path_is_traced_backwards_only_near_a_change_point():
    path = driven_path(ms.catalog.make("four_bar").mechanism)
    path.extend(path.initial)
    assert not path.segments[-1]
    ((solver, which, rows),) = path.chunks(np.array([path.initial, path.initial]))
    assert solver is path.first
    assert which.tolist() == [0, 1]
    assert np.array_equal(rows, path.loops.flat(path.start).repeat(2, 0))
    close = driven_path(three_cranks((0.04, 0.0), start=0.02))
    close.extend(close.initial)
    assert close.change_points == pytest.approx([0.0], abs=1e-9)


def test_the_tangent_predictor_has_second_order():
    mechanism = ms.catalog.make("rssr").mechanism
    path = driven_path(mechanism)
    start = path.initial
    solver = loop_solver(path.loops, path.start)
    for direction in (1, -1):
        s = start + direction * np.array([1e-3, 2e-3])
        reported = path.predicted(start, direction, solver, s)
        errors = np.abs(reported - path.closed(solver, s, reported).states).max(1)
        assert 3.9 < errors[1] / errors[0] < 4.1
        # of the same order as the step squared
        assert 0.05 < errors[0] / 1e-6 < 5.0
    # the other direction is predicted by all nodes of that segment
    path.reach(start + 0.1, 1)
    behind = start - np.array([1e-3, 2e-3])
    reported = path.predicted(start, -1, solver, behind)
    assert np.abs(reported - path.closed(solver, behind, reported).states).max() < 1e-9


@pytest.mark.parametrize(("ratio", "accepted"), [(0.19, False), (0.21, True)])
def test_a_segment_that_loses_most_of_its_rank_margin_is_halved(ratio, accepted, monkeypatch):
    path = driven_path(ms.catalog.make("four_bar").mechanism)
    monkeypatch.setattr(LoopSolver, "share", lambda *_: np.linspace(3.0 * ratio, 3.0, CONTROL.nodes))
    segment, length = path.next_segment(path.initial, 1, 0.05)
    assert (segment is not None) == accepted
    assert (length == 0.025) == (not accepted)


def test_a_parallelogram_keeps_its_assembly_mode_over_revolutions():
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.045, coupler=0.1, rocker=0.045, branch=1)
    mechanism = linkage.mechanism
    path = driven_path(mechanism)
    path.extend(7.0)
    path.extend(-7.0)
    result = np.sort(path.change_points)
    np.testing.assert_allclose(result, np.pi * np.round(result / np.pi), atol=1e-9)
    assert {0, 1, 2} <= set(np.round(result / np.pi).astype(int))
    # the path continues from its end
    path.extend(9.0)
    for segments in path.segments.values():
        assert [segment.nodes[-1] for segment in segments[:-1]] == [
            segment.nodes[0] for segment in segments[1:]
        ]
    motion = loops.solve(mechanism, ANGLES)
    np.testing.assert_allclose(motion.links["coupler"].angular_velocity, 0.0, atol=1e-9)


# almost equal crank and frame, so that the coupler rotates fast; and linkages whose path once ended a segment
# just before the change point
HIGH_CURVATURE = {
    "kite": (0.034801572306382825, 0.03809267197104313, 0.034801572306382825, 0.03809267197104313),
    "crank 1 % shorter": (0.1, 0.099, 0.1, 0.099),
    "crank 1 % longer": (0.1, 0.101, 0.1, 0.101),
    "one change point": (0.1, 0.098, 0.15, 0.152),
}


@pytest.mark.long
@pytest.mark.parametrize("which", HIGH_CURVATURE)
def test_a_path_of_high_curvature_is_resolved(which):
    lengths = HIGH_CURVATURE[which]
    mechanism = ms.catalog.make("four_bar", **named(lengths)).mechanism
    angles = np.unique([*np.linspace(-4.0, 4.0, 33), *np.linspace(-0.02, 0.02, 21), 1e-6, -1e-9])
    result = loops.solve(mechanism, angles).points["B"].position
    with mpmath.workdps(40):
        truths = {sign: [smooth_b(lengths, mpmath.mpf(angle), sign) for angle in angles] for sign in (1, -1)}
    # measured 4e-12
    assert min(worst(truth, result) for truth in truths.values()) <= 1e-10 * mechanism.characteristic_length


@pytest.mark.long
@pytest.mark.parametrize("start", np.linspace(-2.0, -0.4, 9))
def test_change_points_are_detected_from_any_start(start):
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.1, rocker=0.06, branch=-1)
    path = driven_path(started_at(linkage.mechanism, loops.solve(linkage.mechanism, [start])))
    path.extend(7.0)
    path.extend(-7.0)
    result = np.sort(path.change_points) / np.pi
    np.testing.assert_allclose(result, np.round(result), atol=1e-12)
    assert np.unique(np.round(result)).size == result.size >= 5
    # each is the middle of the segment that contains it
    segments = [segment for side in path.segments.values() for segment in side]
    ends = np.sort(np.concatenate([segment.nodes[[0, -1]] for segment in segments]))
    for branch_point in path.change_points:
        after = np.searchsorted(ends, branch_point)
        # the segment is placed about an estimate from one side of the change point, a double root, so that
        # rounding leaves about the square root of 2e-16; measured 1.7e-9 to 1.5e-8 under three kernels
        assert 2.0 * branch_point == pytest.approx(ends[after - 1] + ends[after], abs=3e-8)


@pytest.mark.parametrize("off", [3e-3, -2e-5])
def test_a_path_can_start_close_to_a_change_point(off):
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.1, rocker=0.06)
    close = started_at(linkage.mechanism, loops.solve(linkage.mechanism, [off]))
    result = loops.solve(close, ANGLES).points["B"].position
    assert np.abs(result - linkage.positions(ANGLES)["B"]).max() <= 1e-12 * close.characteristic_length


def test_one_newton_step_from_the_polynomials_of_a_path_leaves_rounding():
    path = driven_path(ms.load("jansen").mechanism)
    path.extend(path.initial + 6.0)
    between = path.interpolated(path.initial + np.linspace(0.0, 6.0, 2001))
    # the residual, in characteristic lengths, whose square is near rounding; measured 2.4e-8
    assert np.abs(path.loops.linearise(between)[0]).max() < 1e-7


@pytest.mark.parametrize(
    ("off", "output"),
    [*((angle, "since its start, .* start elsewhere") for angle in (0.0, np.pi)), (1e-7, "start elsewhere")],
)
def test_a_start_at_a_change_point_is_rejected(off, output):
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.1, rocker=0.06)
    with pytest.raises(ms.AssemblyError, match=f"rad.*{output}"):
        loops.solve(started_at(linkage.mechanism, linkage.solve([off])), [-1.0, 1.0])


def test_a_path_beyond_a_dead_centre_is_rejected_with_a_remedy():
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.055)
    ((_, high),) = linkage.crank_range().arcs
    path = driven_path(started_at(linkage.mechanism, linkage.solve([high - 5e-4])))
    with pytest.raises(ms.AssemblyError, match=r"cannot pass .*; stay on this side of the dead centre"):
        path.extend(high + 0.5)
    # one segment leads to the dead centre
    assert path.segments[1][-1].final


def test_three_dyads_at_once_in_line_are_a_dead_centre():
    ((low, high),) = KinematicSolver(ms.load("peaucellier_lipkin").mechanism).crank_range().arcs
    # the joint of the crank is at the difference of the sides, 50 mm, from the pivot
    assert [-low, high] == pytest.approx([2.0 * np.arccos(5.0 / 6.0)] * 2, abs=3e-13)


@pytest.mark.long
@pytest.mark.parametrize("excess", [1e-3, 1e-6, 1e-9, 1e-12])
def test_the_assembly_mode_is_kept_close_to_a_change_point(excess):
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.06 + excess)
    assert linkage.crank_range().full
    angles = np.linspace(-np.pi, 3 * np.pi, 64)
    result, exact = loops.solve(linkage.mechanism, angles), linkage.solve(angles)
    off = largest_difference(result, exact, kind="links")
    assert off <= 1e-9 * linkage.mechanism.characteristic_length


@pytest.mark.long
@pytest.mark.parametrize("deficit", [5e-3, 1e-4, 1e-6, 1e-9])
def test_a_path_ends_at_a_dead_centre_close_to_a_change_point(deficit):
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.06 - deficit)
    path = driven_path(linkage.mechanism)
    with pytest.raises(ms.AssemblyError, match="stay on this side"):
        path.extend(7.0)
    with mpmath.workdps(30):
        # coupler and rocker in line, by the law of cosines
        ground, crank, coupler, rocker = (mpmath.mpf(getattr(linkage, name)) for name in NAMES)
        cosine = (ground**2 + crank**2 - (coupler - rocker) ** 2) / (2 * ground * crank)
        end = 2 * mpmath.pi - mpmath.acos(cosine)
        # a rounding of a length moves the last end by 1e-12
        assert abs(float(end - path.end(1))) < 1e-12 + 1e-20 / deficit
    angles = path.end(1) - np.geomspace(1e-9, 0.5, 20)
    result = loops.solve(linkage.mechanism, angles).points["B"].position
    # accurate to rounding over the square root of the distance
    assert np.abs(result - linkage.positions(angles)["B"]).max() < 1e-10


@pytest.mark.long
@pytest.mark.parametrize("start", [0.5, 1e-3, -2.0])
def test_change_points_of_an_overconstrained_linkage_are_reported(start):
    """Sarrus' linkage of plates of one length, whose two chains carry a platform at 2 L sin(angle)."""
    whole = ms.load("sarrus", dict.fromkeys(("lower", "upper", "second"), 0.05)).mechanism
    mechanism = started_at(whole, loops.solve(whole, [start]))
    angles = np.linspace(-3.0, 3.0, 24)
    height = loops.solve(mechanism, angles).points["top"].position[:, 2]
    np.testing.assert_allclose(height, 0.1 * np.sin(angles), atol=1e-12)
    solver = KinematicSolver(mechanism)
    # folded at 0 and pi, the second chain can rotate about its own axes at a constant crank angle
    assert np.sort(np.sin(solver.change_points())) == pytest.approx([-1.0, 0.0, 0.0, 1.0], abs=1e-9)
    assert solver.period == 2.0 * np.pi
    flat = loops.solve(mechanism, [0.0, np.pi])
    np.testing.assert_allclose(flat.points["top"].velocity[:, 2], [0.1, -0.1], atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("offset", [0.013, 0.06, -0.0002])
def test_a_third_crank_off_the_line_of_pivots_removes_change_points(offset):
    mechanism = three_cranks((0.047, offset))
    angles = np.concatenate([[np.pi, 2.0 * np.pi], np.linspace(-4.0, 7.0, 50)])
    motion = loops.solve(mechanism, angles)
    np.testing.assert_allclose(motion.links["coupler"].angular_velocity, 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.links["third"].angular_velocity[:, 2], 1.0, atol=1e-9)
    assert KinematicSolver(mechanism).change_points() == ()


def test_a_third_crank_on_the_line_of_pivots_keeps_change_points():
    result = np.sort(np.abs(KinematicSolver(three_cranks((0.047, 0.0))).change_points()))
    assert result == pytest.approx([0.0, np.pi], abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("height", [1e-3, 2e-3, 0.03])
def test_a_pulse_of_the_driver_between_the_nodes_of_a_segment_is_followed(height):
    """The slider of the catalogue at the top of the pulse follows from its two right triangles."""
    law = f"0.5 + {height}*exp(-((t - 0.5)/1e-5)**2)"
    solver = ms.load("slider_crank", drive={"crank": law}, duration=1.0)
    crank = 0.5 + height * np.exp([-np.inf, -0.25, 0.0])
    expected = 0.05 * np.cos(crank) + np.sqrt(0.2**2 - (0.05 * np.sin(crank) - 0.01) ** 2)
    times = [0.2, 0.5 + 0.5e-5, 0.5]
    assert solver.positions(t=times)["B"][:, 0] == pytest.approx(expected, abs=1e-11)
    # a motion of many cycles would need millions of steps
    assert solver.motion_laws.revolutions < 500.0


@pytest.mark.long
@pytest.mark.parametrize(
    ("law", "height", "travel"),
    [
        ("{0}*exp(-((t - 0.5)/1e-7)**2)", 1.0, 2.0),
        ("{0}*exp(-((t - 0.5)/1e-8)**2) + 0*t", -2.0, 4.0),
        ("{0}*exp(-((t - 0.5)/1e-7)**2) + 40*pi*t*(1 - t)", 1.0, 20.0 * np.pi + 2.0),
    ],
)
def test_the_travel_of_a_driver_is_limited_not_its_largest_rate(law, height, travel):
    """At its largest rate for 1 s, each driver would make above 10^6 revolutions."""
    solver = ms.load("slider_crank", drive={"crank": law.format(height)}, duration=1.0)
    times = np.array([0.2, 0.5, 0.9])
    smooth = 40.0 * np.pi * times * (1.0 - times) if "pi" in law else 0.0
    crank = smooth + height * np.array([0.0, 1.0, 0.0])
    expected = 0.05 * np.cos(crank) + np.sqrt(0.2**2 - (0.05 * np.sin(crank) - 0.01) ** 2)
    assert solver.positions(t=times)["B"][:, 0] == pytest.approx(expected, abs=1e-11)
    assert max(1.0, travel / (2.0 * np.pi)) / 2.0 < solver.motion_laws.revolutions < 1.0 + travel
    run = ms.simulate(solver, motion_laws=solver.motion_laws, method="pose", samples=2)
    assert run.motion.points["B"].position[1, 0] == pytest.approx(expected[1], abs=1e-11)
    with pytest.raises(ms.InputError, match="too short for time steps"):
        ms.simulate(solver, motion_laws=solver.motion_laws, method="step")


@pytest.mark.long
def test_a_path_of_very_short_segments_ends_with_the_reason(tmp_path, monkeypatch):
    # with a lift of 1e9 m on a cam of 38 mm each segment is accepted, and a revolution takes millions of them
    text = (GALLERY / "cam_follower.toml").read_text(encoding="utf-8")
    high = tmp_path / "high.toml"
    high.write_text(text.replace("lift = 12\n", "lift = 1e12\n"), encoding="utf-8")
    monkeypatch.setattr(continuation, "MAX_ATTEMPTS", 300)
    with pytest.raises(ms.InputError, match=r"beyond 0\.0\d+ rad: 300 steps advanced by 0\.0\d+ of the path"):
        ms.load(high).crank_range()
    # the limit is on the advance: the same number of attempts is enough for the lift of the file
    assert ms.load(GALLERY / "cam_follower.toml").crank_range().full
