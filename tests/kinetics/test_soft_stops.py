"""Soft stops of joints: runs against closed forms and scipy with events; statics, inverse dynamics."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mechsim as ms
from mechsim.io import gallery
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.kinetics.model import dynamic_model
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.simulation.dynamics.prescribed_motion import driven as simulate_driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_equilibrium, crosscheck_forward

G = 9.81


def loaded(tmp_path, text, name="model.toml"):
    (tmp_path / name).write_text(text)
    return ms.load(str(tmp_path / name), still=True)


def slide(tmp_path, limits, initial='J.q = "1 m"'):
    text = model_text(
        "soft_stops_body.toml", kind="prismatic", drivers='["J"]', lead="", limits=limits, initial=initial
    )
    return loaded(tmp_path, text)


def stop(depth, rate, k, d):
    """Return the force of a stop: a spring and damper that do not pull."""
    return np.where(depth > 0.0, np.maximum(k * depth + d * rate, 0.0), 0.0)


def integrated(acceleration, distances, start, end):
    """Return times and states at events and the end, by scipy with a restart at each event."""
    time, state, times, complete = 0.0, np.array(start, float), [], False
    while not complete:
        events = [lambda t, y, distance=distance: distance(y) for distance in distances]
        for event in events:
            event.terminal = True
        # a step off the event, which would be reached again
        first = time if not times else time + 1e-12
        state = state + (first - time) * np.array([*state[len(state) // 2 :], *acceleration(state)])
        solved = solve_ivp(
            lambda t, y: [*y[len(y) // 2 :], *acceleration(y)],
            (first, end),
            state,
            "DOP853",
            rtol=1e-13,
            atol=1e-14,
            events=events,
        )
        time, state, complete = solved.t[-1], solved.y[:, -1], solved.status == 0
        times += [] if complete else [time]
    return np.array(times), state


def test_a_ball_on_a_damped_stop_against_the_closed_form(tmp_path):
    """It touches at t1, leaves the damper's pull out at t1 + tc below the limit, and is free there at tb."""
    m, k, d = 2.0, 2000.0, 10.0
    run = ms.dynamics.run(
        slide(tmp_path, f"{{ lower = 0, stiffness = {k}, damping = {d} }}"), duration="0.6s"
    )
    decay, speed, rest = d / (2.0 * m), np.sqrt(2.0 * G), -m * G / k
    w = np.sqrt(k / m - decay**2)
    b = (-speed - decay * rest) / w

    def position(t):
        return rest + np.exp(-decay * t) * (-rest * np.cos(w * t) + b * np.sin(w * t))

    def rate(t):
        c, s = np.cos(w * t), np.sin(w * t)
        return np.exp(-decay * t) * ((decay * rest + b * w) * c + (rest * w - decay * b) * s)

    touched = np.sqrt(2.0 / G)
    contact = brentq(lambda t: k * position(t) + d * rate(t), 0.05, 0.15, xtol=1e-15)
    y, v = position(contact), rate(contact)
    assert y < 0.0
    free = (v - np.sqrt(v**2 + 2.0 * G * y)) / G
    exact = [touched, touched + contact, touched + contact + free]
    assert np.abs(np.array(run.events) - exact).max() < 1e-9
    during = (run.time >= exact[0]) & (run.time <= exact[1])
    error = run.motion.joints["J"].value[during] - position(run.time[during] - touched)
    assert np.abs(error).max() < 1e-10
    after = run.time[-1] - exact[1]
    assert abs(run.motion.joints["J"].value[-1] - (y + v * after - 0.5 * G * after**2)) < 1e-10
    # what is lost is the kinetic energy before less that after the contact, at the height of the limit
    assert abs(run.lost[-1] - 0.5 * m * (speed**2 - (v - G * free) ** 2)) < 1e-9
    assert run.energy_error < 1e-10
    assert (run.executed, run.note) == ("C", "")


@pytest.mark.long
def test_a_stop_without_damping_returns_all_energy(tmp_path):
    run = ms.dynamics.run(slide(tmp_path, "{ lower = 0, stiffness = 2000 }"), duration="2s")
    w, speed, rest = np.sqrt(2000.0 / 2.0), np.sqrt(2.0 * G), 2.0 * G / 2000.0
    contact = 2.0 * (np.pi - np.arctan(speed / w / rest)) / w
    period = 2.0 * np.sqrt(2.0 / G) + contact
    assert np.abs(np.array(run.events)[::2] - np.sqrt(2.0 / G) - period * np.arange(2)).max() < 1e-9
    assert run.lost[-1] == 0.0
    assert run.energy_error < 1e-10


