from dataclasses import replace
from functools import cache

import numpy as np

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


def motion_of(mechanism: ms.Mechanism, route: str = "step", speed: float = SPEED, **options) -> ms.Motion:
    return simulate(mechanism, speed=speed, method=route, **{"samples": 72, **options}).motion


@cache
def revolution_of(name: str, route: str = "step") -> ms.Motion:
    """Return a revolution of a correct mechanism, for several tests."""
    return motion_of(LINKAGES[name].mechanism, route)


# correct mechanisms


# wrong mechanisms


def assert_rejected(verdict: ms.Verdict, outcome: str = "failed") -> None:
    assert not verdict.passed
    assert verdict.outcome == outcome, verdict
    assert verdict.reason
    assert "\n" not in verdict.reason


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
