"""Trade-off measurements on short budgets: points, fronts, references, the command and its files."""

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
from mechsim.model.scene import Scene
from mechsim.simulation.settings import Settings
from mechsim.studies.budget import Budget, TrialTimes
from mechsim.studies.tradeoff import trials
from mechsim.studies.tradeoff.methods import (
    DEFAULTS,
    LOW_COMPLIANCE,
    STEPS,
    BuiltModel,
    stepping_methods,
)
from mechsim.studies.tradeoff.subject import COMPARED, Subject, subject_of, subject_of_model
from mechsim.studies.tradeoff.trials import measure_tradeoff
from mechsim.studies.tradeoff.work_precision import BOUNDS, Tradeoff

SPEED = 20.0 * np.pi
SHORT = (72, 288)


@pytest.fixture(scope="module")
def tradeoff() -> Tradeoff:
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


@pytest.mark.long
def test_all_points_are_measured_and_the_front_is_timed_again(tradeoff):
    assert tradeoff.left_out == 0
    assert {point.settings.steps_per_turn for point in tradeoff.points} == set(SHORT)
    assert all(len(point.times) == 5 for point in tradeoff.front())
    assert (tradeoff.costs > 0.0).all()


def test_rk4_has_fourth_order_and_the_defaults_first(tradeoff):
    hard = tradeoff.order(tradeoff.curves()["RK4, turn/5, 1e-08"])
    assert hard is not None
    assert 3.0 < hard.order < 5.0
    compliant = tradeoff.order(tradeoff.curves()[DEFAULTS])
    assert compliant is not None
    assert compliant.order < 1.5


def test_the_recommended_point_is_the_cheapest_within_its_bound(tradeoff):
    for limit in BOUNDS:
        point = tradeoff.choice(limit)
        if point is None:
            assert (tradeoff.errors() > limit).all()
            continue
        assert point.errors["position"] <= limit
        assert point.cost == tradeoff.costs[tradeoff.errors() <= limit].min()


def test_a_diverged_motion_satisfies_no_bound(tradeoff):
    without_motion = tradeoff.subject.errors(None)
    assert all(error == np.inf for error in without_motion.values())
    motion, _ = tradeoff.subject.built.motion(tradeoff.points[0].settings)
    assert all(error < np.inf for error in tradeoff.subject.errors(motion).values())
    diverged = tradeoff.subject.errors(replace(motion, speed=1e9 * motion.speed))
    assert all(error == np.inf for error in diverged.values())


def test_a_fine_reference_run_agrees_with_the_closed_form():
    linkage = catalog.make("four_bar")
    from mechsim.simulation.source import assembled

    own = subject_of_model(assembled(linkage.mechanism, Scene()), "own", SPEED)
    closed_form = subject_of(linkage, SPEED)
    assert own.stroke == pytest.approx(closed_form.stroke, rel=1e-3)
    assert own.reference.own_error["position"] < 1e-10
    settings = stepping_methods()[1].settings(144, SPEED)
    motion, _ = closed_form.built.motion(settings)
    for kind in COMPARED[:3]:
        gap = abs(
            own.errors(motion)[kind] * own.stroke / closed_form.stroke - closed_form.errors(motion)[kind]
        )
        assert gap <= own.reference.own_error[kind] + 1e-12 + 1e-3 * closed_form.errors(motion)[kind]


