"""A body whose joints and points all coincide has a size: its centre of mass, or 1 m."""

import json

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms

# two springs of 50 N/m, at rest length 0.2 m and 0.3 m long, hold 2 kg: omega^2 = 2 * 50 / 2
OSCILLATOR = model_text("mass_on_a_slide_oscillator.toml")


@pytest.fixture
def path(tmp_path):
    (tmp_path / "oscillator.toml").write_text(OSCILLATOR)
    return tmp_path / "oscillator.toml"


def test_its_frequency_and_free_motion_are_those_of_the_oscillator(path, mechsim):
    omega = np.sqrt(50.0)
    (mode,) = json.loads(mechsim("dynamics", "modes", str(path), "--json").out)["modes"]
    assert mode["frequency"] == pytest.approx(omega / (2.0 * np.pi), rel=1e-9)
    run = ms.dynamics.run(path, initial={"x.q": 0.05}, duration=0.5)
    assert run.motion.joints["x"].value[-1] == pytest.approx(0.05 * np.cos(0.5 * omega), abs=1e-9)


def test_the_centre_of_mass_gives_the_size(path):
    path.write_text(OSCILLATOR.replace("centre = [0, 0, 0]", "centre = [0, 0.07, 0]"))
    assert ms.load(path).mechanism.characteristic_length == pytest.approx(0.07)
