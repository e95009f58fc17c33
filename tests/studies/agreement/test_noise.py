"""Measured tables: noise of the stated standard deviation passes, a systematic error fails with its cause."""

import json
import shlex

import jsonschema
import numpy as np
import pytest

import mechsim as ms
from mechsim import files
from mechsim.cli.schema import output_schema
from mechsim.errors import InputError
from mechsim.model.quantities import quantity
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import Candidate
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.agreement.noise import FALSE_ALARM

ANGLES = np.linspace(0.1, 6.2, 60)
SIGMA = 2e-5


def measured(
    path, model, columns, *, seed=1, edit=None, stated_deviation=SIGMA, without_deviation=(), **changed
):
    """Write a table of positions with normal errors of 20 um and their standard deviations."""
    random = np.random.default_rng(seed)
    motion = ms.catalog.make(model, **changed).solve(ANGLES)
    table = {"angle": ANGLES}
    for column in columns:
        point, axis = column.split(".")
        values = motion.points[point].position[:, "xyz".index(axis)]
        table[column] = values + SIGMA * random.standard_normal(len(ANGLES))
        if column not in without_deviation:
            table[f"{column} ±"] = np.full(len(ANGLES), stated_deviation)
    if edit is not None:
        edit(table)
    rows = [",".join(f"{value:.15g}" for value in row) for row in zip(*table.values(), strict=True)]
    path.write_text("\n".join([",".join(table), *rows]) + "\n")
    return path


def validated(path, model="four_bar", **options):
    return ms.validate(model, against=path, stepped=False, **options)


def test_a_rod_too_short_by_100_micrometres_fails_with_its_cause(tmp_path):
    columns = ("A.x", "A.y", "B.x")
    result = validated(measured(tmp_path / "short.csv", "slider_crank", columns, rod=0.1999), "slider_crank")
    assert not result.passed
    assert [check.passed for check in result.checks] == [True, False]
    assert (result.findings[0].kind, result.findings[0].what) == ("dimension", "rod")
    assert result.findings[0].certain
    assert result.findings[0].by == pytest.approx(-5e-4, rel=0.05)
    assert "not noise alone" in result.why


def test_a_systematic_error_below_one_standard_deviation_is_found(tmp_path):
    columns = ("B.x", "B.y", "C.x", "C.y")
    result = validated(measured(tmp_path / "short.csv", "four_bar", columns, seed=3, coupler=0.090986))
    noise = dict(result.measured)["B"]
    assert noise.total.passed
    assert not noise.smooth.passed
    assert result.findings[0].what == "coupler"


def test_causes_indistinguishable_in_noise_are_all_reported(tmp_path):
    result = validated(measured(tmp_path / "short.csv", "slider_crank", ("B.x",), rod=0.1999), "slider_crank")
    assert {(item.kind, item.what) for item in result.findings} == {("dimension", "rod"), ("frame", "x")}


@pytest.mark.slow
def test_a_single_wrong_row_is_reported(tmp_path):
    def spoil(table):
        table["B.x"][16] += 7 * SIGMA

    result = validated(measured(tmp_path / "row.csv", "four_bar", ("B.x", "B.y"), edit=spoil))
    assert not result.passed
    assert "row 17 of B" in result.why


@pytest.mark.long
def test_noise_above_the_stated_deviation_fails(tmp_path):
    assert not validated(
        measured(tmp_path / "a.csv", "four_bar", ("B.x", "B.y"), stated_deviation=SIGMA / 2)
    ).passed
    result = validated(measured(tmp_path / "b.csv", "four_bar", ("B.x", "B.y"), stated_deviation=5 * SIGMA))
    assert result.passed
    assert "(less than stated)" in result.why


def test_a_systematic_error_within_the_tolerance_passes_with_noise(tmp_path):
    path = measured(tmp_path / "short.csv", "slider_crank", ("B.x",), rod=0.1999)
    assert validated(path, "slider_crank", tolerance=1.2e-4).passed
    assert not validated(path, "slider_crank", tolerance=2e-5).passed


@pytest.mark.long
def test_a_column_without_deviation_is_compared_with_the_tolerance(tmp_path):
    path = measured(tmp_path / "half.csv", "four_bar", ("B.x", "B.y"), without_deviation=("B.y",))
    assert not validated(path).passed
    assert validated(path, tolerance=1e-4).passed


