"""The ladder measured for real, on short budgets: points, fronts, references, the command and its files."""

import csv
import json
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from mechsim import catalog
from mechsim.cli import main
from mechsim.errors import InputError
from mechsim.model.scene import LEVELS, Scene
from mechsim.simulation.mjcf.alternatives import rod_of
from mechsim.simulation.plain_settings import INTEGRATORS
from mechsim.simulation.settings import Settings
from mechsim.simulation.source import from_spec
from mechsim.studies.budget import Budget, TrialTimes
from mechsim.studies.tradeoff import trials
from mechsim.studies.tradeoff.methods import (
    DEFAULTS,
    LOW_COMPLIANCE,
    STEPS,
    Build,
    BuiltModel,
    build_model,
    possible_cuts,
    stepping_methods,
)
from mechsim.studies.tradeoff.subject import COMPARED, Subject, subject_of, subject_of_model
from mechsim.studies.tradeoff.trials import measure_tradeoff
from mechsim.studies.tradeoff.work_precision import BOUNDS, Tradeoff

SPEED = 20.0 * np.pi
SHORT = (72, 288)


@pytest.fixture(scope="module")
def found() -> Tradeoff:
    return measure_tradeoff(subject_of(catalog.make("rssr"), SPEED), budget=90.0, steps=SHORT)


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main_with(words)
    return ended.value.code or 0


def main_with(words):
    import sys

    before, sys.argv = sys.argv, ["mechsim", *words]
    try:
        main()
    finally:
        sys.argv = before


def test_every_family_has_its_own_name_and_every_integrator_several():
    names = [method.name for method in stepping_methods(catalog.make("rssr").mechanism)]
    assert len(set(names)) == len(names)
    for integrator in INTEGRATORS:
        assert sum(name.startswith(f"{integrator},") for name in names) >= 8
    assert sum("cut" in name for name in names) == len(possible_cuts(catalog.make("rssr").mechanism)) - 1


def test_the_ladder_covers_drives_levels_and_reductions():
    subject = subject_of(catalog.make("rssr"), SPEED)
    builds = [method.build for method in stepping_methods(subject.mechanism, subject.variants)]
    assert {build.crank_drive for build in builds} == {"drive_inertia", "geared", "servo"}
    assert {build.level for build in builds} == set(LEVELS)
    assert {build.rod for build in builds} == {None, "coupler"}
    assert {build.variant for build in builds} == {None, "guided"}
    assert {build.crank_drive for build in (method.build for method in stepping_methods())} == {
        "drive_inertia",
        "geared",
        "servo",
    }


@pytest.fixture(scope="module")
def built(found):
    def curve(suffix: str) -> dict[str, float]:
        (points,) = (points for name, points in found.curves().items() if name.endswith(suffix))
        return points[-1].errors

    return curve


def test_a_geared_crank_is_as_good_as_a_flywheel_on_it(built):
    usual, geared = built(LOW_COMPLIANCE), built("geared crank")
    assert geared["drive"] < 1e-12
    assert geared["position"] == pytest.approx(usual["position"], rel=1e-3)


def test_a_servo_lags_and_the_points_are_checked_where_the_crank_is(built):
    servo = built(f"{LOW_COMPLIANCE}, servo")
    assert 1e-3 < servo["drive"] < 0.1
    assert servo["position"] < 1e-7
    # the torque of the servo belongs to the acceleration too
    assert servo["acceleration"] < 1e-6
    assert built("implicitfast, 2 steps, servo")["drive"] < 1e-5


def test_levels_move_alike_and_a_guided_coupler_too(built):
    usual = built(LOW_COMPLIANCE)
    for suffix in ("level pose", "level dynamics", "level picture", "guided"):
        assert built(suffix)["position"] == pytest.approx(usual["position"], rel=0.2)


def test_a_rod_that_is_only_a_length_is_stretched_and_reports_so(built):
    lazy, quick = (built(f"{start}, coupler as a length") for start in (LOW_COMPLIANCE, "2 steps, 1e-08"))
    assert lazy["loop"] > 0.1
    assert quick["loop"] < 0.01
    for errors in (lazy, quick):
        assert 0.5 * errors["loop"] < errors["position"] < 2.0 * errors["loop"]


@pytest.mark.parametrize(
    ("name", "rod"), [("slider_crank", "rod"), ("rrsrr", None), ("looper", None), ("bennett", None)]
)
def test_only_a_rod_between_two_like_joints_is_a_length(name, rod):
    assert rod_of(catalog.make(name).mechanism) == rod


