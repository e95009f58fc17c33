"""A tendon of constant length and a quadratic coupling that moves with it, stepped: a closed form."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms

CRANK, ROD, START = 0.03, 0.1, 0.13


@pytest.mark.long
def test_a_slider_on_a_tendon_and_its_follower_move_as_the_closed_form(tmp_path):
    """x = r cos q + sqrt(L^2 - r^2 sin^2 q), and y = 0.2 x + 5 x^2 with x from the start; differentiated.

    MuJoCo's equalities omit the velocity-product terms.
    """
    (tmp_path / "f.xml").write_text(model_text("tendon_slider.xml"))
    speed = 20.0 * np.pi
    run = ms.simulate(ms.load(tmp_path / "f.xml"), speed=speed, turns=1, method="step")
    cos, sin = np.cos(run.motion.angle), np.sin(run.motion.angle)
    root = np.sqrt(ROD**2 - (CRANK * sin) ** 2)
    x = CRANK * cos + root - START
    rate = speed * (-CRANK * sin - CRANK**2 * sin * cos / root)
    second = speed**2 * (
        -CRANK * cos - CRANK**2 * (cos**2 - sin**2) / root - (CRANK**2 * sin * cos) ** 2 / root**3
    )
    slide, lift = run.motion.joints["slide"], run.motion.joints["lift"]
    assert run.outcome == "passed"
    assert slide.value == pytest.approx(x, abs=1e-10)
    assert slide.acceleration == pytest.approx(second, abs=1e-6)
    assert lift.value == pytest.approx(0.2 * x + 5.0 * x**2, abs=1e-10)
    assert lift.acceleration == pytest.approx(0.2 * second + 10.0 * (rate**2 + x * second), abs=1e-6)
