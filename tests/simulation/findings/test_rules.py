"""The linter: each rule reports its fault, a valid file has none, and repairable faults are repaired."""

import json
from pathlib import Path

import mujoco
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.findings.rule_table import RULES

SOUND = model_text("rules_sound.xml")
SOFT = SOUND.replace('gravity="0 0 0"', 'gravity="0 -9.81 0"').replace(
    'site2="b"', 'site2="b" solref="0.1 1"'
)
FAULTS = {
    "MS102": SOUND.replace('pos="0 .08 0"', 'pos="0 .09 0"'),
    "MS109": SOUND.replace('site2="b"', 'site2="b" solref="0.0005 1"'),
    "MS110": SOFT,
    "MS111": SOUND.replace('<joint name="rocker"', '<joint type="slide" axis="1 0 0"/><joint name="rocker"'),
    "MS201": SOUND.replace("</actuator>", '<motor joint="rocker"/></actuator>'),
    "MS202": SOUND.replace(
        'name="rocker" axis="0 0 1"', 'name="rocker" axis="0 0 1" range="-.1 .1" limited="true"'
    ),
    "MS203": SOUND.replace('name="rocker" axis="0 0 1"', 'name="rocker" axis="0 0 1" damping="0.1"'),
}


def written(tmp_path, text):
    path = tmp_path / "model.xml"
    path.write_text(text)
    return str(path)


