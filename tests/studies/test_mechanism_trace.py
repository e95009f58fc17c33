"""Curves of assembly modes agree with the closed forms in both directions."""

from dataclasses import replace

import numpy as np
import pytest
from catalog_faults import COLLINEAR, SWINGING
from grids import grid
from model_files import stated_mechanism

import mechsim as ms
from mechsim import loops
from mechsim.errors import MobilityError
from mechsim.kinematics.continuation import assembly_curve, segments
from mechsim.numerics.newton import root
from mechsim.studies import trace as mechanism_trace

REVOLUTION = 2.0 * np.pi
SOLVERS = {name: ms.catalog.make(name) for name in ms.catalog.MECHANISMS}
SOLVERS |= {
    f"{name} {case}": closed_form.with_parameters(**changes)
    for name, closed_form in tuple(SOLVERS.items())
    for case, changes in {
        "swinging": SWINGING.get(name, {}),
        **(COLLINEAR if name == "four_bar" else {}),
    }.items()
    if changes
}
TRACES = {}
# enough for every curve: a tenth of them reach the rarest
STARTS = 30


def traced(name):
    if name not in TRACES:
        TRACES[name] = ms.trace(SOLVERS[name], starts=STARTS)
    return TRACES[name]


def angular_distances(angles, others):
    """Return the distances of angles from the nearest of others, in [rad], modulo a revolution."""
    differences = np.abs(np.exp(1j * np.asarray(angles))[:, None] - np.exp(1j * np.asarray(others)))
    return differences.min(1)


def gap_to_closed_form(linkage, poses, k):
    listed = linkage.assembly_points(float(poses.angle[k]))
    differences = [
        max(float(np.linalg.norm(position - poses.points[name][k])) for name, position in points.items())
        for _, points in listed
    ]
    return min(differences, default=np.inf) / linkage.mechanism.characteristic_length


@pytest.mark.long
@pytest.mark.parametrize("name", grid(SOLVERS))
def test_every_pose_of_a_curve_agrees_with_the_closed_form(name):
    linkage = SOLVERS[name]
    for curve in traced(name).curves:
        poses = curve.samples(16)
        differences, angles = loops.residual_norms(linkage.mechanism, poses.poses, poses.angle)
        assert differences.max() <= 1e-13 * linkage.mechanism.characteristic_length
        assert angles.max() <= 1e-13
        # closed forms lose half the digits where the crank reverses
        clear = loops.conditioning(linkage.mechanism, poses.poses) > 1e-3
        assert clear.sum() > 12
        assert max(gap_to_closed_form(linkage, poses, k) for k in np.flatnonzero(clear)) <= 1e-10


@pytest.mark.long
@pytest.mark.parametrize("name", grid(SOLVERS))
def test_every_assembly_mode_of_the_closed_form_is_on_a_curve(name):
    linkage, result = SOLVERS[name], traced(name)
    arcs = linkage.crank_range()
    low, high = arcs.arcs[0] if not arcs.full else (-np.pi, np.pi)
    for angle in (low + 0.37 * (high - low), low + 0.81 * (high - low)):
        on_curves = [points for curve in result.curves for points in points_at_angle(curve, angle)]
        for _, points in linkage.assembly_points(angle):
            differences = [
                max(np.linalg.norm(points[name] - position[name]) for name in points)
                for position in on_curves
            ]
            assert min(differences) <= 1e-10 * linkage.mechanism.characteristic_length


def points_at_angle(curve, angle):
    """Yield the tracked points wherever a curve crosses a crank angle."""
    poses = curve.samples(200)
    offset = (poses.angle - angle + np.pi) % REVOLUTION - np.pi
    for k in np.flatnonzero((offset[:-1] * offset[1:] < 0.0) & (np.abs(offset[:-1]) < 1.0)):
        expected = angle + REVOLUTION * round((poses.angle[k] - angle) / REVOLUTION)

        def ahead(arc, expected=expected):
            return float(curve.poses_at(arc).angle[0]) - expected

        pose = curve.poses_at(root(ahead, poses.arc[k], poses.arc[k + 1]))
        yield {name: position[0] for name, position in pose.points.items()}


