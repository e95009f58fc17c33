"""Trade-off measurements on short budgets: points, fronts, references, the command and its files."""

import csv
import json
import shlex
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import mechsim as ms
from mechsim import catalog
from mechsim.numerics.resources import Budget
from mechsim.studies.tradeoff import methods
from mechsim.studies.tradeoff.work_precision import BOUNDS, Tradeoff, command_of, measure_tradeoff

SPEED = 20.0 * np.pi
SHORT = (72, 288)


@pytest.fixture(scope="module")
def tradeoff() -> Tradeoff:
    return measure_tradeoff(methods.subject_of(catalog.make("rssr"), SPEED), budget=90.0, steps=SHORT)


@pytest.mark.long
def test_all_points_are_measured_and_the_front_is_timed_again(tradeoff):
    assert tradeoff.left_out == 0
    assert {point.settings.steps_per_turn for point in tradeoff.points} == set(SHORT)
    assert all(len(point.times) == 5 for point in tradeoff.front())
    assert (tradeoff.costs > 0.0).all()


@pytest.mark.long
def test_rk4_has_fourth_order_and_the_defaults_first(tradeoff):
    hard = tradeoff.order(tradeoff.curves()["RK4, turn/5, 1e-08"])
    assert 3.0 < hard.order < 5.0
    compliant = tradeoff.order(tradeoff.curves()[methods.DEFAULTS])
    assert compliant.order < 1.5


@pytest.mark.long
def test_the_recommended_point_is_the_cheapest_within_its_bound(tradeoff):
    for limit in BOUNDS:
        point = tradeoff.choice(limit)
        if point is None:
            assert (tradeoff.errors() > limit).all()
            continue
        assert point.errors["position"] <= limit
        assert point.cost == tradeoff.costs[tradeoff.errors() <= limit].min()


@pytest.mark.long
def test_a_diverged_motion_satisfies_no_bound(tradeoff):
    without_motion = tradeoff.subject.errors(None)
    assert all(error == np.inf for error in without_motion.values())
    motion, _ = tradeoff.subject.built.motion(tradeoff.points[0].settings)
    assert all(error < np.inf for error in tradeoff.subject.errors(motion).values())
    diverged = tradeoff.subject.errors(replace(motion, speed=1e9 * motion.speed))
    assert all(error == np.inf for error in diverged.values())


def test_the_seed_determines_the_trials_of_a_short_budget():
    subject = methods.subject_of(catalog.make("slider_crank"), SPEED)
    stiff = measure_tradeoff(subject, budget=1e-6, steps=SHORT, seed=1)
    assert {point.method.name for point in stiff.points} == {methods.LOW_COMPLIANCE}
    repeated = measure_tradeoff(subject, budget=1e-6, steps=SHORT, seed=1)
    assert [p.as_dict()["method"] for p in repeated.points] == [p.as_dict()["method"] for p in stiff.points]


def test_motion_laws_are_stepped_and_the_recommended_command_repeats_them(mechsim):
    subject = methods.subject_of(ms.load("five_bar"), SPEED)
    (point,) = measure_tradeoff(subject, budget=1e-6, steps=(720,)).points
    # of the fourth order: 4e-7 at 72 steps; the drive follows its law with the second, 2e-4 at 72
    assert all(point.errors[name] < (1e-5 if name == "drive" else 1e-8) for name in methods.COMPARED)
    motion, _ = subject.built.motion(point.settings)
    assert motion is not None
    driven = motion.joints["left"]
    late = replace(motion, joints=motion.joints | {"left": replace(driven, value=driven.value + 1e-3)})
    # only the driver is displaced, from its law and from the loops
    assert subject.errors(late)["drive"] == pytest.approx(1e-3, rel=1e-3)
    assert subject.errors(late)["position"] > 1e-4
    answer = mechsim(*shlex.split(command_of(point, "five_bar", subject))[1:], "--json")
    run = json.loads(answer.out)
    assert run["steps"] == pytest.approx(720 * subject.built.profile.turns, abs=1.0)
    assert run["estimate"] == pytest.approx(point.errors["position"] * subject.stroke, rel=0.5)


@pytest.mark.long
@pytest.mark.usefixtures("fast_timers")
def test_the_command_writes_table_plot_and_json(tmp_path, mechsim):
    table, plot = tmp_path / "out.csv", tmp_path / "out.svg"
    words = ("slider_crank", "--budget", "2.5s", "--json", "-o", str(table), "-o", str(plot))
    answer = mechsim("tradeoff", *words)
    assert answer.code == 0
    result = json.loads(answer.out)
    assert [item["limit"] for item in result["recommended"]] == list(BOUNDS)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == result["trials"]
    assert sum(row["pareto"] == "True" for row in rows) == len(result["pareto"])
    assert sum(row["defaults"] == "True" for row in rows) >= 1
    assert b"<svg" in plot.read_bytes()


SLIDER = methods.subject_of(catalog.make("slider_crank"), SPEED)


def test_no_trial_begins_after_the_budget(monkeypatch):
    now = [0.0]

    def motion(self, settings):
        now[0] += 1.0
        return settings.steps_per_turn, 1e-5 * settings.steps_per_turn

    monkeypatch.setattr(methods.BuiltModel, "motion", motion)
    monkeypatch.setattr(
        methods.BuiltModel, "stepped", lambda self, settings: (None, Spent(motion(self, settings)[1]))
    )
    monkeypatch.setattr(methods.Subject, "errors", lambda _, n: dict.fromkeys(methods.COMPARED, n**-4.0))
    tradeoff = measure_tradeoff(SLIDER, budget=Budget(50.0, start=0.0, now=lambda: now[0]))
    # three fifths for the trials, of a second each, and the rest for timing them again
    assert len(tradeoff.points) == 31
    assert len(tradeoff.points) + tradeoff.left_out == len(methods.STEPS) * len(methods.stepping_methods())
    assert tradeoff.untried
    assert tradeoff.seconds == 50.0


class Spent(NamedTuple):
    processor: float