@pytest.mark.parametrize("value", [0.0, -SIGMA])
def test_a_nonpositive_standard_deviation_is_rejected(tmp_path, value):
    def spoil(table):
        table["B.x ±"][4] = value

    path = measured(tmp_path / "zero.csv", "four_bar", ("B.x", "B.y"), edit=spoil)
    with pytest.raises(InputError, match=r"column B\.x ± is .* in row 5; give it above 0"):
        validated(path)


def test_a_standard_deviation_of_the_crank_angle_is_rejected(tmp_path):
    def add_deviation(table):
        table["angle ±"] = np.full(len(ANGLES), 1e-3)

    path = measured(tmp_path / "angle.csv", "four_bar", ("B.x", "B.y"), edit=add_deviation)
    with pytest.raises(InputError, match=r"standard deviation of 'angle'.* count as exact; leave it out"):
        validated(path)
    table = {"angle": ANGLES, "angle±": np.full(60, 1e-3), "B.x": np.cos(ANGLES)}
    with pytest.raises(InputError, match="column angle counts as exact; leave out its standard deviation"):
        ms.fit("four_bar", table, ["coupler"])


def test_fit_and_validate_read_a_table_equally(tmp_path):
    plain = measured(tmp_path / "m.csv", "slider_crank", ("A.x", "A.y", "B.x"), rod=0.1999)
    table = dict(files.read(plain))
    scaled = {f"{name} [mm]": 1e3 * values for name, values in table.items() if name != "angle"}
    scaled |= {"angle [deg]": np.rad2deg(table["angle"])}
    head = ",".join(scaled)
    rows = [",".join(repr(float(value)) for value in row) for row in zip(*scaled.values(), strict=True)]
    (tmp_path / "mm.csv").write_text("\n".join([head, *rows]))
    fitted = ms.fit("slider_crank", files.read(tmp_path / "mm.csv"), ["rod"])
    cause = validated(tmp_path / "mm.csv", "slider_crank").findings[0]
    assert fitted.values["rod"] == pytest.approx(
        ms.fit("slider_crank", table, ["rod"]).values["rod"], abs=1e-12
    )
    assert fitted.values["rod"] - 0.2 == pytest.approx(0.2 * cause.by, rel=0.02)
    with pytest.raises(InputError, match=r"'B\.x \[inchworm\]', whose unit is not known"):
        ms.fit("slider_crank", {"angle": [0.0, 1.0], "B.x [inchworm]": [1.0, 2.0]}, ["rod"])


def test_correct_tables_fail_at_the_stated_rate():
    solver = ms.catalog.make("four_bar")
    evaluation = EvaluationPoints(solver, ANGLES, np.ones(60), np.zeros(60))
    named = [quantity(name, solver.mechanism) for name in ("B.xy", "C.xy")]
    random, failed, sigmas = np.random.default_rng(5), 0, []
    for _ in range(300):
        candidates = [
            Candidate(
                item,
                evaluation.exact(item) + SIGMA * random.standard_normal((60, 2)),
                np.full((60, 2), SIGMA),
            )
            for item in named
        ]
        result = agreement(evaluation, candidates, "a right table", diagnose=False)
        failed += not result.passed
        sigmas += [noise.total.worst for _, noise in result.measured]
        assert all(
            0.0 <= item.probability <= 1.0 for _, noise in result.measured for item in noise.statistics
        )
    assert failed <= 3
    assert FALSE_ALARM == 1e-3
    assert np.mean(sigmas) == pytest.approx(1.0, abs=0.01)


def test_the_command_reports_the_noise_as_text_and_json(tmp_path, mechsim):
    path = measured(tmp_path / "right.csv", "four_bar", ("B.x", "B.y"))
    line = f"validate four_bar --against {path}"
    for more in ("", " --json"):
        answer = mechsim(*shlex.split(line + more))
        assert answer.code == 0
        printed = answer.out
        if not more:
            assert "noise of 0.85 sigma, nothing systematic" in printed
    jsonschema.validate(json.loads(printed), output_schema("validate"))
    noise = json.loads(printed)["mechanisms"]["four_bar"]["noise"]
    assert noise["sigma"] == pytest.approx(0.846, abs=0.01)
    assert not noise["systematic"]
    assert noise["degrees"] == 120
    assert noise["quantities"]["B"]["smooth"]["passed"]
