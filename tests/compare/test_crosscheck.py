from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import PointMotion
from mechsim.simulation import simulate

SPEED = 62.8
LINKAGES: dict[str, KinematicSolver] = {
    "rssr": ms.catalog.make("rssr"),
    "guided rssr": ms.catalog.make("rssr", guide=True),
    "four_bar": ms.catalog.make("four_bar"),
    "slider_crank": ms.catalog.make("slider_crank"),
}
ROUTES = ("pose", "step")
# parameters of the second and third link of each mechanism
LINKS = {
    "rssr": ("coupler", "rocker"),
    "guided rssr": ("coupler", "rocker"),
    "four_bar": ("coupler", "rocker"),
    "slider_crank": ("rod",),
}


def motion_of(mechanism: ms.Mechanism, route: str = "step", speed: float = SPEED, **options) -> ms.Motion:
    return simulate(mechanism, speed=speed, method=route, **{"samples": 72, **options}).motion


@cache
def revolution_of(name: str, route: str = "step") -> ms.Motion:
    """Return a revolution of a correct mechanism, for several tests."""
    return motion_of(LINKAGES[name].mechanism, route)


# correct mechanisms


@pytest.mark.long
@pytest.mark.parametrize("name", LINKAGES)
def test_the_loop_equations_can_be_the_analytic_motion(name: str) -> None:
    mechanism = LINKAGES[name].mechanism
    motion = motion_of(mechanism, samples=24)
    exact = ms.loops.solve(mechanism, motion.angle, motion.speed, motion.acceleration)
    free = frozenset() if "guided" in name else LINKAGES[name].solve([0.0]).spinning
    assert ms.crosscheck(motion, replace(exact, spinning=free)).passed


# wrong mechanisms


def assert_rejected(verdict: ms.Verdict, outcome: str = "failed") -> None:
    assert not verdict.passed
    assert verdict.outcome == outcome, verdict
    assert verdict.reason
    assert "\n" not in verdict.reason


# each link by one method, each mechanism by both
ONE_ROUTE = [
    (name, link, ROUTES[i % 2]) for name, links in LINKS.items() for i, link in enumerate(("crank", *links))
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "link", "route"), ONE_ROUTE)
def test_a_link_too_long_by_a_thousandth_fails(name: str, link: str, route: str) -> None:
    linkage = LINKAGES[name]
    wrong = linkage.with_parameters(**{link: 1.001 * getattr(linkage, link)})
    assert_rejected(ms.crosscheck(motion_of(wrong.mechanism, route), linkage))


@pytest.mark.long
@pytest.mark.parametrize("name", LINKAGES)
@pytest.mark.parametrize("route", ROUTES)
def test_the_other_assembly_mode_is_reported(name: str, route: str) -> None:
    linkage = LINKAGES[name]
    wrong = linkage.with_parameters(branch=-linkage.branch)
    assert_rejected(ms.crosscheck(motion_of(wrong.mechanism, route), linkage), "changed assembly")


@pytest.mark.long
@pytest.mark.parametrize("rotated", ["gamma1", "gamma2"])
@pytest.mark.parametrize("route", ROUTES)
def test_a_rocker_axis_tilted_by_a_tenth_of_a_degree_fails(rotated: str, route: str) -> None:
    linkage = LINKAGES["rssr"]
    wrong = linkage.with_parameters(**{rotated: getattr(linkage, rotated) + np.deg2rad(0.1)})
    assert_rejected(ms.crosscheck(motion_of(wrong.mechanism, route), linkage))


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "points"), [("rssr", ("P2", "P3")), ("four_bar", ("A", "B")), ("four_bar", ("B", "C"))]
)
def test_two_swapped_points_fail(name: str, points: tuple[str, str]) -> None:
    linkage = LINKAGES[name]
    motion = revolution_of(name)
    name_a, other = points
    swapped = dict(motion.points) | {name_a: motion.points[other], other: motion.points[name_a]}
    assert not ms.crosscheck(replace(motion, points=swapped), linkage).passed


