"""Tolerances, checks and verdicts from numbers that can be checked by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from records import force_record

from mechsim.compare.checks import Verdict, check_of, combined, concluded, tolerances_of
from mechsim.compare.crosscheck import crosscheck, crosscheck_forces
from mechsim.compare.quantities import (
    QUANTITIES,
    force_scales,
    motion_scales,
    reach_of,
    stroke_of,
)
from mechsim.compare.tolerances import RATES, WELL_CONDITIONED, Requested, Tolerance, ToleranceRule
from mechsim.errors import InputError
from mechsim.mechanism.motion import LinkMotion, Motion, PointMotion
from mechsim.numerics.arrays import EPS

N = 5
ANGLE = np.linspace(-3.0, -0.2, N)
FLAT = np.zeros((N, 3))
UNIT = np.ones(N)


# tolerances


def test_the_larger_of_fixed_and_requested_tolerance_applies():
    limit = ToleranceRule("{part:.3g} of {scale:.3g} {unit}", 1e-3, requested=2.0, power=3)
    strict, loose = (limit.tolerance("m", 0.5, Requested(fraction, scale=4.0)) for fraction in (1e-6, 0.1))
    assert strict.value == pytest.approx(0.5e-3)
    assert strict.reason == "0.001 of 0.5 m"
    assert loose.value == pytest.approx(2.0 * 0.1 * 0.5 / 4.0)
    assert loose.reason == "0.05 of 0.5 m"
    assert (loose.unit, loose.power) == ("m", 3)


def test_tolerances_widen_only_at_poor_conditioning():
    conditioning = np.array([10.0, 1.0, 0.5, 0.1]) * WELL_CONDITIONED
    for power in (0, 1, 3):
        widened = Tolerance(2.0, "m", "", power).widened(conditioning, 4)
        assert widened == pytest.approx([2.0, 2.0, 2.0 * 2.0**power, 2.0 * 10.0**power])
        assert Tolerance(2.0, "m", "", power).widened(None, 3).tolist() == [2.0] * 3
    assert np.isfinite(Tolerance(2.0, "m", "", 1).widened(np.zeros(2), 2)).all()
    assert Tolerance(2.0, "m", "").power == 0


def test_acceleration_tolerances_widen_with_squared_conditioning():
    poor = np.array([1e-2, 1e-3, 1e-6]) * WELL_CONDITIONED
    assert RATES.widened(poor, 3) == pytest.approx(EPS / poor**2, rel=1e-12, abs=0.0)
    assert RATES.widened(np.ones(1), 1) == pytest.approx(100.0 * EPS, rel=1e-12, abs=0.0)


# checks


def test_a_check_reports_the_largest_error_relative_to_its_tolerance():
    error, conditioning = (
        np.array([1.0, 3.0, 2.5, 0.0, 0.5]),
        np.array([1.0, 0.25, 1.0, 1.0, 1.0]) * WELL_CONDITIONED,
    )
    plain = check_of("position", "P", error, ANGLE, Tolerance(2.0, "m", "why", 1))
    assert (plain.worst, plain.instant, plain.tolerance, plain.reason) == (3.0, ANGLE[1], 2.0, "why")
    assert plain.rms == pytest.approx(np.sqrt((1.0 + 9.0 + 6.25 + 0.25) / 5.0))
    assert (plain.unit, plain.kind, plain.subject, plain.passed) == ("m", "position", "P", False)
    wide = check_of("position", "P", error, ANGLE, Tolerance(2.0, "m", "why", 1), conditioning)
    assert (wide.worst, wide.instant, wide.tolerance, wide.reason) == (2.5, ANGLE[2], 2.0, "why")
    assert wide.fraction_of_tolerance == pytest.approx(1.25)
    widened = check_of("position", "P", error[:2], ANGLE[:2], Tolerance(0.5, "m", "why", 1), conditioning[:2])
    assert (widened.worst, widened.tolerance) == (1.0, 0.5)
    narrow = check_of(
        "position", "P", error[1:2], ANGLE[1:2], Tolerance(2.0, "m", "why", 1), conditioning[1:2]
    )
    assert (narrow.worst, narrow.tolerance, narrow.passed) == (3.0, 8.0, True)
    assert narrow.reason.startswith("why; x 4 ")


def test_a_tolerance_of_zero_is_exceeded_by_any_error():
    none = Tolerance(0.0, "m", "")
    assert check_of("loop", "", np.zeros(N), ANGLE, none).passed
    off = np.array([0.0, 0.0, 1e-300, 0.0, 0.0])
    check = check_of("loop", "", off, ANGLE, none)
    assert (check.passed, check.instant, check.fraction_of_tolerance) == (False, ANGLE[2], None)
    verdict = concluded([check])
    assert verdict.outcome == "failed"
    assert verdict.reason == "beyond the tolerance: loop residual by 1e-300 m where none is allowed"


def test_a_failed_verdict_lists_at_most_three_quantities():
    beyond = [
        check_of("loop", "", k * UNIT, ANGLE, Tolerance(0.5, "m", "")) for k in (1.0, 2.0, 3.0, 4.0, 5.0)
    ]
    within = check_of("loop", "", 0.1 * UNIT, ANGLE, Tolerance(0.5, "m", ""))
    assert concluded([within]) == Verdict("passed", (within,))
    assert concluded([within], lambda: 1.0).outcome == "passed"
    names = "loop residual by 2 times, loop residual by 4 times, loop residual by 6 times"
    assert concluded([*beyond[:3], within]).reason == f"beyond the tolerance: {names}"
    assert concluded([within, *beyond]).reason == f"beyond the tolerance: {names} and 2 more"
    assert concluded(beyond[:4]).reason == f"beyond the tolerance: {names} and 1 more"
    assert concluded(beyond, lambda: None).outcome == "failed"
    moved = concluded(beyond, lambda: 1.23456)
    assert (moved.outcome, moved.reason) == ("changed assembly", "first seen at crank angle 1.2346 rad")
    undefined = check_of("loop", "", np.nan * UNIT, ANGLE, Tolerance(0.5, "m", ""))
    assert concluded([within, undefined]).outcome == "diverged"
    assert within.passed
    assert concluded([within]).passed
    assert not concluded(beyond).passed


@pytest.mark.parametrize(("error", "relation"), [(0.25, "<="), (1.0, "> "), (np.nan, "? ")])
def test_a_verdict_prints_its_checks_with_their_relation(error, relation):
    check = check_of("loop", "", error * UNIT, ANGLE, Tolerance(0.5, "m", "why"))
    assert f"{relation}  5.0e-01 m" in str(check)
    assert str(concluded([check])).endswith(f"\n  {check}")
    assert check.fraction_of_tolerance == (None if np.isnan(error) else 2.0 * error)


def test_a_method_has_the_tolerances_of_its_own_quantities():
    rows = [QUANTITIES[name] for name in ("position", "acceleration", "accelerations under these forces")]
    scales = {**motion_scales(0.5, 2.0, 0.8), "1": 1.0}
    assert set(tolerances_of(rows, "closed form", scales, Requested())) == {"acceleration"}


def test_a_tolerance_can_have_its_own_scale():
    row = replace(QUANTITIES["position"], bounds={"pose": ToleranceRule("", 1e-3, scale="reach")})
    assert tolerances_of([row], "pose", motion_scales(0.5, 2.0, 0.8), Requested())["position"].value == 0.8e-3
    # of 0.5 m, to which no request adds anything
    row = replace(row, bounds={"pose": ToleranceRule("", 1e-3, requested=1.0)})
    assert tolerances_of([row], "pose", motion_scales(0.5, 2.0, 0.8), Requested())["position"].value == 0.5e-3


# scales


def test_scales_of_a_motion_are_products_of_its_lengths_and_speeds():
    scales = motion_scales(0.5, 3.0, 0.8, 2.0)
    assert scales["stroke"] == 0.5
    assert scales["stroke · crank speed"] == 1.5
    assert scales["stroke · crank speed²"] == 4.5
    assert (scales["reach"], scales["reach · crank speed"]) == (0.8, pytest.approx(2.4))
    assert scales["reach · crank speed²"] == pytest.approx(7.2)
    assert (scales["crank speed"], scales["rad"]) == (3.0, 1.0)
    assert motion_scales(0.5, 3.0)["reach"] == 0.5
    assert motion_scales(0.5, 0.4)["stroke · crank speed²"] == pytest.approx(0.08)
    assert motion_scales(0.5, 3.0, 0.8, 20.0)["stroke · crank speed²"] == 10.0


def moving(path, **more):
    return Motion("closed form", ANGLE, UNIT, 0.0 * UNIT, {"P": PointMotion(path, FLAT, FLAT)}, **more)


def test_stroke_and_reach_of_a_path_are_its_extents():
    path = np.outer(np.linspace(-1.0, 3.0, N), (0.5, -1.0, 0.2))
    assert stroke_of(moving(path)) == pytest.approx(2.0)
    assert reach_of(moving(path)) == pytest.approx(3.0)
    # without motion the largest coordinate replaces the stroke
    assert stroke_of(moving(FLAT + np.array([0.1, -0.7, 0.2]))) == pytest.approx(0.7)
    # a crank of length 0 keeps all points at the origin: tolerances are those of a mechanism of 1 m
    assert stroke_of(moving(0.0 * FLAT)) == reach_of(moving(0.0 * FLAT)) == 1.0


@pytest.mark.parametrize(("off", "same"), [(8e-13, True), (2e-12, False), (-2.0 * ANGLE, False)])
def test_crank_angles_of_records_may_differ_by_rounding(off, same):
    path = np.outer(np.linspace(-1.0, 3.0, N), (0.5, -1.0, 0.2))
    exact = replace(moving(path), angle=ANGLE + off)
    if same:
        assert crosscheck(moving(path), exact).passed
    else:
        with pytest.raises(InputError, match="has other crank angles"):
            crosscheck(moving(path), exact)


def forces_of(force, torque=(3.0, -4.0, 0.0, 0.0, 0.0), **more):
    stated = {"torque": np.array(torque), "kinetic": np.array([-2.0, 1.0, 0.0, 0.0, 0.0])}
    return force_record(ANGLE, force, characteristic_length=0.2, speed=-5.0 * UNIT, **stated, **more)


def test_scales_of_forces_are_root_mean_squares():
    result = forces_of(FLAT + np.array([2.0, 0.0, 1.5]), potential=np.array([1.0, -7.0, 0.0, 0.0, 0.0]))
    scales, torque = force_scales(result), np.sqrt(5.0)
    assert scales["torque"] == pytest.approx(torque)
    assert (scales["force"], scales["moment"]) == pytest.approx((2.5, 0.5))
    assert (scales["kinetic energy"], scales["potential energy"]) == (2.0, 7.0)
    assert scales["power"] == pytest.approx(5.0 * torque)
    assert scales["1"] == 1.0


def test_zero_forces_and_torques_have_a_nonzero_scale():
    idle = force_scales(forces_of(FLAT, torque=np.zeros(N)))
    assert idle["torque"] == pytest.approx(2e-3)
    assert idle["force"] == pytest.approx(2e-3 / 0.2)


# verdicts


def off_by(distance, **more):
    return moving(PATH + distance * np.array([0.0, 0.6, 0.8]), **more)


PATH = np.outer(np.linspace(-1.0, 1.0, N), (1.0, 0.0, 0.0))
EXACT = moving(PATH)
BAR = LinkMotion(PATH, np.broadcast_to(np.eye(3), (N, 3, 3)), FLAT, FLAT, FLAT, FLAT)
# requested tolerances and their limits for a stroke of one metre; default a ten-thousandth
TOLERANCES = ((1e-3, 1e-3), (None, 1e-4), (2e-6, 2e-6))


@pytest.mark.parametrize(("tolerance", "limit"), TOLERANCES)
def test_a_stepped_motion_has_the_requested_or_default_tolerance(tolerance, limit):
    simulated = replace(EXACT, source="step")
    exact = replace(EXACT, source="closed form")
    for distance, passed in ((0.99 * limit, True), (1.01 * limit, False)):
        result = replace(simulated, points=off_by(distance).points)
        verdict = crosscheck(result, exact, tolerance=tolerance)
        assert verdict.passed == passed
        assert verdict.checks[0].worst == pytest.approx(distance)
        assert verdict.checks[0].tolerance == pytest.approx(limit)


@pytest.mark.parametrize(("source", "limit"), [("step", 3e-3), ("pose", None)])
def test_the_tolerance_of_a_stepped_run_applies(source, limit):
    exact = replace(EXACT, source="closed form")
    run = SimpleNamespace(motion=replace(EXACT, source=source), tolerance=3e-3, outcome="passed")
    positions, alone = (crosscheck(item, exact).checks[0].tolerance for item in (run, run.motion))
    assert positions == (alone if limit is None else pytest.approx(limit))
    assert crosscheck(run, exact, tolerance=0.2).checks[0].tolerance == pytest.approx(0.2)


def test_solved_configurations_have_a_tolerance_of_rounding():
    exact, solved = replace(EXACT, source="closed form"), replace(EXACT, source="pose")
    close = replace(solved, points=off_by(1e-9).points)
    assert crosscheck(solved, exact).passed
    assert not crosscheck(close, exact).passed
    assert crosscheck(close, exact, tolerance=1e-8).passed


def test_tolerances_widen_by_the_worse_conditioning_of_both_motions():
    class Solver:
        def __init__(self, reported=None, links=True):
            self.exact = replace(
                EXACT, source="loop equations", conditioning=reported, links={"a": BAR} if links else {}
            )

        def solve(self, *_):
            return self.exact

        def conditioning(self, exact):
            return 0.25 * WELL_CONDITIONED * UNIT

    simulated = replace(EXACT, source="step", conditioning=0.5 * WELL_CONDITIONED * UNIT)
    power = QUANTITIES["velocity"].bounds["step"].power

    def widened(solver):
        check = next(item for item in crosscheck(simulated, solver).checks if item.kind == "velocity")
        sound = crosscheck(replace(simulated, conditioning=None), Solver(WELL_CONDITIONED * UNIT)).checks
        return check.tolerance / next(item.tolerance for item in sound if item.kind == "velocity")

    assert widened(Solver(0.125 * WELL_CONDITIONED * UNIT)) == pytest.approx(8.0**power)
    assert widened(Solver(WELL_CONDITIONED * UNIT)) == pytest.approx(2.0**power)
    assert widened(Solver()) == pytest.approx(4.0**power)
    assert widened(Solver(links=False)) == pytest.approx(2.0**power)


def test_a_single_instant_of_another_speed_fails():
    names = ("angle", "speed", "acceleration")
    point = PointMotion(PATH[:1], FLAT[:1], FLAT[:1])
    item = replace(EXACT, points={"P": point}, **{name: getattr(EXACT, name)[:1] for name in names})
    assert crosscheck(replace(item, source="pose"), replace(item, source="closed form")).passed
    slow = crosscheck(
        replace(item, source="pose", speed=0.9 * item.speed), replace(item, source="closed form")
    )
    assert [check.kind for check in slow.checks if not check.passed] == ["drive speed"]


def test_the_drive_is_checked_if_its_speed_is_known():
    exact = replace(EXACT, source="closed form")
    time = (ANGLE - ANGLE[0]) / 1.0 + 7.0
    verdict = crosscheck(replace(EXACT, time=time), exact)
    assert verdict.passed
    assert {"drive", "drive speed"} <= {check.kind for check in verdict.checks}
    assert {check.kind for check in crosscheck(EXACT, exact).checks} >= {"drive speed"}
    uneven = replace(exact, speed=np.linspace(1.0, 1.1, N))
    assert not {"drive", "drive speed"} & {check.kind for check in crosscheck(EXACT, uneven).checks}
    fast = crosscheck(replace(EXACT, time=time, speed=1.5 * UNIT), exact, speed=1.5)
    assert {check.kind for check in fast.checks if not check.passed} == {"drive"}


@pytest.mark.parametrize("field", ["position", "velocity", "acceleration"])
def test_nonfinite_numbers_are_reported_as_a_diverged_run(field):
    exact, wild = replace(EXACT, source="closed form"), FLAT.copy()
    wild[3, 2] = np.inf
    broken = replace(EXACT, points={"P": replace(EXACT.points["P"], **{field: wild})})
    assert crosscheck(broken, exact).outcome == "diverged"
    for name in ("speed", "acceleration"):
        assert crosscheck(replace(EXACT, **{name: wild[:, 2]}), exact).outcome == "diverged"
    assert crosscheck(replace(EXACT, broken="why"), exact).reason == "why"


def test_forces_have_the_tolerance_of_their_method():
    exact = forces_of(FLAT + 1.0)
    for route, limit in (("pose", 1e-10), ("step", 1e-6)):
        for fraction, passed in ((0.99, True), (1.01, False)):
            result = replace(exact, torque=exact.torque + fraction * limit * np.sqrt(5.0))
            assert crosscheck_forces(result, exact, method=route).passed == passed


def test_the_largest_error_is_relative_to_its_scale():
    row = QUANTITIES["kinetic energy"]
    exact = forces_of(FLAT)
    result = replace(exact, kinetic=exact.kinetic + np.linspace(0.0, 0.5, N))
    assert row.largest(result, exact, {"kinetic energy": 2.0}) == pytest.approx(0.25)
    silent = replace(row, error=lambda *_: None)
    assert silent.largest(result, exact, {"kinetic energy": 2.0}) == 0.0
    assert EPS == 2.0**-52


def test_the_most_severe_of_several_verdicts_gives_the_reason():
    fine, failed_checks = Verdict("passed", ()), Verdict("failed", (), "beyond the tolerance")
    verdict = combined({"pose": fine, "step": failed_checks})
    assert (verdict.outcome, verdict.reason) == ("failed", "step: beyond the tolerance")
    assert combined({"pose": fine, "step": fine}).reason == ""