@pytest.mark.parametrize(
    ("actuated", "rejection"),
    [
        (["input"], None),
        ([], "names? joints by --drive"),
        (["input", "rocker"], "remove the other actuators"),
    ],
)
def test_the_hinge_of_the_only_actuator_is_the_driver(actuated, rejection):
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    spec.joint("crank").name = "input"
    for joint in actuated:
        spec.add_actuator(name=f"on {joint}", target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    if rejection:
        with pytest.raises(InputError, match=rejection):
            subject_of_model(spec, "own", SPEED)
        return
    own = subject_of_model(spec, "own", SPEED)
    motion, _ = own.built.motion(stepping_methods()[1].settings(144, SPEED))
    assert own.errors(motion)["loop"] < 1e-5


def test_the_seed_determines_the_trials_of_a_short_budget():
    subject = subject_of(catalog.make("slider_crank"), SPEED)
    stiff = measure_tradeoff(subject, budget=1e-6, steps=SHORT, seed=1)
    assert {point.method.name for point in stiff.points} == {LOW_COMPLIANCE}
    repeated = measure_tradeoff(subject, budget=1e-6, steps=SHORT, seed=1)
    assert [p.as_dict()["method"] for p in repeated.points] == [p.as_dict()["method"] for p in stiff.points]


@pytest.mark.usefixtures("fast_timers")
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
def test_invalid_input_gives_one_line(words, capsys):
    assert run("tradeoff", *words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.strip().splitlines()) == 1


SLIDER = subject_of(catalog.make("slider_crank"), SPEED)


class SimulatedProcessor:
    """Simulated wall clock and processor time that advance only with work."""

    def __init__(self, monkeypatch, share: float, step: float) -> None:
        self.processor, self.share, self.step = 0.0, share, step
        monkeypatch.setattr(BuiltModel, "motion", self.motion)
        monkeypatch.setattr(BuiltModel, "stepped", lambda _, settings: (None, Spent(self.stepped(settings))))
        monkeypatch.setattr(Subject, "errors", lambda _, n: dict.fromkeys(COMPARED, n**-4.0))

    def budget(self, seconds: float) -> Budget:
        """Return a budget measured by these two times."""
        wall, processor = (lambda: self.share * self.processor), (lambda: self.processor)
        return Budget(seconds, start=0.0, now=wall, processor=processor)

    def stepped(self, settings: Settings) -> float:
        # an implicit integrator can be more expensive than the first one tried; others are cheaper
        relative_cost = {"RK4": 1.0, "implicit": 1.5}.get(settings.integrator, 0.3)
        seconds = relative_cost * self.step * settings.steps_per_turn
        self.processor += seconds
        return seconds

    def motion(self, settings: Settings) -> tuple[int, float]:
        self.processor += 1e-2
        return settings.steps_per_turn, self.stepped(settings)


class Spent(NamedTuple):
    processor: float


@pytest.mark.parametrize(
    ("step", "share", "budget"),
    [(2e-5, 4.0, 2.0), (1e-3, 1.0, 20.0), (1e-3, 4.0, 2.0)],
)
def test_the_study_ends_within_a_fifth_of_the_budget(monkeypatch, budget, share, step):
    simulated = SimulatedProcessor(monkeypatch, share, step)
    # time of loading and building
    simulated.processor = 0.2
    tradeoff = measure_tradeoff(SLIDER, budget=simulated.budget(budget))
    assert 0.8 * budget < tradeoff.seconds < 1.2 * budget
    assert len(tradeoff.points) + tradeoff.left_out == len(STEPS) * len(stepping_methods())
    assert tradeoff.untried


def test_a_budget_below_the_loading_time_is_rejected():
    with pytest.raises(InputError, match=r"rssr took .* the budget is 0\.001 s; give --budget \d+s or more"):
        subject_of(catalog.make("rssr"), SPEED, Budget(0.001))


@pytest.mark.slow
def test_a_sufficient_budget_omits_no_trial(monkeypatch):
    simulated = SimulatedProcessor(monkeypatch, 1.0, 2e-5)
    tradeoff = measure_tradeoff(SLIDER, budget=simulated.budget(600.0))
    assert (tradeoff.left_out, tradeoff.untried) == (0, ())
    assert tradeoff.seconds < 300.0


def test_the_budget_limits_the_steps_of_the_reference(monkeypatch):
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    monkeypatch.setattr(TrialTimes, "expected", lambda _, integrator, steps: 1e-3 * steps)
    # 25.2 s for the finest, and 12 s available
    own = subject_of_model(spec, "own", SPEED, Budget(30.0, start=0.0, now=lambda: 0.0))
    assert own.reference.what == "a run of 2880 steps a turn"
    monkeypatch.undo()
    monkeypatch.setattr(trials, "stepping_methods", lambda: stepping_methods()[:4])
    tradeoff = measure_tradeoff(own, budget=90.0, steps=(72, 1440, 2880))
    assert {point.settings.steps_per_turn for point in tradeoff.points} == {72, 1440}
    assert tradeoff.left_out > 0


def test_a_budget_too_short_for_a_reference_is_rejected():
    from mechsim.simulation.source import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    with pytest.raises(InputError, match=r"own took .* the budget is 0\.001 s; give --budget \d+s or more"):
        subject_of_model(spec, "own", SPEED, Budget(1e-3))


def four_bar_with_stiff_leaf():
    """Return a four-bar next to a leaf on a hinge too stiff for explicit steps."""
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
def test_a_diverging_reference_is_rejected_with_a_remedy(monkeypatch, budget, advice):
    monkeypatch.setattr(TrialTimes, "expected", lambda _, integrator, steps: 1e-5 * steps)
    most = "14,400" if budget is None else "7,200"
    with pytest.raises(InputError, match=rf"own diverges at {most} steps a turn with RK4, so .* {advice}"):
        subject_of_model(
            four_bar_with_stiff_leaf(),
            "own",
            SPEED,
            None if budget is None else Budget(budget, start=0.0, now=lambda: 0.0),
        )
