"""A mechanism written as TOML reads back to the same one, to the last bit."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mechsim.analytic import catalog
from mechsim.cli import main
from mechsim.model.mechanism import Mechanism
from mechsim.model.rod_inertia import with_inertia
from mechsim.subjects.schema import schema
from mechsim.subjects.subject import load
from mechsim.subjects.toml_keys import ROOT
from mechsim.subjects.toml_writer import toml_of

VARIANTS = {
    f"{name}, {variant or 'itself'}": one
    for name in catalog.DRIVES
    for variant, one in {"": catalog.make(name), **catalog.make(name).variants()}.items()
}


def read_back(mechanism: Mechanism, folder: Path) -> Mechanism:
    path = folder / "written.toml"
    path.write_text(toml_of(mechanism))
    return load(str(path)).mechanism


def alike(one: Mechanism, other: Mechanism) -> bool:
    """Whether two mechanisms are equal to the last bit."""
    poses = one.guess.keys() == other.guess.keys() and all(
        np.array_equal(one.guess[name].position, other.guess[name].position)
        and np.array_equal(one.guess[name].rotation, other.guess[name].rotation)
        for name in one.guess
    )
    bare = [replace(mechanism, guess={}, points=dict(mechanism.points)) for mechanism in (one, other)]
    return poses and bare[0] == bare[1]


@pytest.mark.parametrize("name", VARIANTS)
def test_a_mechanism_of_the_catalogue_comes_back_to_the_last_bit(name, tmp_path):
    mechanism = VARIANTS[name].mechanism
    assert alike(read_back(mechanism, tmp_path), mechanism)
    heavy = with_inertia(mechanism)
    assert alike(read_back(heavy, tmp_path), heavy)
    assert not alike(read_back(heavy, tmp_path), mechanism)


def test_the_judge_sees_one_bit(tmp_path):
    mechanism = catalog.make("rssr").mechanism
    moved = replace(mechanism, start=float(np.nextafter(mechanism.start, 1.0)))
    assert not alike(read_back(moved, tmp_path), mechanism)


def test_names_that_are_no_bare_keys_come_back(tmp_path):
    mechanism = catalog.make("four_bar").mechanism
    points = {'a "b"\\': mechanism.points["A"], "ü.1": mechanism.points["B"]}
    assert alike(read_back(replace(mechanism, points=points), tmp_path), replace(mechanism, points=points))


def test_export_writes_toml_that_solves_as_the_catalogue_does(monkeypatch, tmp_path):
    path = tmp_path / "rssr.toml"
    monkeypatch.setattr(sys, "argv", ["mechsim", "export", "rssr", "--format", "toml", "-o", str(path)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    angles = np.linspace(0.0, 6.0, 13)
    exact = catalog.make("rssr").positions(angles)
    for name, place in load(str(path)).positions(angles).items():
        np.testing.assert_allclose(place, exact[name], atol=1e-15)


def test_the_schema_has_every_key_of_the_reader(monkeypatch, capsys):
    assert schema()["properties"].keys() == ROOT.keys.keys()
    assert schema()["required"] == list(ROOT.required)
    monkeypatch.setattr(sys, "argv", ["mechsim", "schema"])
    with pytest.raises(SystemExit):
        main()
    assert json.loads(capsys.readouterr().out)["properties"]["joints"]["additionalProperties"]["required"]