@pytest.mark.long
def test_a_pendulum_between_two_stops(tmp_path):
    """Against scipy with events; MuJoCo, stepped through all contacts, converges with the step."""
    k, d, low, high = 40.0, 0.3, np.radians(-100.0), np.radians(-60.0)
    text = model_text(
        "soft_stops_pendulum.toml",
        limits='{ lower = "-100 deg", upper = "-60 deg", stiffness = 40, damping = "0.3 N m s/rad" }',
    )
    solver = loaded(tmp_path, text.replace('"-30 deg"', '"-80 deg"').replace('"1 rad/s"', '"4 rad/s"'))
    inertia, tau = 0.01 + 0.09, d / k

    def acceleration(y):
        push = stop(low - y[0], -y[1], k, d) - stop(y[0] - high, y[1], k, d)
        return [(push - G * 0.3 * np.cos(y[0])) / inertia]

    distances = [lambda y: y[0] - high, lambda y: low - y[0]]
    distances += [
        lambda y: y[0] - high + tau * y[1] if y[0] > high else 1.0,
        lambda y: low - y[0] - tau * y[1] if y[0] < low else 1.0,
    ]
    times, state = integrated(acceleration, distances, [np.radians(-80.0), 4.0], 0.3)
    run = ms.dynamics.run(solver, duration="0.3s", samples=30)
    assert len(times) == 3
    assert np.abs(np.array(run.events) - times).max() < 1e-9
    assert (
        np.abs(
            [run.motion.joints["hip"].value[-1] - state[0], run.motion.joints["hip"].rate[-1] - state[1]]
        ).max()
        < 1e-8
    )
    assert run.energy_error < 1e-10
    model = dynamic_model(solver)

    def error(substeps):
        stepped = stepped_run(
            model.mechanism, model.forces, {"hip": np.radians(-80.0)}, {"hip": 4.0}, run.time, substeps
        )
        return np.abs(stepped.motion.joints["hip"].value - run.motion.joints["hip"].value).max()

    # first order: MuJoCo's steps do not end at the contacts
    coarse, fine = error(10), error(80)
    assert fine < 0.4 * coarse
    assert fine < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["cylindrical", "screw"])
def test_stops_of_both_coordinates(kind, tmp_path):
    """Of a cylinder both coordinates move on their own; a screw has one mass for both."""
    lead, screw = 0.2, kind == "screw"
    limits = '{ way = { lower = "-0.1 m", stiffness = 3000, damping = 20 }, '
    limits += 'turn = { upper = "3 rad", stiffness = "50 N m/rad", damping = 0.2 } }'
    rates = 'J.turn.v = "9 rad/s"' if not screw else 'J.turn.v = "-4 rad/s"'
    solver = loaded(
        tmp_path,
        model_text(
            "soft_stops_body.toml",
            kind=kind,
            drivers="[]",
            limits=limits,
            lead=f"lead = {lead}" if screw else "",
            initial=rates,
        ),
    )
    pitch = lead / (2.0 * np.pi)

    def forces(y):
        along, about, v, w = y
        push = stop(-0.1 - along, -v, 3000.0, 20.0) - 2.0 * G
        return push, -stop(about - 3.0, w, 50.0, 0.2)

    def acceleration(y):
        push, twist = forces(y)
        if not screw:
            return [push / 2.0, twist / 0.03]
        turning = (push * pitch + twist) / (2.0 * pitch**2 + 0.03)
        return [pitch * turning, turning]

    distances = [lambda y: -0.1 - y[0], lambda y: y[1] - 3.0]
    distances += [
        lambda y: -0.1 - y[0] - y[2] / 150.0 if y[0] < -0.1 else 1.0,
        lambda y: y[1] - 3.0 + y[3] / 250.0 if y[1] > 3.0 else 1.0,
    ]
    start = [0.0, 0.0, -4.0 * pitch, -4.0] if screw else [0.0, 0.0, 0.0, 9.0]
    times, state = integrated(acceleration, distances, start, 1.0)
    run = ms.dynamics.run(solver, duration="1s", samples=50)
    assert len(times) >= 3
    assert np.abs(np.array(run.events) - times).max() < 1e-9
    reached = [run.motion.joints[f"J.{name}"].value[-1] for name in ("way", "turn")]
    assert np.abs(np.array(reached) - state[:2]).max() < 1e-8
    assert run.energy_error < 1e-10
    model = dynamic_model(solver)
    assert crosscheck_forward(run, model, initial_values(model, {})).passed


