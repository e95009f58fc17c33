"""Equilibria of joints with limits: the reaction of a stop that presses, and none beyond a limit."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.studies.dynamics_check import crosscheck_equilibrium

G = 9.81
ARM = model_text("stops_at_rest_arm.toml")
# a crank of 0.1 m and a rod of 0.3 m; the crank alone has a mass, in its middle
SLIDER = model_text("stops_at_rest_slider.toml")


def model_of(folder, text):
    (folder / "model.toml").write_text(text)
    return dynamic_model(ms.load(str(folder / "model.toml"), still=True))


@pytest.mark.long
@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        # reaction of the stop, m g l cos q; hanging freely; upright on the upper limit
        (-30, 80, [(-30, 0.3 * G * np.cos(np.pi / 6))]),
        (-170, 20, [(-90, None)]),
        (-30, 90, [(-30, 0.3 * G * np.cos(np.pi / 6)), (90, None)]),
        (190, 300, [(-90, None)]),
        (100, 250, [(-110, -0.3 * G * np.cos(np.deg2rad(250)) * -1)]),
    ],
)
def test_an_arm_rests_at_its_stop(tmp_path, lower, upper, expected):
    model = model_of(tmp_path, ARM.replace("LOWER", str(lower)).replace("UPPER", str(upper)))
    at_rest = ms.dynamics.equilibria(model)
    assert [np.rad2deg(each.q["hip"]) for each in at_rest] == pytest.approx([angle for angle, _ in expected])
    for each, (_, force) in zip(at_rest, expected, strict=True):
        assert each.stops == ({} if force is None else {"hip": pytest.approx(force, rel=1e-12)})
        assert crosscheck_equilibrium(each, model).passed


@pytest.mark.long
def test_a_stop_in_a_loop_carries_the_virtual_work_of_the_weight(tmp_path):
    model = model_of(tmp_path, SLIDER)
    at_rest = [each for each in ms.dynamics.equilibria(model) if each.stops]
    crank, rod, stop = 0.1, 0.3, 0.3
    cosine = (crank**2 + stop**2 - rod**2) / (2.0 * crank * stop)
    sine = np.sqrt(1.0 - cosine**2)
    # s = r cos q + sqrt(l^2 - (r sin q)^2); the weight pulls along x: R ds/dq = m g c sin q
    rate = -crank * sine - crank**2 * sine * cosine / np.sqrt(rod**2 - (crank * sine) ** 2)
    expected = 2.0 * G * 0.05 * sine / rate
    assert sorted(np.sin(each.q["crank"]) for each in at_rest) == pytest.approx([-sine, sine], rel=1e-10)
    for each in at_rest:
        assert each.stops["slide"] == pytest.approx(expected, rel=1e-10)
        assert crosscheck_equilibrium(each, model).passed


def test_the_comparison_rejects_a_stop_with_another_force(tmp_path):
    model = model_of(tmp_path, ARM.replace("LOWER", "-30").replace("UPPER", "80"))
    (rest,) = ms.dynamics.equilibria(model)
    wrong = {name: 1.01 * force for name, force in rest.stops.items()}
    assert wrong
    assert not crosscheck_equilibrium(replace(rest, stops=wrong), model).passed
