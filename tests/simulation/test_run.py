import tracemalloc

import mujoco
import numpy as np
import pytest
from model_files import FOLDER, model_text
from motions import largest_difference

import mechsim as ms
from mechsim.mechanism.motion_laws import swing, tabled
from mechsim.simulation import simulate
from mechsim.simulation.source import assembled
from mechsim.units import rpm

CATALOGUE = ("rssr", "four_bar", "slider_crank")
REVOLUTION = 2.0 * np.pi


# sampling of a motion


@pytest.mark.parametrize("reach", [0.01, 1e-5])
@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_short_swing_is_sampled_over_its_whole_range(reach: float, method: str) -> None:
    linkage = ms.catalog.make("slider_crank")
    run = simulate(linkage, profile=swing(0.7, reach, 60.0), method=method)
    angle = run.motion.angle
    assert np.ptp(angle) == pytest.approx(2.0 * reach, rel=1e-2)
    assert run.outcome == "passed"
    assert ms.crosscheck(run, linkage).passed


# poses


def test_a_thousand_turns_are_as_accurate_as_one() -> None:
    linkage = ms.catalog.make("rssr")
    motion = simulate(linkage.mechanism, speed=1.0, turns=1000.0, method="pose", samples=3001).motion
    exact = linkage.solve(motion.angle, 1.0)
    # the rounding error of a crank angle of 6283 rad is 5e-13 rad
    assert largest_difference(motion, exact) < 2e-12 * linkage.crank


# steps


@pytest.mark.long
@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize(
    ("speed", "tolerance"), [(1.0, 1e-7), (600.0, 1e-5), (-600.0, 1e-7), (600.0, 1e-9), (20_000.0, 1e-7)]
)
def test_a_tolerance_is_satisfied_against_the_closed_form(name: str, speed: float, tolerance: float) -> None:
    linkage = ms.catalog.make(name)
    run = simulate(linkage.mechanism, speed=rpm(speed), turns=1.5, tolerance=tolerance)
    assert run.outcome == "passed"
    exact = linkage.solve(run.motion.angle, run.motion.speed).points
    distance = max(
        np.linalg.norm(run.motion.points[name].position - point.position, axis=1).max()
        for name, point in exact.items()
    )
    # the estimate of the simulator agrees with the closed form at the same instants
    assert run.estimate == pytest.approx(distance, rel=1e-3, abs=1e-15)
    assert distance <= tolerance
    assert np.ptp(run.motion.angle) == pytest.approx(1.5 * REVOLUTION, abs=1e-7)
    assert np.sign(run.motion.angle[-1] - run.motion.angle[0]) == np.sign(speed)


@pytest.mark.long
def test_a_tolerance_below_rounding_fails_with_the_error() -> None:
    run = simulate(ms.catalog.make("slider_crank").mechanism, speed=10.0, turns=0.05, tolerance=1e-19)
    assert run.outcome == "failed"
    assert 1e-19 < run.estimate < 1e-11


def test_a_profile_is_followed_in_angle_speed_and_acceleration() -> None:
    linkage = ms.catalog.make("rssr")
    time = np.linspace(0.0, 0.5, 101)
    law = tabled("crank", time, 0.3 + 20.0 * time**2 - 4.0 * np.sin(6.0 * time))
    profile = ms.simulation.CrankProfile(0.5, 44.0, law)
    for method, limit in (("pose", 1e-12), ("step", 1e-4)):
        run = simulate(linkage.mechanism, profile=profile, method=method, samples=100)
        required, speed, acceleration = profile.state(run.motion.time)
        # in steps, torque is constant over each: the angle errs by the step squared, 1/8 x 2e-7 x 144 rad
        assert np.abs(run.motion.angle - required).max() < limit
        assert np.abs(run.motion.speed - speed).max() < max(limit, 1e-10) * 40.0
        exact = linkage.solve(run.motion.angle, run.motion.speed, run.motion.acceleration)
        assert largest_difference(run.motion, exact) < (1e-14 if method == "pose" else 1e-9)
        assert largest_difference(run.motion, exact, "velocity") < 1e-6
        if method == "pose":
            assert np.abs(run.motion.acceleration - acceleration).max() < 1e-9


