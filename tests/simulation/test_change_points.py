"""At change points the solved poses of MuJoCo's model continue as smoothly as the closed form."""

import numpy as np
import pytest
from change_point_linkages import change_point_lengths, named
from wheel_linkages import assert_equal_rotation, wheel_linkages

from mechsim import catalog, dynamics
from mechsim.errors import AssemblyError, InputError
from mechsim.mechanism.forces import Forces
from mechsim.simulation import constant, simulate
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.poses import follow
from mechsim.simulation.source import from_source
from mechsim.studies.dynamics_check import crosscheck_driven

OTHERS = [
    catalog.make("four_bar", ground=0.1, crank=0.045, coupler=0.1, rocker=0.045),
    catalog.make("slider_crank", crank=0.05, rod=0.05, offset=0.0),
    catalog.make("slider_crank", crank=0.05, rod=0.06, offset=0.01),
    catalog.make(
        "rssr", crank=0.04, coupler=0.1, rocker=0.04, pivot=(0.0, -0.1, 0.0), gamma1=np.pi / 2, gamma2=0.0
    ),
]
# frame and crank differ by a twentieth, and its coupler turns fast near the flat configuration
LENGTHS = (0.08234220504898089, 0.0786613480083382, 0.11849674876387652, 0.12217760580451921)
NEARLY_FLAT = catalog.make("four_bar", **named(LENGTHS))
FLAT = [NEARLY_FLAT, *(catalog.make("four_bar", **named(item)) for item in change_point_lengths(9)), *OTHERS]


def assert_same_motion(motion, exact, length, bounds):
    """Points agree within bounds: positions relative to the size, rates relative to their maxima."""
    for name, point in exact.points.items():
        result = motion.points[name]
        scales = length, np.abs(point.velocity).max(), np.abs(point.acceleration).max()
        for kind, scale, limit in zip(("position", "velocity", "acceleration"), scales, bounds, strict=True):
            error = np.abs(getattr(result, kind) - getattr(point, kind)).max()
            assert error <= limit * scale, (name, kind)


@pytest.mark.long
@pytest.mark.parametrize("linkage", FLAT, ids=lambda item: f"{item.name} {item.change_points()[0]:.2f}")
def test_solved_poses_keep_their_assembly_mode_for_two_turns(linkage):
    run = simulate(linkage, speed=20.0, turns=2.0, method="pose", samples=144)
    assert run.outcome == "passed"
    motion = run.motion
    exact = linkage.solve(motion.angle, motion.speed, motion.acceleration)
    # measured 2e-11, 3e-10 and 3e-9 for nearly equal frame and crank, else 1e-13, 5e-12 and 1e-10; ten
    # times as much for NEARLY_FLAT, whose path is evaluated within 0.03 rad and curves within 0.05 rad
    loose = 10.0 if linkage is NEARLY_FLAT else 1.0
    assert_same_motion(
        motion, exact, linkage.mechanism.characteristic_length, loose * np.array([1e-10, 1e-9, 1e-8])
    )
    for name in exact.joints.keys() & motion.joints.keys():
        joint = exact.joints[name]
        assert np.abs(np.exp(1j * motion.joints[name].value) - np.exp(1j * joint.value)).max() <= 1e-9
        assert np.abs(motion.joints[name].rate - joint.rate).max() <= 1e-6


@pytest.mark.long
# instants up to 6.5 mrad before the change points, also backwards
@pytest.mark.parametrize("turns", [2.395, -0.898])
@pytest.mark.parametrize("linkage", OTHERS, ids=lambda item: f"{item.name} {item.change_points()[0]:.2f}")
def test_solved_poses_stay_on_the_branch_as_the_closed_form_does(linkage, turns):
    linkage = linkage.with_change_point("branch")
    run = simulate(linkage, speed=20.0 * np.sign(turns), turns=abs(turns), samples=96)
    assert run.outcome == "passed"
    motion = run.motion
    exact = linkage.solve(motion.angle, motion.speed)
    # measured 2e-14 of the size, 6e-12 and 4e-8 of the largest
    assert_same_motion(motion, exact, linkage.mechanism.characteristic_length, (1e-12, 1e-10, 1e-6))


@pytest.mark.long
@pytest.mark.parametrize("linkage", OTHERS[:3], ids=lambda item: f"{item.name} {item.change_points()[0]:.2f}")
def test_forces_at_a_change_point_are_their_limits(linkage):
    # begins and ends at the change point
    profile = constant(20.0, 1.0, linkage.change_points()[-1])
    model = dynamics.dynamic_model(linkage).starting_at(profile.angles)
    run = driven(model.mechanism, model.forces, profile=profile, samples=36)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict.reason
    heavier = dynamics.dynamic_model(linkage, Forces(gravity=(0.0, -9.8101, 0.0)))
    assert not crosscheck_driven(run, heavier).passed
    with pytest.raises(
        InputError, match="changes its branch at change points, where speeds are discontinuous"
    ):
        dynamics.dynamic_model(linkage.with_change_point("branch"))


def test_stepping_through_change_points_with_policy_branch_is_rejected():
    linkage = OTHERS[0].with_change_point("branch")
    with pytest.raises(
        InputError, match=r"must stay on the branch at crank angle 3\.142, 6\.283 rad, .*: run it by pose"
    ):
        simulate(linkage, speed=20.0, method="step")
    start = linkage.mechanism.start
    swing = simulate(linkage, profile=constant(20.0, 0.1, start), method="step")
    assert swing.outcome == "passed"


@pytest.mark.parametrize("start", [0.0, np.pi])
def test_a_stepped_run_starting_at_a_change_point_is_rejected(start):
    linkage = catalog.make("four_bar", ground=0.1, crank=0.045, coupler=0.1, rocker=0.045)
    with pytest.raises(
        AssemblyError, match=r"starts at crank angle .* rad, .*do not determine .* second parallel"
    ):
        simulate(linkage, profile=constant(20.0, 0.1, start), method="step")
    run = simulate(linkage, profile=constant(20.0, 0.1, start + 0.5), method="step")
    assert run.outcome == "passed"
    assert run.note == ""


# measured: 4e-14, 2e-12 and 1e-10 of a radius; with change points 0.3 rad apart 1e-12, 1e-11, 1e-10
BOUNDS = (1e-11, 1e-10, 3e-9)


@pytest.mark.parametrize(("wheels", "lag"), [(3, 0.0), (4, 0.0), (5, 0.0), (3, 0.3)])
def test_coupled_wheels_turn_equally_through_multiple_change_points(wheels, lag):
    mechanism = wheel_linkages(wheels, lag)
    run = simulate(mechanism, speed=3.0, turns=1, samples=72, method="pose")
    assert run.outcome == "passed"
    assert_equal_rotation(mechanism, run.motion, BOUNDS)


@pytest.mark.long
@pytest.mark.parametrize("wheels", [3, 4])
@pytest.mark.parametrize("samples", [17, 64, 73])
def test_change_points_are_found_for_any_number_of_samples(wheels, samples):
    closed = from_source(wheel_linkages(wheels))
    _, path = follow.follow_path(closed.loops, closed.qpos, np.linspace(0.2, 6.1, samples))
    passed = [point for point in path.change_points if 0.2 <= point <= 6.1]
    assert passed == pytest.approx([np.pi], abs=1e-9)