def test_a_nan_in_joints_or_residuals_is_detected() -> None:
    linkage = LINKAGES["four_bar"]
    motion = revolution_of("four_bar")
    values = motion.joints["rocker"].value.copy()
    values[3] = np.nan
    joints = {**motion.joints, "rocker": replace(motion.joints["rocker"], value=values)}
    assert_rejected(ms.crosscheck(replace(motion, joints=joints), linkage), "diverged")
    assert motion.closure is not None
    open_loop = motion.closure.copy()
    open_loop[-1] = np.nan
    assert_rejected(ms.crosscheck(replace(motion, closure=open_loop), linkage), "diverged")


def test_a_run_that_diverges_late_fails() -> None:
    linkage = LINKAGES["rssr"]
    wild = ms.Settings(integrator="Euler", steps_per_turn=100, constant_steps=0.1)
    run = simulate(linkage.mechanism, speed=SPEED, turns=5.0, settings=wild)
    assert_rejected(ms.crosscheck(run.motion, linkage), "diverged")
    # a huge tolerance does not accept it
    assert_rejected(ms.crosscheck(run.motion, linkage, tolerance=1e9), "diverged")


def test_a_run_with_soft_loops_fails_with_its_error() -> None:
    linkage = LINKAGES["rssr"]
    motion = motion_of(linkage.mechanism, settings=ms.Settings(steps_per_turn=30))
    verdict = ms.crosscheck(motion, linkage, tolerance=1e-9)
    assert_rejected(verdict)
    assert "beyond the tolerance: position of P3 by" in verdict.reason


def test_velocities_of_another_instant_fail() -> None:
    linkage = LINKAGES["rssr"]
    motion = motion_of(linkage.mechanism, settings=ms.Settings(steps_per_turn=1000), samples=1000)
    point = motion.points["P3"]
    late = PointMotion(point.position, np.roll(point.velocity, 1, 0), point.acceleration)
    assert not ms.crosscheck(replace(motion, points={**motion.points, "P3": late}), linkage).passed


def test_a_crank_too_fast_by_a_thousandth_fails_only_the_drive_check() -> None:
    linkage = LINKAGES["slider_crank"]
    verdict = ms.crosscheck(motion_of(linkage.mechanism, speed=1.001 * SPEED), linkage, speed=SPEED)
    assert_rejected(verdict)
    assert all(check.title.startswith("drive") for check in verdict.checks if not check.passed)


def test_a_closed_form_out_of_reach_is_reported() -> None:
    swinging = ms.catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.05, rocker=0.07)
    assert_rejected(ms.crosscheck(revolution_of("four_bar"), swinging), "cannot assemble")


def test_explicit_tolerances_replace_the_defaults() -> None:
    linkage = LINKAGES["four_bar"]
    motion = motion_of(linkage.mechanism, settings=ms.Settings(steps_per_turn=100))
    strict = {"acceleration": ms.Tolerance(1e-12, "m/s2", "as requested")}
    verdict = ms.crosscheck(motion, linkage, bounds=strict)
    assert_rejected(verdict)
    assert {check.title.split()[0] for check in verdict.checks if not check.passed} == {"acceleration"}


# invalid comparisons


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        ({}, "the analytic motion has no point"),
        ({"Q": "A"}, r"the simulation has no point Q \(it has A, B, C\)"),
        ({"A": "nan"}, "has no finite position of point 'A' at crank angle"),
    ],
)
def test_an_invalid_motion_is_rejected(points: dict[str, str], sentence: str) -> None:
    motion = revolution_of("four_bar")
    right = LINKAGES["four_bar"].solve(motion.angle, motion.speed)
    hole = np.where(np.arange(len(motion))[:, None] == 5, np.nan, right.points["A"].position)
    by_name = {"A": right.points["A"], "nan": replace(right.points["A"], position=hole)}
    exact = replace(right, points={name: by_name[source] for name, source in points.items()}, origin=None)
    with pytest.raises(ms.InputError, match=sentence) as reported:
        ms.crosscheck(motion, exact)
    assert "\n" not in str(reported.value)
