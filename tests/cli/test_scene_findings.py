"""What `show` says of a file that is wrong, and that it says nothing of one that is not."""

import json
import re

import pytest
from valid_scene import SOUND, changed

from mechsim.errors import InputError

SOFT = changed(('solref="0.002 1"\n             solimp="0.9999 0.9999 0.001 0.5 2"', ""))


@pytest.mark.parametrize(("text", "kinds"), [(SOUND, []), (SOFT, ["soft"])])
def test_show_lists_what_is_wrong_with_a_scene(mechsim, file, text, kinds):
    code, out, _ = mechsim("show", file(text), "--json")
    assert code == 0
    result = json.loads(out)["findings"]
    assert [item["kind"] for item in result] == kinds
    for item in result:
        assert {"kind", "what", "by", "explains", "message", "remedy", "line", "file"} <= set(item)
        assert 0 <= item["explains"] <= 1


def test_show_reports_people_the_line_and_the_remedy(mechsim, file):
    _, out, _ = mechsim("show", file(SOFT))
    output = " ".join(out.split())
    line = 1 + SOFT[: SOFT.index('name="loop"')].count("\n")
    assert f" soft {line} loop is soft" in output
    assert "findings: none" in mechsim("show", file(SOUND))[1]


def test_a_mechanism_of_the_catalogue_has_no_scene_to_look_over(mechsim):
    assert "findings" not in json.loads(mechsim("show", "four_bar", "--json")[1])


def test_a_verdict_on_a_scene_begins_with_what_is_wrong_with_it(mechsim, file):
    path = file(SOFT)
    _, out, _ = mechsim("simulate", path, "--drive", "crank=0.3*sin(2*pi*t)")
    heads = [line for line in out.splitlines() if not line.startswith(" ")]
    assert [line.split(": line")[0] for line in heads[:2]] == ["actuator", "soft"]
    _, out, _ = mechsim("simulate", path, "--drive", "crank=0.3*sin(2*pi*t)", "--json")
    result = json.loads(out)["findings"]
    # the servo of the file stands at 0 while the crank is driven
    assert [item["kind"] for item in result] == ["actuator", "soft"]


def test_what_is_wrong_with_a_scene_that_cannot_be_checked_is_reported(mechsim, file):
    text = changed(('<connect name="loop"', '<connect name="loop" active="false"'))
    code, out, _ = mechsim("validate", file(text), "--json")
    (case,) = json.loads(out)["mechanisms"].values()
    assert (code, case["outcome"]) == (2, "underdetermined")
    assert "open" in [item["kind"] for item in case["findings"]]


@pytest.mark.slow
def test_validate_states_it_too_whatever_the_scene_is_held_against(mechsim, file, tmp_path):
    (tmp_path / "own.py").write_text("def still(angle):\n    return {'rocker': 0 * angle}\n")
    asked = ("validate", file(SOFT), "--drive", "crank=0.3*sin(2*pi*t)")
    _, out, _ = mechsim(*asked, "--json")
    (case,) = json.loads(out)["mechanisms"].values()
    assert "soft" in [item["kind"] for item in case["findings"]]
    _, out, _ = mechsim(*asked, "--against", "own.py:still", "--json")
    (case,) = json.loads(out)["mechanisms"].values()
    kinds = [item["kind"] for item in case["findings"]]
    assert kinds[:2] == ["actuator", "soft"]
    assert len(kinds) > 2
    _, out, _ = mechsim(*asked, "--against", "own.py:still")
    heads = [line for line in out.splitlines() if not line.startswith(" ")]
    assert heads[1].startswith("soft: line")


FLOATS = changed(
    ("<worldbody>", '<worldbody><body name="loose" pos="1 2 3"><freejoint/><geom size="0.01"/></body>')
)
DRIVEN = ("--drive", "crank=0.3*sin(2*pi*t)", "--duration", "0.1")


@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_body_that_floats_next_to_a_mechanism_is_no_reason_to_reject_its_run(
    mechsim, file, tmp_path, method
):
    code, out, err = mechsim("simulate", file(FLOATS), *DRIVEN, "--method", method, "-o", "run.csv")
    assert (code, err) == (0, "")
    assert re.search(r"PASS\n  points within", out)
    assert (tmp_path / "run.csv").exists()


def test_a_run_that_is_rejected_at_the_last_writes_nothing(mechsim, file, tmp_path, monkeypatch):
    def refused(*_):
        raise InputError("no")

    for late in ("scene_findings", "few_digits"):
        with monkeypatch.context() as patched:
            patched.setattr(f"mechsim.cli.simulate.{late}", refused)
            code, _, err = mechsim("simulate", file(SOUND), *DRIVEN, "-o", "run.csv")
        assert (code, err) == (2, "mechsim: no\n")
        assert not (tmp_path / "run.csv").exists()
