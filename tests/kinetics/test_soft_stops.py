"""Soft stops of joints: runs against closed forms and scipy with events; statics, inverse dynamics."""

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics.model import dynamic_model
from mechsim.simulation.dynamics.forward_run import stepped_run

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
