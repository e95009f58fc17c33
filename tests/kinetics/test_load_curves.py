"""Load-displacement curves past limit points, against the truss of von Mises and inverse dynamics."""

import json

import numpy as np
import pytest
from model_files import changed_model

import mechsim as ms
from mechsim.kinetics.model import dynamic_model

STIFFNESS, REST = 1000.0, 1.05
TRUSS = "load_curves_truss.toml"


def load_at(y):
    """Return the load that holds the node at a height: von Mises' truss of two springs."""
    length = np.hypot(1.0, y)
    return 2.0 * STIFFNESS * (length - REST) * y / length


@pytest.mark.long
def test_the_truss_of_von_mises():
    """Its limit points are at y^2 = (L0 b^2)^(2/3) - b^2."""
    curve = ms.dynamics.load_curve(changed_model(TRUSS), "P.y", between=(-0.5, 0.5))
    assert (curve.displacement.min(), curve.displacement.max()) == (-0.5, 0.5)
    assert np.abs(curve.load - load_at(curve.displacement)).max() < 1e-9
    limit = np.sqrt(REST ** (2.0 / 3.0) - 1.0)
    order = np.argsort(curve.limit_points[:, 1])
    assert (
        np.abs(curve.limit_points[order] - [[-load_at(limit), -limit], [load_at(limit), limit]]).max() < 1e-8
    )
    # unstable between the limit points
    away = np.abs(np.abs(curve.displacement) - limit) > 0.02
    assert (curve.stable == (np.abs(curve.displacement) > limit))[away].all()


@pytest.mark.long
def test_a_load_beyond_the_limit_point_snaps_through():
    """A dead load 1 % below the limit stays above it with damping, one 1 % above goes to the other side."""
    limit = load_at(np.sqrt(REST ** (2.0 / 3.0) - 1.0))
    ends = []
    for factor in (0.99, 1.01):
        load = f'[forces.loads.down]\nat = "P"\nforce = [0, {factor * limit:.17g}, 0]\n'
        path = changed_model(TRUSS, more=load + "[forces.friction.height]\nviscous = 20\n")
        run = ms.dynamics.run(path, initial={"height.q": 0.25}, duration="8s", until="P.y=-0.1")
        ends.append((run.outcome, run.motion.points["P"].position[-1, 1]))
    assert [outcome for outcome, _ in ends] == ["time over", "done"]
    assert abs(load_at(ends[0][1]) / (0.99 * limit) - 1.0) < 1e-3
    assert abs(ends[1][1] + 0.1) < 1e-9


@pytest.mark.long
def test_the_curve_of_a_crank_is_that_of_inverse_dynamics():
    curve = ms.dynamics.load_curve("four_bar", "crank", initial={"crank.q": 1.0}, between=(-1.0, 3.0))
    order = np.argsort(curve.displacement)
    model = dynamic_model(ms.load("four_bar", still=True))
    torque = ms.dynamics.prescribed(model, curve.displacement[order], 1e-9).forces.torque
    assert (curve.displacement.min(), curve.displacement.max()) == (-1.0, 3.0)
    assert np.abs(torque - curve.load[order]).max() < 1e-12


def test_dead_centres_are_poles_of_the_load_and_no_limit_points():
    """A torque T on the crank is held by -T/x' on the slide, least where its rate x' is largest."""
    press = changed_model("load_text_slider.toml", more="[forces]\ngravity = [0, 0, 0]\ncrank_torque = 2\n")
    limits = ms.dynamics.load_curve(press, "slide").limit_points[:, 0]
    angle = np.linspace(0.0, 2.0 * np.pi, 100001)
    x = 0.03 * np.cos(angle) + np.sqrt(0.095**2 - (0.03 * np.sin(angle) - 0.01) ** 2)
    rate = np.gradient(x, angle)
    assert np.sort(limits) == pytest.approx([-2.0 / rate.max(), -2.0 / rate.min()], rel=1e-7)


@pytest.mark.long
def test_the_command_prints_limit_points(tmp_path, mechsim):
    table = tmp_path / "curve.csv"
    command = ["dynamics", "statics", changed_model(TRUSS), "--curve", "P.y=-0.4:0.4", "--method", "none"]
    answer = mechsim(*command, "--json", "-o", str(table))
    assert answer.code == 0
    data = json.loads(answer.out)["curve"]
    assert len(data["limit_points"]) == 2
    columns = np.genfromtxt(table, delimiter=",", names=True)
    assert np.abs(columns["load"] - load_at(columns["displacement"])).max() < 1e-9
