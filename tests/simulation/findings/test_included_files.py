"""Findings in included files are reported with the name of that file and its line."""

from model_files import model_text

from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader.reading import read_model

MAIN = model_text("included_files_main.xml")
ARM = model_text("included_files_arm.xml")
ROCKER = model_text("included_files_rocker.xml")
LOOPS = model_text("included_files_loops.xml")


def test_a_finding_names_the_included_file_and_the_line_in_it(tmp_path):
    (tmp_path / "parts").mkdir()
    for name, text in (
        ("main.xml", MAIN),
        ("parts/arm.xml", ARM),
        ("rocker.xml", ROCKER),
        ("loops.xml", LOOPS),
    ):
        (tmp_path / name).write_text(text)
    result = {item.kind: item for item in findings(read_model(str(tmp_path / "main.xml")))}
    assert (result["gap"].file, result["gap"].line) == ("loops.xml", 4)
    assert (result["limit"].file, result["limit"].line) == ("rocker.xml", 3)
    assert result["limit"].one_line.startswith("rocker.xml, line 3: joint C starts")