@pytest.mark.long
def test_an_impassable_dead_centre_is_rejected_with_its_angle() -> None:
    linkage = ms.catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.05, rocker=0.07)
    for method in ("step", "pose"):
        with pytest.raises(ms.AssemblyError, match="the crank cannot pass") as reported:
            simulate(linkage.mechanism, speed=10.0, method=method)
        output = float(str(reported.value).split("cannot pass ")[1].split()[0])
        # the continuation stops within its shortest step of a dead centre
        nearest = min(abs(np.angle(np.exp(1j * (output - dead)))) for dead in linkage.dead_centres())
        assert nearest < 1e-4


def test_a_diverged_run_reports_its_finite_motion() -> None:
    coarse = ms.Settings(integrator="Euler", steps_per_turn=100, constant_steps=0.1)
    run = simulate(ms.catalog.make("rssr").mechanism, speed=62.0, turns=5.0, settings=coarse)
    assert run.outcome == "diverged"
    assert run.motion.broken
    assert run.summary()["estimate"] is None
    for point in run.motion.points.values():
        assert np.isfinite(point.acceleration).all()
    # states after MuJoCo resets a diverged state are not part of the motion
    assert (np.diff(run.motion.time) > 0.0).all()


def test_the_estimate_of_a_compliant_loop_is_within_a_factor_of_two() -> None:
    linkage = ms.catalog.make("rssr")
    contact = {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0), "refsafe": True}
    soft = ms.Settings(integrator="Euler", steps_per_turn=100, compliance=1.0, **contact)
    run = simulate(linkage.mechanism, speed=rpm(600.0), settings=soft)
    error = largest_difference(run.motion, linkage.solve(run.motion.angle, run.motion.speed))
    assert 1e-4 < error < 1e-2
    assert 0.5 * error < run.estimate < 2.0 * error


@pytest.mark.long
def test_a_long_run_needs_memory_only_for_its_records() -> None:
    mechanism = ms.catalog.make("four_bar").mechanism
    simulate(mechanism, speed=10.0, method="step")  # loads modules first
    tracemalloc.start()
    run = simulate(mechanism, speed=10.0, turns=500.0, samples=10, settings=ms.Settings(steps_per_turn=100))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert run.steps == 50_000
    assert len(run.motion) == 11
    # all 50,000 states would be 2.4 MB; a block of 4,096 is 0.2 MB
    assert peak < 1e6


# user-defined models

FOUR_BAR = model_text("run_four_bar.xml")


def test_a_users_file_with_a_connect_between_bodies_runs(file) -> None:
    # in the reference configuration the coupler lies along x from (0.04, 0) and the rocker stands along y
    closing = '<connect body1="coupler" body2="rocker" anchor=".06 .08 0"/>'
    path = file(FOUR_BAR.format(f=0.0, closing=closing))
    lengths = {"ground": 0.1, "crank": 0.04, "coupler": float(np.hypot(0.06, 0.08)), "rocker": 0.08}
    arm = {"arm": float(np.hypot(0.05, 0.02)), "arm_angle": float(np.angle((5 + 2j) / (6 + 8j)))}
    linkage = ms.catalog.make("four_bar", **lengths, **arm, branch=1)
    for options in ({"method": "pose"}, {"tolerance": 1e-8}):
        run = simulate(path, speed=10.0, **options)
        assert run.outcome == "passed"
        exact = linkage.solve(run.motion.angle, run.motion.speed)
        for name in ("B", "C"):
            limit = np.abs(run.motion.points[name].position - exact.points[name].position).max()
            assert limit < options.get("tolerance", 1e-14)


def test_a_users_spec_is_unchanged_by_a_run() -> None:
    spec = mujoco.MjSpec.from_string(FOUR_BAR.format(f=0.0, closing=""))
    before = spec.to_xml()
    simulate(spec, speed=1.0, method="step", turns=0.01)
    assert spec.to_xml() == before


def test_the_origins_of_bodies_are_points_of_a_model_without_sites() -> None:
    text = FOUR_BAR.format(f=0.0, closing="").replace("<site", "<!--").replace('0"/></body>', '0"--></body>')
    assert {*simulate(text, speed=1.0).motion.points} == {"coupler", "crank", "rocker"}


def test_a_run_reports_the_requested_or_default_method() -> None:
    mechanism = ms.catalog.make("rssr").mechanism

    for method, arguments in (
        ("pose", {}),
        ("step", {"tolerance": 1e-5}),
        ("step", {"settings": ms.Settings()}),
        ("pose", {"tolerance": 1e-5, "method": "pose"}),
    ):
        run = simulate(mechanism, speed=10.0, turns=0.1, **arguments)
        assert run.summary()["method"] == run.method == method
        assert bool(run.summary()["settings"]) == (method == "step")


