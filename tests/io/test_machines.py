"""The machines: each against the answer that its file states, computed here by other equations."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import mechsim as ms
from mechsim.io import gallery
from mechsim.kinetics import dynamic_model, prescribed
from mechsim.kinetics.contact_forces import contact_forces

ANGLES = np.linspace(0.0, 2 * np.pi, 73)
G = 9.81


def polynomial_345(u):
    return 10 * u**3 - 15 * u**4 + 6 * u**5


def cycloidal(u):
    return u - np.sin(2 * np.pi * u) / (2 * np.pi)


def test_files_state_source_and_known_answer():
    for path in gallery.machines().values():
        head = path.read_text().split("name =")[0]
        assert "# Source: " in head
        assert "# Known: " in head
    assert set(ms.list()["machines"]) == set(gallery.machines())


@pytest.mark.long
def test_the_strut_of_the_landing_gear_takes_up_the_drop():
    def falls(_, state):
        s, v = state
        return v, -G + (6000 * (1 + s / 0.45) ** -1.3 - 9000 * v * abs(v)) / 1200

    run = ms.dynamics.run(
        ms.load("landing_gear", still=True), initial={"strut.v": -3.0}, duration=1.0, samples=50
    )
    options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}
    exact = solve_ivp(falls, (0, 1), [0.0, -3.0], t_eval=run.time, **options)
    assert run.motion.joints["strut"].value == pytest.approx(exact.y[0], abs=1e-9)
    # at length zero the force of the gas is infinite and changes its direction: no equilibrium
    (rest,) = ms.dynamics.equilibria(dynamic_model(ms.load("landing_gear", still=True)))
    length = 0.45 * (6000 / (1200 * G)) ** (1 / 1.3)
    assert rest.q["strut"] == pytest.approx(length - 0.45, abs=1e-12)
    assert rest.modes[0].eigenvalue.imag == pytest.approx(np.sqrt(1.3 * G / length), rel=1e-11)


def test_the_swing_arm_of_the_suspension_rests_where_virtual_work_vanishes():
    def work(q):
        """W dy - k (l - l0) dl per rad."""
        c, s = np.cos(q), np.sin(q)
        x, y = -0.15 * c - 0.06 * s - 0.04, -0.15 * s + 0.06 * c - 0.11
        length = np.hypot(x, y)
        stretching = (x * (0.15 * s - 0.06 * c) + y * (-0.15 * c - 0.06 * s)) / length
        return 700 * -0.43 * c - 75000 * (length - 0.21) * stretching

    (rest,) = ms.dynamics.equilibria(dynamic_model(ms.load("bicycle_suspension", still=True)))
    assert rest.q["pivot"] == pytest.approx(brentq(work, -0.4, 0.4, xtol=1e-14), abs=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.12])
def test_the_toggle_clamp_loses_what_its_pins_rub(friction):
    q, arm, loss = np.deg2rad(80.0), 0.06, friction * 0.005
    model = dynamic_model(ms.load("toggle_clamp", set={"coefficient": friction}))
    if not friction:
        model = model.with_forces(replace(model.forces, friction=()))
    # slow, so that the masses need no torque
    torque = prescribed(model, [q], 1e-7).forces.torque[0]
    knee, ram = arm * np.array([np.cos(q), np.sin(q)]), np.array([0.0, 2 * arm * np.sin(q)])

    def balance(values):
        """Moments on the strut about the knee, and on the lever about its pivot."""
        across, moment = values
        force = np.array([across, -1000.0])
        rubbed = loss * np.hypot(*force)
        x, y = ram - knee
        # the strut turns at -1 rad/s, the lever at 1, the ram not
        return [
            x * force[1] - y * force[0] + 3 * rubbed - rubbed,
            knee[0] * force[1] - knee[1] * force[0] - 2 * rubbed + moment,
        ]

    exact = fsolve(balance, [1000.0 / np.tan(q), 2000.0 * arm * np.cos(q)], xtol=1e-14)[1]
    assert torque == pytest.approx(exact, rel=1e-11)


def test_the_valve_of_the_engine_follows_its_cam_at_half_the_angle():
    motion = ms.load("engine").solve(2 * ANGLES)
    q = motion.angle
    piston = 0.04 * np.sin(q) + np.sqrt(0.13**2 - (0.04 * np.cos(q)) ** 2)
    assert motion.points["piston"].position[:, 1] == pytest.approx(piston, abs=1e-14)
    over, cam = np.deg2rad(75.0), (q / 2) % (2 * np.pi)
    rise = polynomial_345(np.clip(cam / over, 0, 1)) - polynomial_345(np.clip(cam / over - 1, 0, 1))
    assert motion.points["valve"].position[:, 1] == pytest.approx(0.22 + 0.005 * rise, abs=1e-14)


def test_the_gripper_presses_with_the_limit_of_its_servo():
    run = ms.dynamics.run(ms.load("spring_gripper", still=True), duration=4.0)

    def torque(q):
        """Of the spring on both fingers: its length is span - 2 finger cos(q) over both tips."""
        length = 0.03 + 2 * 0.08 * np.cos(np.pi - q)
        return 2000 * (0.06 - length) * 2 * 0.08 * np.sin(q) - 1.5

    assert run.motion.joints["left"].value[-1] == pytest.approx(brentq(torque, 1.6, 2.1), abs=1e-9)


def test_the_followers_of_the_window_keep_their_distance_on_the_rail():
    model = ms.load("window_regulator")
    motion = model.solve([0.1, 0.3])
    lower, upper = (motion.joints[name].value for name in ("lower", "upper"))
    ends = [np.array([0.02 * np.sin(np.pi * s / 0.6), s]) for s in (lower, upper)]
    along = (ends[1] - ends[0]) / 0.15
    assert np.hypot(*along) == pytest.approx(np.ones(2), abs=1e-13)
    pin = np.array([0.25 - 0.3 * np.cos(motion.angle), 0.2 - 0.3 * np.sin(motion.angle)])
    assert ((pin - ends[0]) * along).sum(0) == pytest.approx(0.05 * np.ones(2), abs=1e-13)


@pytest.mark.long
def test_the_ram_of_the_cam_press_lifts_off_on_its_way_back():
    speed, span = 70.0, np.deg2rad(120.0)
    model = dynamic_model(ms.load("cam_press"))

    def force(angle):
        u = (angle - np.pi) / span
        s, second = 0.02 * (1 - cycloidal(u)), -0.02 * 2 * np.pi * np.sin(2 * np.pi * u) / span**2
        return 2.0 * (second * speed**2 + G) + 5000 * (0.01 + s)

    times = ANGLES / speed
    state = lambda t: (speed * t, np.full_like(t, speed), np.zeros_like(t))  # noqa: E731
    changes = np.array(contact_forces(model, state, times)["contact"].changes) * speed
    ends = [
        brentq(force, np.pi + low * span, np.pi + high * span) for low, high in ((0.0, 0.25), (0.25, 0.6))
    ]
    assert changes[changes > np.pi] == pytest.approx(ends, abs=1e-9)


def test_needle_and_take_up_lever_follow_their_formulas():
    motion = ms.load("needle_drive").solve(ANGLES)
    bar = 0.015 * np.sin(ANGLES) - np.sqrt(0.04**2 - (0.015 * np.cos(ANGLES)) ** 2)
    assert motion.points["needle"].position[:, 1] == pytest.approx(bar - 0.06, abs=1e-14)
    up, down = np.deg2rad(130.0), np.deg2rad(150.0)
    rise = cycloidal(np.clip(ANGLES / up, 0, 1)) - polynomial_345(np.clip((ANGLES - np.pi) / down, 0, 1))
    # law of cosines of pivot distance, arm, and the radius of the pitch circle
    first = np.arccos((0.055**2 + 0.045**2 - 0.022**2) / (2 * 0.055 * 0.045))
    angle = first + np.deg2rad(20.0) * rise
    lever = motion.joints["lever"].value
    assert np.abs(lever - lever[0]) == pytest.approx(np.abs(angle - angle[0]), abs=1e-12)


def test_the_tip_of_the_rotor_draws_an_epitrochoid():
    motion = ms.load("wankel").solve(3 * ANGLES)
    q = motion.angle
    exact = 0.015 * np.array([np.cos(q), np.sin(q)]) + 0.105 * np.array([np.cos(q / 3), np.sin(q / 3)])
    assert motion.points["tip"].position[:, :2] == pytest.approx(exact.T, abs=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("name", gallery.machines())
def test_machines_are_shown_balanced_and_drawn(name, mechsim, tmp_path):
    text = gallery.machines()[name].read_text()
    bare = tmp_path / f"{name}.toml"
    # a link that only joints name comes after the parts of a joint on a cam or curve
    bare.write_text(
        "".join(line for line in text.splitlines(True) if not line.startswith("outline = [[0, 0, 0]]"))
    )
    drawn = ["render"] if "drivers" in text else []
    for command in ("show", "dynamics statics", *drawn):
        output = ["-o", "still.png"] if command in drawn else []
        result = mechsim(*command.split(), str(bare), *output)
        assert result.code == 0, (command, result.err)
        # the parts of a joint on a cam or curve are not shown
        assert "~" not in result.out


@pytest.mark.long
def test_limits_on_one_side_springs_and_initial_states_are_no_mistakes(file):
    expression = 'force = "-2 N*exp(20*l)"'
    clamp = model_text("latch_clamp.toml").replace('stiffness = "40 N/mm"\nrest = 50', expression)
    assert "exp" in clamp
    ranged = clamp.replace('limits = { upper = "174 deg"', 'limits = { lower = "120 deg", upper = "174 deg"')
    for state, rules in (("", {"MS105"}), ('[initial]\nhandle.q = "130 deg"\n', set[str]())):
        assert {
            finding.rule for finding in ms.check(file(ranged + state)) if finding.severity != "note"
        } == rules
    assert ms.check(file(clamp), select=["MS103", "MS105", "MS201"]) == []
    # both assemblies of the rod, by Pythagoras, are within a range without a lower end
    tips = [
        each["tip"][0] for each in ms.assemblies(ms.load(file(clamp), still=True), np.deg2rad(100.0)).points
    ]
    x, y = 0.04 * np.cos(np.deg2rad(100.0)), 0.04 * np.sin(np.deg2rad(100.0))
    assert np.allclose(tips, x + 0.02 + np.sqrt(0.09**2 - y**2) * np.array([1.0, -1.0]), rtol=0, atol=1e-12)


def test_the_rods_of_peaucellier_guide_a_mass_on_a_straight_line():
    model = ms.load("peaucellier_rods", still=True)
    motion = model.solve(np.linspace(-0.5, 0.5, 11))
    assert motion.points["P"].position[:, 0] == pytest.approx(0.0055 / 0.06, abs=1e-14)

    def masses(q):
        """Positions of A, B and P, (6,)."""
        reach, along = 0.06 * np.cos(q / 2), q / 2
        apart = np.arccos((reach**2 + 0.0055) / (0.16 * reach))
        distances = (0.08, along + apart), (0.08, along - apart), (0.0055 / reach, along)
        return np.ravel([[r * np.cos(angle), r * np.sin(angle)] for r, angle in distances])

    weights = np.repeat([0.05, 0.05, 0.1], 2)

    def falls(_, state):
        """Rates of q and q' by (m x'^2)' = - m g y', with x'' by a difference of complex steps."""
        q, v = state
        first, second = (masses(q + k * 1e-4 + 1e-30j).imag / 1e-30 for k in (0.0, 1.0))
        second_derivative = (second - masses(q - 1e-4 + 1e-30j).imag / 1e-30) / 2e-4
        inertia = 2e-4 + weights @ first**2
        return v, -(weights * first) @ (second_derivative * v**2 + np.tile([0.0, G], 3)) / inertia

    run = ms.dynamics.run(model, initial={"crank.q": 0.2, "crank.v": -1.5}, duration=0.08, samples=16)
    assert run.outcome == "done"
    options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-11}
    exact = solve_ivp(falls, (0, 0.08), [0.2, -1.5], t_eval=run.time, **options)
    assert run.motion.joints["crank"].value == pytest.approx(exact.y[0], abs=1e-7)
