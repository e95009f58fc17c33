"""Mechanisms written as TOML are read back exactly."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from model_files import changed_model, copied

import mechsim as ms
from mechsim.io import gallery
from mechsim.io.toml_writer import to_toml
from mechsim.mechanism.masses import with_inertia

VARIANTS = {
    f"{name}, {variant or 'itself'}": item
    for name in ms.catalog.MECHANISMS
    for variant, item in {"": ms.catalog.make(name), **ms.catalog.make(name).variants()}.items()
}


def read_back(mechanism: ms.Mechanism) -> ms.Mechanism:
    return ms.load(copied(to_toml(mechanism))).mechanism


@pytest.mark.long
@pytest.mark.parametrize("name", VARIANTS)
def test_catalogue_mechanisms_are_read_back_exactly(name):
    mechanism = VARIANTS[name].mechanism
    assert read_back(mechanism) == mechanism
    heavy = with_inertia(mechanism)
    assert read_back(heavy) == heavy != mechanism


def test_mechanisms_are_compared_to_the_last_bit():
    mechanism = ms.catalog.make("rssr").mechanism
    assert replace(mechanism, start=float(np.nextafter(mechanism.start, 1.0))) != mechanism
    link, pose = next(iter(mechanism.guess.items()))
    moved = replace(pose, position=np.nextafter(pose.position, 1.0))
    assert replace(mechanism, guess={**mechanism.guess, link: moved}) != mechanism


def test_names_with_quotes_are_read_back():
    mechanism = ms.catalog.make("four_bar").mechanism
    points = {'a "b"\\': mechanism.points["A"], "ü.1": mechanism.points["B"], "🙂": mechanism.points["C"]}
    assert read_back(renamed := replace(mechanism, points=points)) == renamed


def test_the_printed_schema_describes_the_gallery_and_rejects_what_the_reader_rejects(mechsim):
    schema = json.loads(mechsim("schema").out)
    jsonschema.Draft202012Validator.check_schema(schema)
    valid = jsonschema.Draft202012Validator(schema).is_valid
    for path in gallery.files().values():
        assert valid(tomllib.loads(path.read_text()))
    document = tomllib.loads(gallery.files()["klann"].read_text())
    first = next(iter(document["joints"]))
    for wrong in ({"kind": "revolut"}, {"a": {}}, {"lever": 1}, {"a": {"link": "ground", "at": [0, 0]}}):
        joints = document["joints"] | {first: document["joints"][first] | wrong}
        assert not valid(document | {"joints": joints})


@pytest.fixture(scope="module")
def press():
    return ms.load(changed_model("toml_writer_press.toml"))


def test_motion_laws_of_a_file_use_its_units_and_parameters(press):
    time = np.linspace(0.0, 0.5, 7)
    crank, sleeve = press.motion_laws.state(time)[0]
    np.testing.assert_allclose(crank, np.deg2rad(20 + 12 * np.sin(2 * np.pi * time)), rtol=1e-14)
    np.testing.assert_allclose(sleeve, (5 + 12 * time**2) / 1000, rtol=1e-14)
    assert press.motion_laws.duration == 0.5


def test_all_contents_are_read_back_exactly(press):
    again = ms.load(copied(to_toml(press)))
    assert again.mechanism == press.mechanism
    assert again.motion_laws.duration == press.motion_laws.duration
    time = np.linspace(0.0, 0.5, 11)
    np.testing.assert_allclose(again.motion_laws.state(time), press.motion_laws.state(time), rtol=1e-14)
    assert Path(again.formula).name == Path(press.formula).name
    # loads contain functions, which are compared at one instant
    for result, expected in zip(again.forces.load_profiles, press.forces.load_profiles, strict=True):
        assert np.array_equal(result.evaluate([0.0]), expected.evaluate([0.0]))
    bare = [replace(item.forces, loads=(), couples=(), crank_torque=None) for item in (again, press)]
    assert bare[0] == bare[1]
    assert to_toml(again) == to_toml(press)
