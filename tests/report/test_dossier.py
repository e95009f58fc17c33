"""The dossier of a model: what it states for a passing model, a failing one, and one without sources."""

import hashlib
import json
from xml.etree import ElementTree

import numpy as np
import pytest
from browser import in_browser, sheets_of
from model_files import model_text

SRMD = "{http://ssp-standard.org/SSPTraceability1/SimulationResourceMetaData}"
COMMON = "{http://ssp-standard.org/SSPTraceability1/SSPTraceabilityCommon}"
TOO_LONG = """import numpy as np
def piston(angle):
    r, l = 0.0321, 0.1
    x = r * np.cos(angle) + np.sqrt(l**2 - (r * np.sin(angle)) ** 2)
    return {"B": np.column_stack([x, 0 * x, 0 * x])}
"""


@pytest.fixture
def write(mechsim, tmp_path):
    """Return a function that runs a command line in a folder with the pump, and gives its exit code."""
    (tmp_path / "pump.toml").write_text(model_text("dossier_pump.toml"))
    (tmp_path / "wrong.py").write_text(TOO_LONG)
    return lambda *words: mechsim(*words).code


def read(folder, name):
    page = (folder / f"{name}.dossier.html").read_text()
    return json.loads((folder / f"{name}.dossier.json").read_text()), page


def test_a_dossier_states_use_sources_uncertainty_and_hashes(write, tmp_path):
    assert write("validate", "pump.toml", "--dossier", "out") == 0
    data, page = read(tmp_path / "out", "pump")
    assert data["intended_use"] == "stroke of the piston to 0.1 mm at up to 600 rpm"
    crank = data["dimensions"]["crank"]
    assert (crank["value"], crank["uncertainty"], crank["source"]) == (0.032, 1e-5, "drawing 4711")
    assert data["dimensions"]["half"]["computed_from"] == ["rod"]
    # x = r cos a + sqrt(l2 - r2 sin2 a) of a sharp grid; both derivatives are largest at a = 0
    r, rod, a = 0.032, 0.1, np.linspace(0.0, 2.0 * np.pi, 3601)
    root = np.sqrt(rod**2 - (r * np.sin(a)) ** 2)
    worst = abs(np.cos(a) - r * np.sin(a) ** 2 / root) * 1e-5 + abs(rod / root) * 2e-5
    assert data["effects"]["B.x"]["worst"] == pytest.approx(worst.max(), rel=1e-4)
    content = (tmp_path / "pump.toml").read_bytes()
    assert data["inputs"] == {"pump.toml": hashlib.sha256(content).hexdigest()}
    missing = " ".join(data["not_covered"])
    assert "No source is stated for 1 of 2 dimensions: rod." in missing
    assert "uncertainty" not in missing
    assert "no table of measurements" in missing
    for text in ("drawing 4711", "not stated", "30 µm", "PASS", *data["not_covered"]):
        assert text in page
    assert "FAIL" not in page

    root = ElementTree.parse(tmp_path / "out" / "pump.srmd").getroot()
    assert root.tag == f"{SRMD}SimulationResourceMetaData"
    assert (root.get("version"), root.get("data"), root.get("checksumType")) == (
        "1.0.0",
        "../pump.toml",
        "SHA3-256",
    )
    assert root.get("checksum") == hashlib.sha3_256(content).hexdigest()
    entries = [(entry.get("keyword"), entry.text) for entry in root.iter(f"{COMMON}ClassificationEntry")]
    assert ("source of crank", "drawing 4711") in entries
    assert ("outcome", "passed") in entries


@in_browser
def test_a_dossier_with_full_tables_prints_on_one_side_of_a4(write, tmp_path):
    stated = "".join(
        f'd{i} = {{ value = "{i + 10} mm", uncertainty = "0.01 mm", source = "drawing 471{i}, sheet 2" }}\n'
        for i in range(14)
    )
    model = tmp_path / "pump.toml"
    model.write_text(model.read_text().replace("[parameters]\n", f"[parameters]\n{stated}"))
    assert write("validate", "pump.toml", "--dossier", "out") == 0
    page = tmp_path / "out" / "pump.dossier.html"
    assert "and 4 more in" in page.read_text()
    assert sheets_of(page) == 1


@pytest.mark.long
def test_the_dossier_of_a_failing_model_states_the_failure(write, tmp_path):
    assert write("validate", "pump.toml", "--against", "wrong.py:piston", "--dossier", "out") == 1
    data, page = read(tmp_path / "out", "pump")
    assert data["verification"]["outcome"] == "failed"
    assert [check["passed"] for check in data["verification"]["checks"]] == [False]
    assert {*data["inputs"]} == {"pump.toml", "wrong.py"}
    assert 'class="verdict no"' in page
    assert "FAIL" in page
    assert "crank is 0.0321 m instead of 0.032 m" in page
    assert ">failed<" in (tmp_path / "out" / "pump.srmd").read_text()


def test_a_table_counts_as_validation(write, tmp_path):
    angle = np.linspace(0.0, 6.0, 20)
    x = 0.032 * np.cos(angle) + np.sqrt(0.1**2 - (0.032 * np.sin(angle)) ** 2)
    np.savetxt(tmp_path / "log.csv", np.c_[angle, x], "%.17g", ",", header="angle,B.x", comments="")
    assert write("validate", "pump.toml", "--against", "log.csv", "--dossier", "out") == 0
    data, page = read(tmp_path / "out", "pump")
    assert data["validation"] == "log.csv"
    assert "no table of measurements" not in " ".join(data["not_covered"])
    assert "Compared with the table log.csv" in page


@pytest.mark.long
def test_a_dossier_states_that_nothing_is_stated(write, tmp_path):
    assert write("validate", "slider_crank", "--dossier", "out") == 0
    data, page = read(tmp_path / "out", "slider_crank")
    count = len(data["dimensions"])
    missing = " ".join(data["not_covered"])
    assert data["intended_use"] is None
    assert "Intended use: the model states none" in missing
    assert f"No source is stated for {count} of {count} dimensions" in missing
    assert f"No uncertainty is stated for {count} of {count} dimensions" in missing
    assert f"None of {count} dimensions states a source or an uncertainty." in page
    # the formulas are an input too
    assert sorted(path.rpartition("/")[2] for path in data["inputs"]) == [
        "slider_crank.py",
        "slider_crank.toml",
    ]


@pytest.mark.usefixtures("write")
def test_sensitivity_takes_the_uncertainties_of_a_file(mechsim):
    of_piston = ("sensitivity", "pump.toml", "--of", "B.x", "--json")
    by_file = json.loads(mechsim(*of_piston).out)["tolerances"]
    by_option = json.loads(mechsim(*of_piston, "--tolerances", "crank=0.01mm,rod=0.02mm").out)["tolerances"]
    assert by_file == by_option
    assert by_file["bounds"] == {"crank": 1e-5, "rod": 2e-5}
