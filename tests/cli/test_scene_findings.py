"""Commands report findings of a scene with faults, and none of a valid one."""

import json
import re

import pytest
from model_files import model_text
from valid_scene import SOUND, changed

from mechsim import files
from mechsim.errors import InputError

COMPLIANT = changed(('solref="0.002 1"\n             solimp="0.9999 0.9999 0.001 0.5 2"', ""))


@pytest.mark.long
@pytest.mark.parametrize(("text", "kinds"), [(SOUND, []), (COMPLIANT, ["soft"])])
def test_show_lists_the_findings_of_a_scene(mechsim, file, text, kinds):
    code, out, _ = mechsim("show", file(text), "--json")
    assert code == 0
    result = json.loads(out)["findings"]
    assert [item["kind"] for item in result] == kinds
    for item in result:
        assert {"kind", "object", "value", "explains", "message", "remedy", "line", "file"} <= set(item)
        assert 0 <= item["explains"] <= 1


@pytest.mark.long
def test_simulate_prints_findings_before_the_verdict(mechsim, file):
    path = file(COMPLIANT)
    _, out, _ = mechsim("simulate", path, "--drive", "crank=0.3*sin(2*pi*t)")
    heads = [line for line in out.splitlines() if not line.startswith(" ")]
    assert [line.split(": line")[0] for line in heads[:2]] == ["actuator", "soft"]
    _, out, _ = mechsim("simulate", path, "--drive", "crank=0.3*sin(2*pi*t)", "--json")
    result = json.loads(out)["findings"]
    # the servo of the file has target 0 while the crank is driven
    assert [item["kind"] for item in result] == ["actuator", "soft"]


def test_validate_reports_findings_of_an_underdetermined_scene(mechsim, file):
    text = changed(('<connect name="loop"', '<connect name="loop" active="false"'))
    code, out, _ = mechsim("validate", file(text), "--json")
    (case,) = json.loads(out)["mechanisms"].values()
    assert (code, case["outcome"]) == (2, "underdetermined")
    assert "open" in [item["kind"] for item in case["findings"]]


@pytest.mark.slow
def test_validate_reports_findings_with_and_without_a_formula(mechsim, file, tmp_path):
    (tmp_path / "own.py").write_text("def still(angle):\n    return {'rocker': 0 * angle}\n")
    arguments = ("validate", file(COMPLIANT), "--drive", "crank=0.3*sin(2*pi*t)")
    _, out, _ = mechsim(*arguments, "--json")
    (case,) = json.loads(out)["mechanisms"].values()
    assert "soft" in [item["kind"] for item in case["findings"]]
    _, out, _ = mechsim(*arguments, "--against", "own.py:still", "--json")
    (case,) = json.loads(out)["mechanisms"].values()
    kinds = [item["kind"] for item in case["findings"]]
    assert kinds[:2] == ["actuator", "soft"]
    assert len(kinds) > 2
    _, out, _ = mechsim(*arguments, "--against", "own.py:still")
    heads = [line for line in out.splitlines() if not line.startswith(" ")]
    assert heads[1].startswith("soft: line")


WITH_FLOATING_BODY = changed(
    ("<worldbody>", '<worldbody><body name="loose" pos="1 2 3"><freejoint/><geom size="0.01"/></body>')
)
DRIVEN = ("--drive", "crank=0.3*sin(2*pi*t)", "--duration", "0.1")


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
def test_an_unconnected_floating_body_does_not_reject_a_run(mechsim, file, tmp_path, method):
    code, out, err = mechsim(
        "simulate", file(WITH_FLOATING_BODY), *DRIVEN, "--method", method, "-o", "run.csv"
    )
    assert (code, err) == (0, "")
    assert re.search(r"PASS\n  points within", out)
    assert (tmp_path / "run.csv").exists()


def test_a_late_rejection_writes_no_file(mechsim, file, tmp_path, monkeypatch):
    def reject(*_):
        raise InputError("no")

    for function in ("scene_findings", "loss_of_significance"):
        with monkeypatch.context() as patched:
            patched.setattr(f"mechsim.cli.simulate.{function}", reject)
            code, _, err = mechsim("simulate", file(SOUND), *DRIVEN, "-o", "run.csv")
        assert (code, err) == (2, "mechsim: no\n")
        assert not (tmp_path / "run.csv").exists()


# a five-bar with one driven arm
ONE_DRIVER = model_text("undetermined_one_driver.toml")


def test_an_underdetermined_crank_is_stepped_from_its_start(mechsim, tmp_path):
    (tmp_path / "five.toml").write_text(ONE_DRIVER)
    answer = mechsim("simulate", "five.toml", "--method", "step", "--turns", "0.02", "-o", "run.csv")
    assert (answer.code, "PASS" in answer.out) == (0, True)
    assert files.read(str(tmp_path / "run.csv"))["angle"][0] == pytest.approx(2.0, abs=1e-12)
    assert "right can still move" in mechsim("solve", "five.toml", "--angles", "2").err
