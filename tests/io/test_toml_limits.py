"""Limits of joints in a TOML file: stops with a coefficient of restitution of their own."""

import numpy as np
from model_files import model_text

import mechsim as ms
from mechsim.io.toml_writer import to_toml


def ball(tmp_path, limits, name="ball.toml"):
    path = tmp_path / name
    path.write_text(model_text("toml_limits_ball.toml", limits=limits))
    return ms.load(str(path), still=True)


def test_a_bouncing_ball(tmp_path):
    """Dropped from H it hits the floor at sqrt(2 H / g), and after its n-th rebound 2 e^n of that later."""
    e, fall = 0.5, np.sqrt(2.0 / 9.81)
    run = ms.dynamics.run(ball(tmp_path, f"{{ lower = 0, restitution = {e} }}"), duration="1.3s", samples=40)
    first = np.array(run.events[:4])
    exact = fall * (1.0 + 2.0 * np.cumsum([0.0, e, e**2, e**3]))
    assert np.abs(first - exact).max() < 1e-9
    assert run.energy_error < 1e-10
    # all impacts end at sqrt(2 H / g) (1 + e) / (1 - e)
    rests = ms.dynamics.run(ball(tmp_path, f"{{ lower = 0, restitution = {e} }}"), duration="2s")
    assert rests.outcome == "stopped"
    assert abs(rests.events[-1] - fall * (1.0 + e) / (1.0 - e)) < 1e-6


def test_each_joint_has_its_own_restitution(tmp_path):
    """Without one of its own a joint has that of the run."""
    own, plain = (ball(tmp_path, text) for text in ("{ lower = 0, restitution = 0.5 }", "{ lower = 0 }"))
    events = [ms.dynamics.run(x, duration="1.3s", restitution=0.8).events[1] for x in (own, plain)]
    fall = np.sqrt(2.0 / 9.81)
    assert np.abs(np.array(events) - fall * np.array([2.0, 2.6])).max() < 1e-9


def test_limits_are_written_and_read_back(tmp_path, file):
    solver = ball(tmp_path, '{ lower = "-1 mm", upper = "2 m", restitution = 0.25 }')
    again = file(to_toml(solver))
    read = ms.load(again, still=True)
    assert (read.ranges, read.restitution) == ({"height": (-0.001, 2.0)}, {"height": 0.25})
