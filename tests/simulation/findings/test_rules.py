"""The linter: each rule reports its fault, a valid file has none, and repairable faults are repaired."""

import json

import mujoco
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.findings.rule_table import RULES

SOUND = model_text("rules_sound.xml")
OPEN = SOUND.replace('pos="0 .08 0"', 'pos="0 .09 0"')
SOFT = SOUND.replace('gravity="0 0 0"', 'gravity="0 -9.81 0"').replace(
    'site2="b"', 'site2="b" solref="0.1 1"'
)


@pytest.mark.long
def test_all_formats_report_the_same_findings(file, mechsim):
    path = file(OPEN)
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


def test_a_repaired_copy_in_another_folder_finds_its_included_files(file, tmp_path, mechsim):
    path = file(SOFT.replace("<worldbody>", '<include file="parts/extra.xml"/><worldbody>', 1))
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
    path.write_text(OPEN)
    _, out, _ = mechsim("check", str(path), "--output-format", "github")
    lines = out.splitlines()
    # the file is a property, in which GitHub reads %3A as : and %2C as ,
    assert f"file={tmp_path}/a%0A%3A%3Aerror title=b%2Cc%25%3A%3Ad.xml,line=7,title=MS102::" in lines[0]
    assert all(line.startswith(("::error file=", "::warning file=", "::notice file=")) for line in lines)
    _, out, _ = mechsim("check", str(path))
    assert not any(line.startswith("::") for line in out.splitlines())
