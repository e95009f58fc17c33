"""Findings in included files are reported with the name of that file and its line."""

from pathlib import Path

from model_files import model_text

from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader.reading import read_model


def test_a_finding_names_the_included_file_and_the_line_in_it(tmp_path):
    (tmp_path / "parts").mkdir()
    for name in ("main.xml", "parts/arm.xml", "rocker.xml", "loops.xml"):
        (tmp_path / name).write_text(model_text(f"included_files_{Path(name).name}"))
    result = {item.kind: item for item in findings(read_model(str(tmp_path / "main.xml")))}
    assert (result["gap"].file, result["gap"].line) == ("loops.xml", 4)
    assert (result["limit"].file, result["limit"].line) == ("rocker.xml", 3)
    assert result["limit"].one_line.startswith("rocker.xml, line 3: joint C starts")