@pytest.mark.long
@pytest.mark.parametrize("name", grid(name for name in SOLVERS if SOLVERS[name].dead_centres()))
def test_swinging_cranks_reverse_at_the_dead_centres(name):
    dead = SOLVERS[name].dead_centres()
    for curve in traced(name).curves:
        assert curve.turns == 0
        assert len(curve.dead_centres) == 2
        assert angular_distances(curve.dead_centres, dead).max() <= 1e-11
    every = np.concatenate([curve.dead_centres for curve in traced(name).curves])
    assert angular_distances(dead, every).max() <= 1e-11


@pytest.mark.long
@pytest.mark.parametrize("name", grid(name for name in SOLVERS if SOLVERS[name].change_points()))
def test_branch_points_agree_with_the_closed_form(name):
    result, exact = traced(name), SOLVERS[name].change_points()
    angles = [branch_point.angle for branch_point in result.branch_points]
    assert angular_distances(angles, exact).max() <= 1e-8
    assert angular_distances(exact, angles).max() <= 1e-8
    for branch_point in result.branch_points:
        assert len(branch_point.locations) == 2
        points = [result.curves[i].poses_at(arc).points for i, arc in branch_point.locations]
        for point, position in points[0].items():
            assert (
                np.abs(position - points[1][point]).max()
                <= 1e-8 * SOLVERS[name].mechanism.characteristic_length
            )


@pytest.mark.slow
def test_close_curves_without_a_branch_point_are_separated():
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.05, coupler=0.1 + 1e-5, rocker=0.05)
    assert ms.trace(linkage.with_parameters(coupler=0.1), starts=0).branch_points
    result = ms.trace(linkage, starts=2)
    assert not result.branch_points
    # each curve keeps its assembly mode where the curves are close
    for curve in result.curves:
        poses = curve.samples(16)
        clear = loops.conditioning(linkage.mechanism, poses.poses) > 1e-3
        assert max(gap_to_closed_form(linkage, poses, k) for k in np.flatnonzero(clear)) <= 1e-10


@pytest.mark.long
def test_a_curve_of_high_curvature_keeps_its_assembly_mode():
    linkage = ms.catalog.make("four_bar", ground=0.11, crank=0.05, coupler=0.08, rocker=0.08 + 1e-10)
    curve = ms.trace(linkage, starts=0).curves[0]
    assert abs(curve.turns) == 1
    poses = curve.samples(60)
    assert set(np.sign(linkage.assembly_sign(poses.points))) == {1.0}


@pytest.mark.long
def test_a_folded_kite_has_a_curve_with_constant_crank_angle():
    kite = ms.catalog.make("four_bar", ground=0.1, crank=0.1, coupler=0.07, rocker=0.07)
    result = ms.trace(kite, starts=20)
    swinging, still = result.curves
    assert len(swinging.dead_centres) == 2
    assert np.ptp(still.samples(40).angle) <= 1e-12
    assert np.ptp(still.samples(40).joints["rocker.q"]) > 6.0
    assert [sorted(i for i, _ in branch_point.locations) for branch_point in result.branch_points] == [
        [0, 1],
        [0, 1],
    ]


def test_rockers_reverse_where_crank_and_coupler_are_collinear():
    linkage = ms.catalog.make("four_bar")
    first, second = ms.trace(linkage, starts=20).curves
    for curve in (first, second):
        reversals = [point for point in curve.turning_points if point.coordinate == "rocker.q"]
        reach = np.array([linkage.coupler + linkage.crank, linkage.coupler - linkage.crank])
        # the cosine rule in the triangle of ground, rocker and the straight line of both others
        cosines = (linkage.ground**2 + linkage.rocker**2 - reach**2) / (2.0 * linkage.ground * linkage.rocker)
        assert len(reversals) == 2
        assert {point.which for point in reversals} == {"highest", "lowest"}
        values = np.sort(np.cos([np.pi - point.value for point in reversals]))
        assert np.abs(values - np.sort(cosines)).max() <= 1e-12


