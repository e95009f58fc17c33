"""Masses used for torques are listed with their source."""

import json
from math import pi

import pytest
from model_files import model_text

import mechsim as ms
from mechsim.mechanism.masses import masses_of, summary, with_inertia
from mechsim.simulation.dynamics.prescribed_motion import driven

# crank of 0.1 m and arm in file; the rod, 0.3 m, has no inertia
SLIDER = model_text("masses_slider.toml")
# a massless link next to one with mass
SCENE = model_text("masses_scene.xml")


@pytest.fixture
def press(file):
    return file(SLIDER)


def test_masses_are_listed_with_their_source(press):
    model = ms.dynamics.dynamic_model(ms.load(press), diameter=0.01)
    result = {item.link: item for item in model.masses}
    assert (result["crank"].mass, result["crank"].source) == (0.5, "given")
    rod = result["rod"]
    assert rod.source == "rod"
    assert rod.mass == pytest.approx(7850.0 * pi / 4.0 * 0.01**2 * 0.3, rel=1e-14)
    assert (rod.length, rod.diameter, rod.density) == (pytest.approx(0.3), 0.01, 7850.0)
    # all joints of the slider coincide: a pin of two diameters length
    assert result["slider"].length == pytest.approx(0.02)
    study = ms.dynamics.prescribed(model, [0.1, 0.2], 1.0)
    assert study.masses == model.masses
    assert driven(model.mechanism, model.forces, speed=1.0, samples=4).masses == model.masses


def test_a_massless_link_of_a_scene_is_listed_as_zero(file):
    path = file(SCENE)
    solver = ms.load(path, lock={"tip": 0.0})
    assert {item.link: item.source for item in masses_of(solver.mechanism)} == {"arm": "given", "tip": "zero"}
    assert summary(masses_of(solver.mechanism)) == "masses: arm given, 2 kg; tip zero in the file"


def test_rods_of_another_material_are_listed_with_their_density():
    mechanism = with_inertia(ms.catalog.make("four_bar").mechanism, 2700.0)
    assert "2700 kg/m3 rods" in summary(masses_of(mechanism))
    assert "steel" in summary(masses_of(with_inertia(ms.catalog.make("four_bar").mechanism)))


def test_comparisons_of_torques_report_the_masses(mechsim, press, tmp_path):
    mechanism = ms.load(press)
    torque = ms.dynamics.prescribed(ms.dynamics.dynamic_model(mechanism), [0.5, 1.0, 1.5], 10.0).forces.torque
    table = tmp_path / "torque.csv"
    rows = "\n".join(
        f"{angle},{value!r}" for angle, value in zip((0.5, 1.0, 1.5), torque.tolist(), strict=True)
    )
    table.write_text(f"angle,torque:crank\n{rows}\n")
    arguments = ("validate", press, "--against", str(table), "--speed", "10rad/s")
    answer = mechsim(*arguments)
    assert "computed as round steel rods" in " ".join(answer.out.split())
    reported = json.loads(mechsim(*arguments, "--json").out)["mechanisms"]["press"]
    assert [item["source"] for item in reported["masses"]] == ["given", "rod", "rod"]
    verdict = ms.validate(press, str(table), speed=10.0, stepped=False)
    assert [item.link for item in verdict.masses] == ["crank", "rod", "slider"]
