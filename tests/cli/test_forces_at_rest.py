"""Force analysis at rest, under constant motion laws: closed forms of levers, arms and a slider-crank."""

import json

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms

BELL = model_text("forces_at_rest_bell.toml")
# links of 2 kg and 1 kg, 0.5 m and 0.4 m long, with a spring of 3 N m/rad in the elbow
ARM = model_text("forces_at_rest_arm.toml")
SHOULDER, ELBOW = np.deg2rad(30.0), np.deg2rad(20.0)


@pytest.fixture
def peaks(mechsim, file):
    def run(source, *options):
        if "\n" in source:
            path = file(source)
            source = path
        output = mechsim("dynamics", "inverse", source, "--json", "--samples", "6", *options)
        data = json.loads(output.out)
        assert data["passed"]
        return data

    return run


def test_a_bell_crank_at_rest_has_the_force_of_its_loads(peaks):
    data = peaks(BELL)
    assert data["reactions"]["pivot"]["force"]["largest"] == pytest.approx(np.hypot(100.0, 200.0))
    # 200 N at 0.1 m balances 100 N at 0.2 m
    assert data["drives"]["pivot"]["largest"] == pytest.approx(0.0, abs=1e-12)
    data = peaks(BELL.replace("-200", "-150"))
    assert data["drives"]["pivot"]["largest"] == pytest.approx(100.0 * 0.2 - 150.0 * 0.1)


def test_a_serial_arm_at_rest_holds_weight_and_spring(peaks):
    data = peaks(ARM)
    reach = 0.5 * np.cos(SHOULDER) + 0.2 * np.cos(SHOULDER + ELBOW)
    shoulder = 9.81 * (2.0 * 0.25 * np.cos(SHOULDER) + reach)
    elbow = 9.81 * 0.2 * np.cos(SHOULDER + ELBOW) + 3.0 * ELBOW
    assert data["drives"]["shoulder"]["largest"] == pytest.approx(shoulder)
    assert data["drives"]["elbow"]["largest"] == pytest.approx(elbow)
    assert data["reactions"]["shoulder"]["force"]["largest"] == pytest.approx(3.0 * 9.81)


def test_a_driver_at_rest_holds_its_link_while_another_moves(peaks):
    data = peaks(ARM, "--drive", "shoulder=30deg", "--drive", "elbow=1e-3deg*t", "--duration", "1s")
    torque = 9.81 * np.cos(SHOULDER) * (2.0 * 0.25 + 0.5 + 0.2)
    assert data["drives"]["shoulder"]["largest"] == pytest.approx(torque, rel=1e-4)


def test_a_slider_crank_at_rest_holds_a_force_on_the_slider(peaks, tmp_path):
    crank, rod, angle, force = 0.04, 0.15, np.deg2rad(50.0), 80.0
    loads = tmp_path / "loads.csv"
    loads.write_text("time,B.fx\n0,-80\n1,-80\n")
    options = ("--drive", "crank=50deg", "--load", str(loads), "--gravity", "0,0,0")
    data = peaks("slider_crank", *options, "--set", "crank=40mm", "--set", "rod=150mm", "--set", "offset=0mm")
    swing = np.arcsin(crank * np.sin(angle) / rod)
    assert data["reactions"]["A"]["force"]["largest"] == pytest.approx(force / np.cos(swing))
    # F dx/dq of the slider at crank cos q + rod cos swing
    rate = crank * np.sin(angle) + crank * np.cos(angle) * np.tan(swing)
    assert abs(data["drives"]["crank"]["largest"]) == pytest.approx(force * rate)


def test_certify_takes_open_chains(mechsim, file):
    """Two serial joints: the drivers give every coordinate, whatever the lengths."""
    arm = file(ARM)
    data = json.loads(mechsim("certify", arm, "--json").out)
    assert (data["certified"], data["proven"], data["equations"]) == (True, pytest.approx(1.0), 0)
    assert data["tube"] == 0.0


def test_weight_acts_where_no_forces_are_stated(mechsim, tmp_path):
    """A pendulum with m g d = 2 kg * 9.81 m/s2 * 0.5 m, at rest at the horizontal and let go from it."""
    pendulum = tmp_path / "pendulum.toml"
    pendulum.write_text(
        'name = "pendulum"\ndrivers = ["p"]\nmotion_laws = { p = "0deg" }\n'
        "[links.bob]\ninertia = { mass = 2.0, centre = [0.5, 0, 0], moments = [0.1, 0.1, 0.1] }\n"
        '[joints.p]\nkind = "revolute"\na = { link = "ground" }\nb = { link = "bob" }\n'
    )
    torque, inertia = 2.0 * 9.81 * 0.5, 0.1 + 2.0 * 0.5**2
    rest = json.loads(mechsim("dynamics", "inverse", str(pendulum), "--json", "--samples", "6").out)
    assert rest["gravity"] == [0.0, -9.81, 0.0]
    assert rest["drives"]["p"]["largest"] == pytest.approx(torque, rel=1e-9)
    assert "gravity: 0, -9.81, 0 m/s2" in mechsim("dynamics", "inverse", str(pendulum)).out
    weightless = json.loads(mechsim("dynamics", "inverse", str(pendulum), "--gravity", "0,0,0", "--json").out)
    assert weightless["gravity"] == [0.0, 0.0, 0.0]
    solver = ms.load(pendulum)
    for source in (solver, solver.mechanism):
        run = ms.dynamics.run(source, initial={"p.q": 0.0}, duration=0.1, samples=2)
        assert run.motion.joints["p"].acceleration[0] == pytest.approx(-torque / inertia, rel=1e-9)
    free = ms.dynamics.run(solver, ms.Forces(), initial={"p.q": 0.0}, duration=0.1, samples=2)
    assert free.motion.joints["p"].acceleration == pytest.approx(0.0, abs=1e-12)