def test_a_crank_without_enough_drive_inertia_diverges() -> None:
    mechanism = ms.catalog.make("rssr").mechanism
    run = simulate(mechanism, speed=10.0, turns=20.0, settings=ms.Settings(drive_inertia=1e-6))
    assert run.outcome == "diverged"
    assert "the crank is at" in run.motion.broken


def test_an_unconnected_falling_body_does_not_change_the_outcome() -> None:
    linkage = ms.catalog.make("four_bar")
    spec = assembled(linkage.mechanism, ms.Scene())
    spec.option.gravity = 0.0, -9.81, 0.0
    ball = spec.worldbody.add_body(name="ball", pos=(0.3, 0.3, 0.1))
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.01, 0.0, 0.0))
    ball.add_site(name="falling")
    run = simulate(spec, speed=62.8, settings=ms.Settings())
    assert run.outcome == "passed"
    assert np.ptp(run.motion.points["falling"].position[:, 1]) > 0.04
    # the falling body does not widen the tolerance
    assert run.tolerance < 1e-5
    assert ms.crosscheck(run, linkage).passed


# at 100 N m the position errors are 1 to 3 mm, depending on the linear-algebra kernel
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "loss"), [("rssr", 1.0), ("rssr", 10.0), ("bennett", 10.0), ("looper", 10.0)]
)
def test_accelerations_are_correct_with_sticking_dry_friction(name: str, loss: float) -> None:
    """In MuJoCo's compliant loops friction stops a light rocker at instants: 50 m/s2 error at any step."""
    linkage = ms.catalog.make(name)
    spec = assembled(linkage.mechanism, ms.Scene(level="dynamics"))
    for joint in spec.joints:
        joint.frictionloss = loss
    run = simulate(spec, speed=62.8, tolerance=1e-3)
    assert run.outcome == "passed"
    assert ms.crosscheck(run, linkage).passed
    exact = linkage.solve(run.motion.angle, run.motion.speed, run.motion.acceleration)
    largest = max(float(np.abs(point.acceleration).max()) for point in exact.points.values())
    # measured 0.03
    assert largest_difference(run.motion, exact, "acceleration") < 0.3 * largest


def test_both_methods_continue_smoothly_through_a_flat_sarrus_linkage() -> None:
    flat = ms.load("sarrus", {"upper": "40mm"})
    posed = simulate(flat, profile=ms.simulation.constant(-6.0, 0.3, 0.0), method="pose").motion
    solved = [flat.solve(angles, 2.0) for angles in ([0.0], np.linspace(0.5, -0.5, 8), [0.3, 0.0, -0.3])]
    for motion in (posed, *solved):
        height, speed = motion.points["top"], motion.speed
        np.testing.assert_allclose(height.position[:, 2], 0.08 * np.sin(motion.angle), atol=1e-12)
        np.testing.assert_allclose(height.velocity[:, 2], 0.08 * speed * np.cos(motion.angle), atol=1e-11)


@pytest.mark.long
@pytest.mark.parametrize("compliance", [1e-8, 1e-10, 1e-12])
def test_the_crank_speed_is_independent_of_the_loop_compliance(compliance):
    """Measured 1.3e-11, 1.3e-11 and 4.9e-13; with the same flywheel for all, 1.3e-11, 1.3e-9 and 4.9e-9."""
    settings = ms.Settings(steps_per_turn=2000, compliance=compliance)
    motion = simulate(ms.catalog.make("bennett").mechanism, speed=60.0, settings=settings).motion
    assert np.abs(motion.speed / 60.0 - 1.0).max() < 1e-10


def test_opposing_servos_do_not_affect_accelerations_of_solved_poses():
    # light links with a servo, a spring and a damper whose forces are large for them
    subject = ms.load(FOLDER / "forces_of_posed_scenes_opposed.xml", drive={"crank": "0.3*(1-cos(2*pi*t))"})
    posed = ms.simulate(subject, method="pose").motion
    exact = subject.solve(t=posed.time)
    for name in ("rod", "rocker"):
        expected = exact.joints[name].acceleration
        # measured 1e-15 of the largest, and 3.5e-7 with those forces active
        assert np.abs(posed.joints[name].acceleration - expected).max() < 1e-13 * np.abs(expected).max()
