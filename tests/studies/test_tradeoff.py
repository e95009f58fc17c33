"""The ladder measured for real, on short budgets: points, fronts, references, the command and its files."""

import csv
import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mechsim import catalog
from mechsim.cli import main
from mechsim.model.scene import LEVELS, Scene
from mechsim.simulation.mjcf.alternatives import rod_of
from mechsim.simulation.settings import INTEGRATORS
from mechsim.studies.tradeoff import (
    BOUNDS,
    COMPARED,
    DEFAULTS,
    STEPS,
    Build,
    Tradeoff,
    build_model,
    families,
    measure,
    subject_of,
    subject_of_model,
)
from mechsim.studies.tradeoff.ladder import HARD, cuts_of

SPEED = 20.0 * np.pi
SHORT = (72, 288)


@pytest.fixture(scope="module")
def found() -> Tradeoff:
    return measure(subject_of(catalog.make("rssr"), SPEED), budget=90.0, steps=SHORT)


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
    names = [family.name for family in families(catalog.make("rssr").mechanism)]
    assert len(set(names)) == len(names)
    for integrator in INTEGRATORS:
        assert sum(name.startswith(f"{integrator},") for name in names) >= 8
    assert sum("cut" in name for name in names) == len(cuts_of(catalog.make("rssr").mechanism)) - 1


def test_the_ladder_covers_drives_levels_and_reductions():
    subject = subject_of(catalog.make("rssr"), SPEED)
    builds = [family.build for family in families(subject.mechanism, subject.variants)]
    assert {build.drive for build in builds} == {"flywheel", "geared", "servo"}
    assert {build.level for build in builds} == set(LEVELS)
    assert {build.rod for build in builds} == {None, "coupler"}
    assert {build.variant for build in builds} == {None, "guided"}
    assert {build.drive for build in (family.build for family in families())} == {
        "flywheel",
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
    usual, geared = built(HARD), built("geared crank")
    assert geared["drive"] < 1e-12
    assert geared["position"] == pytest.approx(usual["position"], rel=1e-3)


def test_a_servo_lags_and_the_points_are_judged_where_the_crank_is(built):
    servo = built(f"{HARD}, servo")
    assert 1e-3 < servo["drive"] < 0.1
    assert servo["position"] < 1e-7
    # the torque of the servo belongs to the acceleration too
    assert servo["acceleration"] < 1e-6
    assert built("implicitfast, 2 steps, servo")["drive"] < 1e-5


def test_levels_move_alike_and_a_guided_coupler_too(built):
    usual = built(HARD)
    for suffix in ("level pose", "level dynamics", "level picture", "guided"):
        assert built(suffix)["position"] == pytest.approx(usual["position"], rel=0.2)


def test_a_rod_that_is_only_a_length_is_stretched_and_says_so(built):
    lazy, quick = (built(f"{start}, coupler as a length") for start in (HARD, "2 steps, 1e-08"))
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
    from mechsim.simulation.closed_model import assembled

    own = subject_of_model(assembled(drive.mechanism, Scene()), "own", SPEED)
    known = subject_of(drive, SPEED)
    assert own.stroke == pytest.approx(known.stroke, rel=1e-3)
    assert own.reference.bar["position"] < 1e-10
    settings = families()[1].at(144, SPEED)
    motion, _ = known.built.motion(settings)
    for kind in COMPARED[:3]:
        gap = abs(own.errors(motion)[kind] * own.stroke / known.stroke - known.errors(motion)[kind])
        assert gap <= own.reference.bar[kind] + 1e-12 + 1e-3 * known.errors(motion)[kind]


def test_drives_are_added_to_a_model_that_has_a_motor_of_its_own():
    from mechsim.simulation.closed_model import assembled

    spec = assembled(catalog.make("four_bar").mechanism, Scene())
    trntype = mujoco.mjtTrn.mjTRN_JOINT
    spec.add_actuator(name="motor", target="rocker", trntype=trntype)
    own = subject_of_model(spec, "own", SPEED)
    for drive, lag in (("geared", 1e-12), ("servo", 0.1)):
        built = build_model(own.source, own.built.profile, SPEED, Build(drive=drive, gain=0.5))
        motion, _ = built.motion(families()[1].at(144, SPEED))
        errors = own.errors(motion)
        assert errors["drive"] < lag
        assert errors["loop"] < 1e-5


def test_the_seed_settles_which_trials_a_short_budget_leaves_out():
    subject = subject_of(catalog.make("slider_crank"), SPEED)
    quick = measure(subject, budget=1e-6, steps=SHORT, seed=1)
    assert len(quick.points) == 1
    again = measure(subject, budget=1e-6, steps=SHORT, seed=1)
    assert [p.as_dict()["family"] for p in again.points] == [p.as_dict()["family"] for p in quick.points]


def test_the_command_writes_table_plot_and_json(tmp_path, capsys):
    table, plot = tmp_path / "out.csv", tmp_path / "out.svg"
    words = ("slider_crank", "--budget", "1.5s", "--json", "-o", str(table), "--plot", str(plot))
    assert run("tradeoff", *words) == 0
    result = json.loads(capsys.readouterr().out)
    assert [one["bound"] for one in result["recommended"]] == list(BOUNDS)
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