def test_the_length_of_a_curve_is_the_integral_of_twists():
    linkage = ms.catalog.make("rrsrr")
    motion = linkage.solve(np.linspace(0.0, REVOLUTION, 400)[:-1])
    squares = sum(
        (link.velocity**2).sum(1) / linkage.mechanism.characteristic_length**2
        + (link.angular_velocity**2).sum(1)
        for link in motion.links.values()
    )
    assert abs(ms.trace(linkage, starts=0).curves[0].length - REVOLUTION * np.sqrt(squares).mean()) <= 1e-8


def test_poses_are_assigned_to_their_own_curve():
    result = traced("four_bar")
    loops = result.curves[0].loops
    for i, curve in enumerate(result.curves):
        segment = curve.traced.segments[3]
        features = segment.features.evaluate(np.linspace(segment.low, segment.high, 7))
        on = [mechanism_trace.lie_on(other, features).all() for other in result.curves]
        assert on == [k == i for k in range(len(result.curves))]
        moved = features + 1e-5 * np.eye(features.shape[1])[0]
        assert not mechanism_trace.lie_on(curve, moved).any()
    assert loops.features is result.curves[1].loops.features


def test_poses_that_are_corrected_a_few_at_a_time_keep_their_order(monkeypatch):
    curve = traced("four_bar").curves[0]
    arcs = np.random.default_rng(0).uniform(0.0, curve.length, 40)
    together = curve.poses_at(arcs)
    # of four coordinates, three poses at a time
    monkeypatch.setattr(assembly_curve, "TOGETHER", 12)
    apart = curve.poses_at(arcs)
    for (name, column), (_, other) in zip(together.columns(), apart.columns(), strict=True):
        np.testing.assert_allclose(column, other, rtol=0.0, atol=1e-13, err_msg=name)


def test_a_curve_that_never_closes_is_rejected(monkeypatch):
    monkeypatch.setattr(segments, "MAX_SEGMENTS", 60)
    reported = []
    with pytest.raises(
        ms.AssemblyError, match=r"geared: the curve has not returned .* 60 segments, .* irrational"
    ):
        ms.trace(
            stated_mechanism("geared_four_bar.toml", ratio=np.sqrt(2.0)),
            starts=0,
            progress=lambda *output: reported.append(output),
        )
    assert reported[-1] == ("component 1, segment 60 of at most 60", 1.0)


@pytest.mark.parametrize(
    ("name", "limit", "value", "message"),
    [
        ("carriage", "MAX_DISPLACEMENT", 20, "rail has moved by 20 times .* length 0"),
        ("press", "MAX_REVOLUTIONS", 4, r"thread\.turn has made 4 revolutions"),
    ],
)
def test_an_unbounded_joint_is_rejected(name, limit, value, message, monkeypatch):
    monkeypatch.setattr(segments, limit, value)
    with pytest.raises(ms.AssemblyError, match=f"{name}: .* is not closed: {message}"):
        ms.trace(stated_mechanism(f"mechanism_trace_{name}.toml"), starts=0)


def test_a_trace_of_two_dofs_is_rejected():
    arms = stated_mechanism("mechanism_trace_arms.toml")
    with pytest.raises(MobilityError, match=r"arms: underdetermined: .*two can still move; drive, lock or"):
        ms.trace(arms)
    (curve,) = ms.trace(replace(arms, gears=(ms.Gear("one", "two", -1.0),))).curves
    assert curve.turns == 1


@pytest.mark.long
def test_a_dwell_is_one_turning_point_at_its_middle():
    curve = ms.trace(ms.load("cam_follower"), starts=0).curves[0]
    turns = [point for point in curve.turning_points if point.coordinate == "guide.q"]
    lowest = np.sqrt(0.038**2 - 0.005**2) + 0.03
    assert [point.which for point in turns] == ["highest", "lowest"]
    assert [point.value for point in turns] == pytest.approx([lowest + 0.012, lowest], abs=1e-12)
    # the law dwells from 120 to 180 and from 300 to 360 degrees
    assert np.rad2deg([point.angle for point in turns]) % 360.0 == pytest.approx([150.0, 330.0], abs=1.0)