def test_a_valid_file_has_no_errors_and_no_warnings(tmp_path):
    violations = ms.check(written(tmp_path, SOUND))
    assert {violation.severity for violation in violations} <= {"note"}


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Return the rules that a sound file violates."""
    return {violation.rule for violation in ms.check(written(tmp_path_factory.mktemp("sound"), SOUND))}


@pytest.mark.long
@pytest.mark.parametrize("code", FAULTS)
def test_each_fault_is_reported_by_its_rule(code, tmp_path, sound):
    violations = {violation.rule: violation for violation in ms.check(written(tmp_path, FAULTS[code]))}
    rule = next(rule for rule in RULES if rule.code == code)
    assert code in violations
    assert violations[code].severity == rule.severity
    assert code not in sound


def test_rules_are_selected_and_ignored_by_prefix(tmp_path):
    path = written(tmp_path, FAULTS["MS202"])
    assert {violation.rule for violation in ms.check(path, select=["MS2"])} == {"MS202", "MS203"}
    assert "MS202" not in {violation.rule for violation in ms.check(path, ignore=["MS202"])}


def test_exit_code_1_needs_an_error(tmp_path, mechsim):
    code, out, _ = mechsim("check", written(tmp_path, FAULTS["MS102"]))
    assert code == 1
    assert "MS102 error" in out
    code, out, _ = mechsim("check", written(tmp_path, SOFT))
    assert code == 0
    assert "0 errors, 1 warning" in out


@pytest.mark.long
def test_all_formats_report_the_same_findings(tmp_path, mechsim):
    path = written(tmp_path, FAULTS["MS102"])
    expected = [violation.rule for violation in ms.check(path)]
    _, out, _ = mechsim("check", path, "--output-format", "json")
    assert [finding["rule"] for finding in json.loads(out)["findings"]] == expected
    _, out, _ = mechsim("check", path, "--output-format", "github")
    assert out.startswith(f"::error file={path},line=7,title=MS102::")
    _, out, _ = mechsim("check", path, "--output-format", "sarif")
    sarif = json.loads(out)
    assert sarif["version"] == "2.1.0"
    (one_run,) = sarif["runs"]
    assert [result["ruleId"] for result in one_run["results"]] == expected
    assert {rule["id"] for rule in one_run["tool"]["driver"]["rules"]} == {rule.code for rule in RULES}
    location = one_run["results"][0]["locations"][0]["physicalLocation"]
    assert location["region"]["startLine"] == 7


@pytest.mark.long
def test_piped_text_has_one_line_per_finding(tmp_path, mechsim):
    path = written(tmp_path, FAULTS["MS102"])
    _, out, _ = mechsim("check", path, "--select", "MS102")
    assert out.splitlines()[0].startswith(f"{path}:7: MS102 error: loop is open at the start")
    assert out.splitlines()[1].startswith("    MuJoCo closes it")


@pytest.mark.long
def test_a_compliant_loop_is_repaired_in_a_copy(tmp_path, mechsim):
    path, copy = written(tmp_path, SOFT), tmp_path / "fixed.xml"
    code, out, _ = mechsim("check", path, "--fix", str(copy))
    assert code == 0
    assert "repaired: MS110" in out
    assert "MS110" in {violation.rule for violation in ms.check(path)}
    assert "MS110" not in {violation.rule for violation in ms.check(str(copy))}
    assert Path(path).read_text() == SOFT


AGAIN = '<connect name="again" site1="a" site2="b"/></equality>'
ONE_REMEDY = {
    "MS101": SOUND.replace('site2="b"', 'site2="b" solref="-4e6 -4000"'),
    "MS107": SOUND.replace("</equality>", AGAIN),
    "MS109": FAULTS["MS109"],
    "MS101 MS109": SOFT.replace('solref="0.1 1"', 'solref="0.0005 1" solimp="0.1 0.1 0.001 0.5 2"'),
    "MS113": SOUND.replace(
        'name="rocker" axis="0 0 1"', 'name="rocker" axis="0 0 1" damping="-1" armature="-1"'
    ),
    "MS114": SOUND.replace('name="rocker" axis="0 0 1"', 'name="rocker" axis="0 0 1" stiffness="1e6"'),
}


@pytest.mark.long
@pytest.mark.parametrize("rules", ONE_REMEDY)
def test_a_finding_with_one_remedy_is_repaired(rules, tmp_path, mechsim):
    path, copy = written(tmp_path, ONE_REMEDY[rules]), tmp_path / "fixed.xml"
    _, out, _ = mechsim("check", path, "--fix", str(copy))
    assert {*rules.split()} <= {*out.partition("repaired: ")[2].strip().split(", ")}
    remaining = {finding.rule for finding in ms.check(str(copy)) if finding.severity != "note"}
    assert not remaining & {*rules.split()}


def test_a_repaired_copy_in_another_folder_finds_its_included_files(tmp_path, mechsim):
    path = written(tmp_path, SOFT.replace("<worldbody>", '<include file="parts/extra.xml"/><worldbody>', 1))
    (tmp_path / "parts").mkdir()
    extra = "<mujocoinclude><worldbody><site name='of_the_included_file'/></worldbody></mujocoinclude>"
    (tmp_path / "parts" / "extra.xml").write_text(extra)
    (tmp_path / "copies").mkdir()
    code, *_ = mechsim("check", path, "--fix", str(tmp_path / "copies" / "fixed.xml"))
    assert code == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "copies" / "fixed.xml"))
    assert model.site("of_the_included_file").id >= 0


def test_a_line_end_in_a_name_starts_no_workflow_command(tmp_path, mechsim):
    path = tmp_path / "a\n::error title=b,c%::d.xml"
    path.write_text(FAULTS["MS102"])
    _, out, _ = mechsim("check", str(path), "--output-format", "github")
    lines = out.splitlines()
    # the file is a property, in which GitHub reads %3A as : and %2C as ,
    assert f"file={tmp_path}/a%0A%3A%3Aerror title=b%2Cc%25%3A%3Ad.xml,line=7,title=MS102::" in lines[0]
    assert all(line.startswith(("::error file=", "::warning file=", "::notice file=")) for line in lines)
    _, out, _ = mechsim("check", str(path))
    assert not any(line.startswith("::") for line in out.splitlines())


def test_only_mjcf_is_repaired(tmp_path, mechsim):
    path = tmp_path / "tree.urdf"
    path.write_text('<robot name="r"><link name="base"/></robot>')
    code, _, err = mechsim("check", str(path), "--fix", str(tmp_path / "out.xml"))
    assert code == 2
    assert "tree.urdf is URDF" in err
    assert not (tmp_path / "out.xml").exists()