def test_steps_record_the_same_instants():
    assert all(72 % n == 0 or n % 72 == 0 for n in STEPS)


def test_all_points_were_measured_and_the_good_ones_timed_again(found):
    assert found.left_out == 0
    assert {point.settings.steps_per_turn for point in found.points} == set(SHORT)
    assert all(len(point.times) == 5 for point in found.front())
    assert (found.costs > 0.0).all()


def test_the_front_rises_in_cost_and_falls_in_error(found):
    front = found.front()
    assert (np.diff([point.cost for point in front]) > 0.0).all()
    assert (np.diff([point.errors["position"] for point in front]) < 0.0).all()
    assert front[-1].settings.integrator == "RK4"


def test_fourth_order_where_it_is_claimed_and_none_in_the_defaults(found):
    hard = found.order(found.curves()["RK4, turn/5, 1e-08"])
    assert hard is not None
    assert 3.0 < hard.order < 5.0
    lazy = found.order(found.curves()[DEFAULTS])
    assert lazy is not None
    assert lazy.order < 1.5


def test_a_choice_keeps_its_bound_and_nothing_cheaper_does(found):
    for bound in BOUNDS:
        point = found.choice(bound)
        if point is None:
            assert (found.errors() > bound).all()
            continue
        assert point.errors["position"] <= bound
        assert point.cost == found.costs[found.errors() <= bound].min()


def test_no_bound_is_kept_by_a_motion_that_diverged(found):
    lost = found.subject.errors(None)
    assert all(error == np.inf for error in lost.values())
    motion, _ = found.subject.built.motion(found.points[0].settings)
    assert all(error < np.inf for error in found.subject.errors(motion).values())
    mad = found.subject.errors(replace(motion, speed=1e9 * motion.speed))
    assert all(error == np.inf for error in mad.values())


def test_a_finer_run_as_reference_agrees_with_the_closed_form_within_its_bar():
    drive = catalog.make("four_bar")
    from mechsim.simulation.source import assembled

    own = subject_of_model(assembled(drive.mechanism, Scene()), "own", SPEED)
    known = subject_of(drive, SPEED)
    assert own.stroke == pytest.approx(known.stroke, rel=1e-3)
    assert own.reference.own_error["position"] < 1e-10
    settings = stepping_methods()[1].settings(144, SPEED)
    motion, _ = known.built.motion(settings)
    for kind in COMPARED[:3]:
        gap = abs(own.errors(motion)[kind] * own.stroke / known.stroke - known.errors(motion)[kind])
        assert gap <= own.reference.own_error[kind] + 1e-12 + 1e-3 * known.errors(motion)[kind]


def test_drives_are_added_to_a_model_that_has_a_motor_of_its_own():
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    trntype = mujoco.mjtTrn.mjTRN_JOINT
    spec.add_actuator(name="motor", target="rocker", trntype=trntype)
    own = subject_of_model(spec, "own", SPEED)
    for drive, lag in (("geared", 1e-12), ("servo", 0.1)):
        built = build_model(own.source, own.built.profile, SPEED, Build(crank_drive=drive, gain=0.5))
        motion, _ = built.motion(stepping_methods()[1].settings(144, SPEED))
        errors = own.errors(motion)
        assert errors["drive"] < lag
        assert errors["loop"] < 1e-5


