"""Wrong, late and diverged motions fail with a reason in one line."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from catalog_faults import FAULTS, SWINGING
from driven_mechanisms import boom, five_bar, sinusoidal
from grids import grid

import mechsim as ms
from mechsim import crosscheck
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import make_motion_laws
from mechsim.simulation import simulate
from mechsim.studies.validate import case_of

SPEED = 20.0 * np.pi
RSSR, FOUR_BAR = map(ms.catalog.make, ("rssr", "four_bar"))


def motion_of(linkage, speed=SPEED, samples=72, **options) -> ms.Motion:
    return simulate(linkage.mechanism, speed=speed, method="step", samples=samples, **options).motion


@pytest.fixture(scope="module")
def revolution():
    """A revolution of the four-bar."""
    return motion_of(FOUR_BAR)


def assert_rejected(verdict: ms.Verdict, outcome: str = "failed") -> None:
    assert verdict.outcome == outcome, verdict
    assert not verdict.passed
    assert verdict.reason
    assert "\n" not in verdict.reason


def test_a_nan_in_joints_or_residuals_is_detected(revolution) -> None:
    values, closure = revolution.joints["rocker"].value.copy(), revolution.closure.copy()
    values[3] = closure[-1] = np.nan
    joints = {**revolution.joints, "rocker": replace(revolution.joints["rocker"], value=values)}
    for changes in ({"joints": joints}, {"closure": closure}):
        assert_rejected(ms.crosscheck(replace(revolution, **changes), FOUR_BAR), "diverged")


@pytest.mark.parametrize("tolerance", [None, 1e9])
def test_a_run_that_diverges_late_fails_at_any_tolerance(tolerance) -> None:
    wild = ms.Settings(integrator="Euler", steps_per_turn=100, constant_steps=0.1)
    run = simulate(RSSR.mechanism, speed=SPEED, turns=5.0, settings=wild)
    assert_rejected(ms.crosscheck(run.motion, RSSR, tolerance=tolerance), "diverged")


def test_a_run_with_soft_loops_fails_with_its_error() -> None:
    verdict = ms.crosscheck(motion_of(RSSR, settings=ms.Settings(steps_per_turn=30)), RSSR, tolerance=1e-9)
    assert_rejected(verdict)
    assert "beyond the tolerance: position of P3 by" in verdict.reason


def test_a_closed_form_out_of_reach_is_reported(revolution) -> None:
    swinging = ms.catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.05, rocker=0.07)
    assert_rejected(ms.crosscheck(revolution, swinging), "cannot assemble")


def test_explicit_tolerances_replace_the_defaults(revolution) -> None:
    strict = {"acceleration": ms.Tolerance(1e-12, "m/s2", "as requested")}
    verdict = ms.crosscheck(revolution, FOUR_BAR, bounds=strict)
    assert_rejected(verdict)
    assert {check.title.split()[0] for check in verdict.checks if not check.passed} == {"acceleration"}


LAWS = make_motion_laws(
    five_bar(), {"left": sinusoidal(2.0, 0.3, 6.0), "right": sinusoidal(1.0, 0.2, 9.0)}, 1.0
)
SOLVER = KinematicSolver(five_bar(), motion_laws=LAWS)
# a cylinder with a fast oscillation
BOOM = KinematicSolver(
    boom(), motion_laws=make_motion_laws(boom(), {"stroke": sinusoidal(0.8, 0.01, 60.0)}, 1.0)
)
TIME = np.linspace(0.0, 1.0, 40)


def record(solver: KinematicSolver, source: str):
    """Return a motion as a simulator would record it."""
    assert not solver.motion_laws.crank
    motion = solver.solve(t=TIME)
    return replace(motion, source=source, time=TIME, origin=None, closure=np.zeros(len(TIME)))


def lagging(by: float) -> KinematicSolver:
    late = make_motion_laws(
        five_bar(), {"left": sinusoidal(2.0, 0.3, 6.0, -by), "right": sinusoidal(1.0, 0.2, 9.0)}, 1.0
    )
    return KinematicSolver(five_bar(), motion_laws=replace(late, rate=LAWS.rate))


@pytest.mark.parametrize("source", ["pose", "step"])
def test_every_driver_with_a_motion_law_is_checked(source):
    verdict = crosscheck(record(SOLVER, source), SOLVER)
    assert verdict.passed, verdict
    reported = {check.subject: check.worst for check in verdict.checks if check.kind == "driver angle"}
    assert reported.keys() == {"left", "right"}
    assert max(reported.values()) < 1e-14


def test_drivers_without_motion_laws_are_not_checked():
    verdict = crosscheck(record(SOLVER, "pose"), record(lagging(0.0), "loop equations"))
    assert verdict.passed
    assert "driver angle" not in {check.kind for check in verdict.checks}


def test_a_lagging_driver_fails_only_its_own_check():
    verdict = crosscheck(record(lagging(0.05), "step"), SOLVER)
    assert [check.title for check in verdict.checks if not check.passed] == ["drive: left"]
    worst = next(check.worst for check in verdict.checks if check.title == "drive: left")
    assert worst == pytest.approx(0.3 * 0.05, rel=2e-2)


@pytest.mark.parametrize("solver", [SOLVER, BOOM], ids=["arms", "cylinder"])
def test_accelerations_are_relative_to_the_fastest_driver(solver):
    result = record(solver, "pose")
    verdict = crosscheck(result, solver)
    limit = next(c for c in verdict.checks if c.kind == "acceleration").tolerance
    reach = max(np.abs(item.position).max() for item in (*result.points.values(), *result.links.values()))
    drivers = [result.joints[name] for name in result.drivers]
    quickest = max(
        np.abs(item.acceleration).max() / (1.0 if item.unit == "rad" else reach) for item in drivers
    )
    assert limit == pytest.approx(8192 * np.finfo(np.float64).eps * reach * quickest, rel=1e-9)


def test_a_solver_of_times_is_compared_at_the_recorded_times():
    result = record(SOLVER, "step")
    of_times = SimpleNamespace(solve=SOLVER.solve, motion_laws=LAWS, assembly_sign=SOLVER.assembly_sign)
    assert crosscheck(result, of_times).passed
    late = record(lagging(0.05), "step")
    failed = {check.kind for check in crosscheck(late, of_times).checks if not check.passed}
    assert failed >= {"driver angle", "position"}


# each fault by one method, each mechanism by both
CASES = [
    (name, fault, ("pose", "step")[i % 2])
    for name in ms.catalog.MECHANISMS
    for i, fault in enumerate(FAULTS[name])
]


@pytest.mark.long
@pytest.mark.parametrize(("name", "fault", "method"), CASES)
def test_a_wrong_mechanism_fails(name, fault, method):
    linkage = ms.catalog.make(name)
    wrong = linkage.with_parameters(**FAULTS[linkage.name][fault])
    # a crank with a dead centre, as on the looper's other side, makes half a revolution
    turns = 1.0 if wrong.crank_range().full else 0.5
    run = simulate(wrong.mechanism, speed=SPEED, turns=turns, method=method, samples=36)
    verdict = ms.crosscheck(run.motion, linkage)
    assert not verdict.passed, str(verdict)
    assert verdict.reason
    if "assembly" in fault:
        assert verdict.outcome == "changed assembly"


@pytest.mark.long
@pytest.mark.parametrize("name", grid(ms.catalog.MECHANISMS))
@pytest.mark.parametrize("method", ["pose", "step"])
def test_the_correct_mechanism_passes(name, method):
    linkage = ms.catalog.make(name)
    run = simulate(linkage.mechanism, speed=SPEED, method=method, samples=36)
    verdict = ms.crosscheck(run.motion, linkage, speed=SPEED)
    assert verdict.passed, str(verdict)


@pytest.mark.long
@pytest.mark.parametrize("name", grid(SWINGING, ("four_bar",)))
def test_swinging_cranks_are_validated_within_their_range(name):
    swinging = ms.catalog.make(name, **SWINGING[name])
    arcs = swinging.crank_range()
    assert not arcs.full
    assert arcs.arcs
    case = case_of(swinging)
    assert case.passed, case.verdict.reason


@pytest.mark.long
def test_variants_of_a_mechanism_are_validated():
    case = case_of(ms.catalog.make("rssr"))
    assert any(check.title == "guided, step: orientation of coupler" for check in case.verdict.checks)
    assert case.passed
