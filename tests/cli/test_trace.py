import json

import numpy as np
import pytest
from valid_scene import changed

from mechsim import files
from mechsim.io import reference_data

SWINGS = ("four_bar", "--set", "crank=90mm", "--starts", "20")
FLAT = ("four_bar", "--set", "crank=50mm", "--set", "rocker=50mm", "--set", "coupler=100mm")
FLAT = (*FLAT, "--set", "ground=100mm", "--starts", "20")


@pytest.fixture
def trace(mechsim):
    return lambda *arguments: mechsim("trace", *arguments)


@pytest.mark.long
def test_a_trace_is_reported_and_written_as_a_table(trace, tmp_path):
    code, out, err = trace(*SWINGS, "-o", "all.csv")
    assert code == 0, err
    assert "2 components; 20 of 20 random starts (seed 1)" in " ".join(out.split())
    assert "swings" in out
    assert out.splitlines()[-1] == "wrote all.csv"
    table = files.read(tmp_path / "all.csv")
    assert list(table)[:6] == ["component", "arc", "angle", "crank.q", "A.q", "B.q"]
    assert list(table)[-3:] == ["C.x", "C.y", "C.z"]
    assert np.unique(table["component"]).tolist() == [1.0, 2.0]
    first = {name: column[table["component"] == 1.0] for name, column in table.items()}
    assert len(first["arc"]) >= 100
    assert np.ptp(np.diff(first["arc"])) <= 1e-12
    # the crank length is constant over the curve
    assert np.abs(np.hypot(first["A.x"], first["A.y"]) - 0.09).max() <= 1e-16


@pytest.mark.long
def test_json_numbers_components_from_one_and_lists_branch_points(trace):
    code, out, err = trace(*FLAT, "--json")
    assert (code, err) == (0, "")
    reported = json.loads(out)
    assert [item["component"] for item in reported["components"]] == [1, 2]
    assert [item["own"] for item in reported["components"]] == [True, False]
    assert (
        sum(item["starts_ended"] for item in reported["components"])
        == reported["closed"]
        == reported["starts"]
        == 20
    )
    assert sorted(round(item["angle"] / np.pi, 9) % 2.0 for item in reported["branch_points"]) == [0.0, 1.0]
    assert all(
        [location["component"] for location in item["places"]] == [1, 2] for item in reported["branch_points"]
    )


@pytest.mark.long
def test_a_user_defined_mechanism_is_traced(trace):
    code, out, err = trace(
        str(reference_data.folder() / "mechanisms/elliptic_trammel.toml"), "--starts", "10"
    )
    assert code == 0, err
    assert out.count("assemblies meet at crank ") == 2


def test_locking_an_undetermined_joint_allows_the_trace(trace, file):
    undetermined = (
        '<body name="rocker" pos="0.1 0 0.01" euler="0 0 1.3">\n      <joint name="loose" axis="0 1 0.2"/>'
    )
    text = changed(('<body name="rocker" pos="0.1 0 0.01" euler="0 0 1.3">', undetermined))
    arguments = (file(text), "--starts", "0")
    code, _, err = trace(*arguments)
    assert code == 2
    assert "lock or couple it" in err
    code, out, err = trace(*arguments, "--lock", "loose")
    assert (code, err) == (0, "")
    assert "component" in out