@pytest.mark.parametrize(
    ("acted", "refusal"),
    [
        (["input"], None),
        ([], "names? joints by --drive"),
        (["input", "rocker"], "remove the other actuators"),
    ],
)
def test_a_hinge_of_any_name_is_driven_where_one_actuator_acts_on_it(acted, refusal):
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    spec.joint("crank").name = "input"
    for joint in acted:
        spec.add_actuator(name=f"on {joint}", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    if refusal:
        with pytest.raises(InputError, match=refusal):
            subject_of_model(spec, "own", SPEED)
        return
    own = subject_of_model(spec, "own", SPEED)
    motion, _ = own.built.motion(stepping_methods()[1].settings(144, SPEED))
    assert own.errors(motion)["loop"] < 1e-5


def test_the_seed_settles_which_trials_a_short_budget_leaves_out():
    subject = subject_of(catalog.make("slider_crank"), SPEED)
    quick = measure_tradeoff(subject, budget=1e-6, steps=SHORT, seed=1)
    assert {point.method.name for point in quick.points} == {LOW_COMPLIANCE}
    again = measure_tradeoff(subject, budget=1e-6, steps=SHORT, seed=1)
    assert [p.as_dict()["method"] for p in again.points] == [p.as_dict()["method"] for p in quick.points]


@pytest.mark.usefixtures("fast_clock")
def test_the_command_writes_table_plot_and_json(tmp_path, capsys):
    table, plot = tmp_path / "out.csv", tmp_path / "out.svg"
    words = ("slider_crank", "--budget", "2.5s", "--json", "-o", str(table), "--plot", str(plot))
    assert run("tradeoff", *words) == 0
    result = json.loads(capsys.readouterr().out)
    assert [item["limit"] for item in result["recommended"]] == list(BOUNDS)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == result["trials"]
    assert sum(row["pareto"] == "True" for row in rows) == len(result["pareto"])
    assert sum(row["defaults"] == "True" for row in rows) >= 1
    assert b"<svg" in plot.read_bytes()


@pytest.mark.parametrize(
    "words",
    [
        ("no_such",),
        ("no_such.xml",),
        ("rssr", "--budget", "0s"),
        ("rssr", "--by", "luck"),
        ("rssr", "-o", "out.pdf"),
        ("rssr", "--set", "coupler=1um"),
    ],
)
def test_bad_input_is_one_line(words, capsys):
    assert run("tradeoff", *words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.strip().splitlines()) == 1


SLIDER = subject_of(catalog.make("slider_crank"), SPEED)


class DynamicModel:
    """A clock and a processor that only move when work is done, so many times as far and by so much each."""

    def __init__(self, monkeypatch, share: float, step: float, building: float) -> None:
        self.processor, self.share, self.step, self.building = 0.0, share, step, building
        monkeypatch.setattr(BuiltModel, "motion", self.motion)
        monkeypatch.setattr(BuiltModel, "stepped", lambda _, settings: (None, Spent(self.stepped(settings))))
        monkeypatch.setattr(trials, "build_model", self.built)
        monkeypatch.setattr(Subject, "errors", lambda _, n: dict.fromkeys(COMPARED, n**-4.0))

    def budget(self, seconds: float) -> Budget:
        """Return a budget by this clock and this processor."""
        wall, processor = (lambda: self.share * self.processor), (lambda: self.processor)
        return Budget(seconds, start=0.0, now=wall, processor=processor)

    def stepped(self, settings: Settings) -> float:
        # an implicit integrator may be more expensive than the first that is tried, others are cheaper
        dear = {"RK4": 1.0, "implicit": 1.5}.get(settings.integrator, 0.3)
        seconds = dear * self.step * settings.steps_per_turn
        self.processor += seconds
        return seconds

    def motion(self, settings: Settings) -> tuple[int, float]:
        self.processor += 1e-2
        return settings.steps_per_turn, self.stepped(settings)

    def built(self, source, profile, speed, build, variants):
        self.processor += self.building
        return replace(SLIDER.built, build=build, seconds=self.building)


class Spent(NamedTuple):
    processor: float


@pytest.mark.parametrize("budget", [2.0, 20.0])
@pytest.mark.parametrize("share", [1.0, 4.0])
@pytest.mark.parametrize(("step", "building"), [(2e-5, 0.05), (1e-3, 0.3)])
def test_the_clock_stops_within_a_fifth_of_the_budget_whatever_a_step_a_model_and_others_take(
    monkeypatch, budget, share, step, building
):
    machine = DynamicModel(monkeypatch, share, step, building)
    # loading and building come first
    machine.processor = 0.2
    found = measure_tradeoff(SLIDER, budget=machine.budget(budget))
    assert 0.8 * budget < found.seconds < 1.2 * budget
    assert len(found.points) + found.left_out + found.unbuilt == len(STEPS) * len(
        stepping_methods(SLIDER.mechanism, SLIDER.variants)
    )
    assert found.untried


def test_a_mechanism_for_which_loading_leaves_no_time_is_rejected_with_a_budget_that_would_do():
    with pytest.raises(InputError, match=r"rssr took .* the budget is 0\.001 s; give --budget \d+s or more"):
        subject_of(catalog.make("rssr"), SPEED, Budget(0.001))


def test_a_budget_that_is_long_enough_leaves_nothing_out(monkeypatch):
    machine = DynamicModel(monkeypatch, 1.0, 2e-5, 0.05)
    found = measure_tradeoff(SLIDER, budget=machine.budget(600.0))
    assert (found.left_out, found.untried) == (0, ())
    assert found.seconds < 300.0


def test_a_reference_is_as_fine_as_its_part_of_the_budget_allows_and_checks_nothing_finer(monkeypatch):
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    monkeypatch.setattr(TrialTimes, "expected", lambda _, build, integrator, steps: 1e-3 * steps)
    # 25.2 s for the finest, and 12 s to be had
    own = subject_of_model(spec, "own", SPEED, Budget(30.0, start=0.0, now=lambda: 0.0))
    assert own.reference.what == "a run of 2880 steps a turn"
    monkeypatch.undo()
    monkeypatch.setattr(trials, "stepping_methods", lambda *_: stepping_methods()[:4])
    found = measure_tradeoff(own, budget=90.0, steps=(72, 1440, 2880))
    assert {point.settings.steps_per_turn for point in found.points} == {72, 1440}
    assert found.left_out > 0


def test_a_budget_too_short_for_any_reference_is_rejected_with_one_that_would_do():
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    with pytest.raises(InputError, match=r"own took .* the budget is 0\.001 s; give --budget \d+s or more"):
        subject_of_model(spec, "own", SPEED, Budget(1e-3))


def stiff_beside_a_four_bar():
    """A four-bar, and next to it a leaf on so stiff a hinge that no run of explicit steps bears it."""
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    leaf = spec.worldbody.add_body(name="leaf", pos=[1.0, 0.0, 0.0])
    leaf.add_joint(name="leaf", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, 0.0, 1.0], stiffness=[1e7, 0, 0])
    leaf.add_geom(size=[0.01, 0.0, 0.0], pos=[0.03, 0.0, 0.0])
    leaf.joints[0].springref = 1.0
    return spec


