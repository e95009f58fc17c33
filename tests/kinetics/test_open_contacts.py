"""Contacts that open and ropes that go slack in forward runs, against piecewise closed forms."""

import numpy as np
import pytest
from model_files import load_model, model_text

import mechsim as ms
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics import dynamic_model
from mechsim.simulation.dynamics.forward_run import stepped_run

G = 9.81
# a ball on a rope over a drum at rest
BALL = model_text("open_contacts_ball.toml")
# polar coordinates: a ball on a massless telescope, whose length a string limits to 0.5 m
PENDULUM = model_text("open_contacts_pendulum.toml")


def test_a_string_goes_slack_and_catches_the_ball_on_its_parabola(file):
    length, first = 0.5, 2 * np.pi / 3
    # the string pulls while v**2 > g L cos(angle from the top): speed at the bottom for slack at 120 deg
    speed = np.sqrt(G * length * (2 - 3 * np.cos(first)))
    run = ms.dynamics.run(
        file(PENDULUM),
        initial={"swing.v": speed / length},
        duration=0.9,
        samples=300,
    )
    slack, caught = run.openings["string"][0]
    velocity = np.sqrt(-G * length * np.cos(first))
    # slackness counts from a tension of -1e-9 of the largest force, 3e-10 s late; the flight magnifies that.
    # The parabola meets the circle again where t = 4 v sin(angle) / g from its start
    assert caught - slack == pytest.approx(4 * velocity * np.sin(first) / G, abs=4e-9)
    air = (run.time > slack) & (run.time < caught)
    t = run.time[air] - slack
    x = length * np.sin(first) + velocity * np.cos(first) * t
    y = -length * np.cos(first) + velocity * np.sin(first) * t - 0.5 * G * t**2
    # the instant of slackness is known to 1e-9 s
    assert np.abs(run.motion.points["B"].position[air, :2] - np.stack([x, y], -1)).max() < 1e-8
    # the string takes the radial part of the velocity
    end = caught - slack
    position = (
        np.array([length * np.sin(first), -length * np.cos(first)])
        + velocity * end * np.array([np.cos(first), np.sin(first)])
        - [0, 0.5 * G * end**2]
    )
    rate = velocity * np.array([np.cos(first), np.sin(first)]) - [0, G * end]
    assert run.lost[-1] == pytest.approx(0.5 * 0.2 * (position @ rate / length) ** 2, rel=1e-7)


def test_a_ball_on_a_rope_is_drawn_without_its_gap(file):
    from mechsim.pictures.render.frame_poses import frame_poses
    from mechsim.shapes.joints import link_shapes

    path = file(BALL)
    run = ms.dynamics.run(path, initial={"ball.v": 1}, duration=0.1, samples=4)
    assert {*run.motion.links} == {"ball"}
    mechanism = ms.load(path, still=True).mechanism
    assert link_shapes(mechanism)["ball"]
    # a ball has no crank whose angle a picture could state
    assert frame_poses(mechanism, run.motion).instant(2) == "0.050 s"


@pytest.mark.long
def test_each_contact_has_its_own_restitution(file):
    ball = file(BALL.replace("rope = {", "restitution = 0.5\nrope = {"))
    for path in (ball, file(to_toml(ms.load(ball, still=True)))):
        run = ms.dynamics.run(ms.load(path, still=True), initial={"ball.v": 2.0}, duration=2.0)
        falls = 2 * 2 / G * np.cumsum(0.5 ** np.arange(6))
        assert np.abs(np.array(run.events[:6]) - falls).max() < 1e-12
    cam = model_text("open_contacts_cam.toml", closure="force")
    own = cam.replace("base_radius", "restitution = 0.4\nbase_radius")
    runs = [
        ms.dynamics.run(
            ms.load(file(text), drive={"crank": "20*pi*t"}),
            prescribed=["crank"],
            duration=0.11,
            restitution=restitution,
            samples=11,
        )
        for text, restitution in ((cam, 0.4), (own, 0.0), (cam, 0.0))
    ]
    stated, own_one, none = (run.motion.joints["guide"].rate[-1] for run in runs)
    assert own_one == stated
    assert abs(none - stated) > 1e-3


# law of cosines: arm 70 mm, centres 80 mm, base and roller 38 mm
START = np.arccos((0.08**2 + 0.07**2 - 0.038**2) / (2 * 0.08 * 0.07))


@pytest.mark.long
def test_a_light_cam_does_not_make_its_contact_compliant_in_mujoco():
    model = dynamic_model(load_model("swinging_cam.toml", moment=1e-9, still=True))
    stepped = stepped_run(model.mechanism, model.forces, {}, {}, np.linspace(0.0, 1.0, 101), 10)
    pivot = stepped.motion.joints["pivot"].value
    # 1e-4 rad with the mobility of the cam, which does not move
    assert np.abs(pivot + START).max() < 1e-7
