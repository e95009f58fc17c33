"""Intended idioms of public models give no finding; the corresponding fault does."""

from pathlib import Path

import mujoco
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader.reading import read_model

# a four-bar whose crank lies in line with its coupler, and a rocker with a motor
IN_LINE = model_text("public_idioms_in_line.xml")


def violations_of(text, rule):
    return [violation for violation in ms.check(mujoco.MjSpec.from_string(text)) if violation.rule == rule]


@pytest.mark.long
def test_the_first_keyframe_defines_the_start():
    qpos = ms.closed_qpos(mujoco.MjSpec.from_string(IN_LINE).compile(), {"crank": -1.0})[0]
    low, high = sorted((0.5 * qpos[2], 1.5 * qpos[2]))
    limited = IN_LINE.replace('name="rocker"', f'name="rocker" range="{low} {high}"')
    assert violations_of(limited, "MS105")
    key = f'<keyframe><key qpos="{" ".join(map(str, qpos))}"/></keyframe></mujoco>'
    assert not violations_of(limited.replace("</mujoco>", key), "MS105")
    opened = f'<keyframe><key qpos="{" ".join(map(str, qpos + 0.1))}"/></keyframe></mujoco>'
    assert violations_of(IN_LINE.replace("</mujoco>", opened), "MS102")


def test_an_object_with_included_files_is_checked(tmp_path):
    (tmp_path / "loops.xml").write_text(
        '<mujocoinclude><connect name="loop" site1="a" site2="b"/></mujocoinclude>'
    )
    main = IN_LINE.replace('<connect name="loop" site1="a" site2="b"/>', '<include file="loops.xml"/>')
    (tmp_path / "main.xml").write_text(
        main.replace('site name="b" pos="0 .08 0"', 'site name="b" pos="0 .09 0"')
    )
    spec = mujoco.MjSpec.from_file(str(tmp_path / "main.xml"))
    assert "MS102" in {violation.rule for violation in ms.check(spec)}


MODELS = Path(__file__).parents[3] / "models"


@pytest.mark.long
@pytest.mark.parametrize("name", ["bennett", "four_bar", "looper", "rrsrr", "rssr", "slider_crank"])
def test_catalogue_models_have_only_redundant_constraint_findings(name):
    result = findings(read_model(str(MODELS / f"{name}.xml")))
    # a planar linkage has a redundant constraint normal to its plane; Bennett's linkage is overconstrained
    repeats = [(item.object, item.value) for item in result if item.kind == "redundant"]
    assert len(result) == len(repeats)
    planar = [("loops", 1)]
    assert repeats == {"bennett": [("B, B+", 4)], "four_bar": planar, "slider_crank": planar}.get(name, [])


def test_a_finding_names_the_included_file_and_the_line_in_it(tmp_path):
    (tmp_path / "parts").mkdir()
    for name in ("main.xml", "parts/arm.xml", "rocker.xml", "loops.xml"):
        (tmp_path / name).write_text(model_text(f"included_files_{Path(name).name}"))
    result = {item.kind: item for item in findings(read_model(str(tmp_path / "main.xml")))}
    assert (result["gap"].file, result["gap"].line) == ("loops.xml", 4)
    assert (result["limit"].file, result["limit"].line) == ("rocker.xml", 3)
    assert result["limit"].one_line.startswith("rocker.xml, line 3: joint C starts")