@pytest.mark.parametrize(
    ("budget", "advice"),
    [
        (None, "possible remedies: less stiffness, or more damping or mass, in the moving bodies$"),
        (0.5, r"possible remedies: --budget \d+s has time for up to 14,400; else less stiffness"),
    ],
)
def test_a_reference_that_diverges_states_at_which_steps_and_what_may_help(monkeypatch, budget, advice):
    monkeypatch.setattr(TrialTimes, "expected", lambda _, build, integrator, steps: 1e-5 * steps)
    most = "14,400" if budget is None else "7,200"
    with pytest.raises(InputError, match=rf"own diverges at {most} steps a turn with RK4, so .* {advice}"):
        subject_of_model(
            stiff_beside_a_four_bar(),
            "own",
            SPEED,
            None if budget is None else Budget(budget, start=0.0, now=lambda: 0.0),
        )


def test_where_only_the_coarser_runs_diverge_a_longer_budget_is_named(monkeypatch):
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    monkeypatch.setattr(TrialTimes, "expected", lambda _, build, integrator, steps: 1e-3 * steps)
    whole = BuiltModel.motion
    monkeypatch.setattr(
        BuiltModel, "motion", lambda self, s: (None, 0.1) if s.steps_per_turn == 1440 else whole(self, s)
    )
    # 25.2 s are the part of about 63 s that is the reference's
    reported = r"at 1,440 steps a turn with RK4, though not at 2,880, .* --budget 6[34]s has time for .*"
    with pytest.raises(InputError, match=reported):
        subject_of_model(spec, "own", SPEED, Budget(30.0, start=0.0, now=lambda: 0.0))


@pytest.mark.parametrize(("reading", "trials_made"), [(41.0, 0), (20.0, 1)])
def test_a_budget_that_is_spent_midway_ends_at_once(monkeypatch, reading, trials_made):
    """A clock on which reading, compiling, starting and each trial take so long."""
    from mechsim.simulation.source import assembled
    from mechsim.studies.tradeoff import methods

    now, made, compiled = [0.0], [], []

    def taking(seconds, done, call):
        def slow(*given, **named):
            now[0] += seconds
            done.append(seconds)
            return call(*given, **named)

        return slow

    monkeypatch.setattr(Build, "made", taking(reading, [], Build.made))
    monkeypatch.setattr(methods, "from_spec", taking(5.0, compiled, from_spec))
    monkeypatch.setattr(BuiltModel, "motion", taking(20.0, made, BuiltModel.motion))
    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    with pytest.raises(InputError, match=r"own took \d+ s to load and build, but the budget is 40 s"):
        subject_of_model(spec, "own", SPEED, Budget(40.0, start=0.0, now=lambda: now[0]))
    assert (len(made), bool(compiled)) == (trials_made, reading < 40.0)
    assert now[0] <= 1.2 * 40.0