@pytest.mark.long
def test_rest_on_a_stop(tmp_path):
    """The penetration is the weight over the stiffness, the frequency that of the mass on the stop."""
    solver = slide(tmp_path, '{ lower = "0.2 m", stiffness = "500 N/m", damping = 4 }')
    (at_rest,) = ms.dynamics.equilibria(solver)
    assert abs(at_rest.q["J"] - (0.2 - 2.0 * G / 500.0)) < 1e-12
    assert at_rest.stable
    assert abs(at_rest.modes[0].frequency - np.sqrt(500.0 / 2.0) / (2.0 * np.pi)) < 1e-9
    assert abs(at_rest.modes[0].damping_ratio - 4.0 / (2.0 * np.sqrt(500.0 * 2.0))) < 1e-9
    assert crosscheck_equilibrium(at_rest, dynamic_model(solver)).passed


@pytest.mark.long
def test_a_stop_distinguishes_angles_that_differ_by_revolutions(tmp_path):
    """The arm rests on its stop, hangs a revolution above it, or balances upright."""
    solver = loaded(
        tmp_path,
        model_text("soft_stops_pendulum.toml", limits='{ lower = "-30 deg", stiffness = "300 N m/rad" }'),
    )
    rest = brentq(lambda q: 300.0 * (-np.pi / 6.0 - q) - G * 0.3 * np.cos(q), -1.0, 0.0, xtol=1e-15)
    reached = sorted((each.q["hip"], each.stable) for each in ms.dynamics.equilibria(solver))
    assert [stable for _, stable in reached] == [True, True, False]
    assert np.abs(np.array([q for q, _ in reached]) - [-np.pi / 2.0, rest, np.pi / 2.0]).max() < 1e-9


def test_drive_force_of_a_prescribed_motion(tmp_path):
    """Both methods have the force of the stop: it presses on the way in and does not pull on the way out."""
    solver = loaded(
        tmp_path,
        model_text("soft_stops_pendulum.toml", limits='{ upper = "30 deg", stiffness = 40, damping = 3 }'),
    )
    law = "40 deg*sin(2*pi*t)"
    driven = ms.load(str(tmp_path / "model.toml"), drive={"hip": law}, duration="1s")
    t = np.linspace(0.0, 1.0, 73)
    torque = ms.dynamics.prescribed(dynamic_model(driven), t=t).forces.drives["hip"]
    a, w = np.radians(40.0), 2.0 * np.pi
    q, v, acceleration = a * np.sin(w * t), a * w * np.cos(w * t), -a * w**2 * np.sin(w * t)
    exact = 0.1 * acceleration + G * 0.3 * np.cos(q) + stop(q - np.pi / 6.0, v, 40.0, 3.0)
    assert np.abs(torque - exact).max() < 1e-11
    solved = simulate_driven(driven, samples=72)
    assert np.abs(solved.forces.drives["hip"] - exact).max() < 1e-10
    assert solver.ranges == {}


def test_stops_are_written_and_read_back(tmp_path):
    limits = '{ lower = "-1 mm", upper = "2 m", stiffness = 100, damping = 3 }'
    solver = slide(tmp_path, limits)
    again = loaded(tmp_path, to_toml(solver), "again.toml")
    assert again.forces == solver.forces
    assert again.forces.stop_ranges == {"J": (-0.001, 2.0)}


def test_states_are_drawn_between_soft_stops(tmp_path):
    """`sample` and `show` know limits of a TOML file, hard or soft."""
    for law in ("restitution = 0.5", "stiffness = 20"):
        path = tmp_path / "four_bar.toml"
        path.write_text(model_text("soft_stops_four_bar.toml", law=law))
        crank = ms.sample(str(path), 50).qpos[:, 0]
        assert np.radians(-10.0) <= crank.min() < 0.0
        assert 1.0 < crank.max() <= np.radians(100.0)


def test_a_stop_that_takes_up_the_torque_of_the_crank_leaves_rounding_in_reactions(tmp_path):
    """2,000 N m of the stop cancel 2,000 N m of the drive, while the links transmit 1 N."""
    text = gallery.files()["chebyshev_lambda"].read_text().split("[formula]")[0]
    limits = 'limits = { upper = "54 deg", stiffness = "766 N m/rad", damping = "0.07 N m s/rad" }\n'
    (tmp_path / "model.toml").write_text(text.replace("[joints.crank]\n", f"[joints.crank]\n{limits}"))
    source = ms.load(str(tmp_path / "model.toml"))
    run = simulate_driven(source.mechanism, source.forces, speed=1.0, samples=24)
    model = dynamic_model(source)
    verdict = crosscheck_driven(run, model)
    assert verdict.passed, verdict
    assert run.forces.torque.max() > 2000.0
    heavier = model.with_forces(replace(model.forces, gravity=(0.0, -9.82, 0.0)))
    assert not crosscheck_driven(run, heavier).passed
