"""Reactions along runs: a pendulum in closed form, impulse of the frame, and forces that are not covered."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import stated_mechanism
from scipy.integrate import simpson

import mechsim as ms

MASS, ARM, INERTIA, GRAVITY = 1.0, 2.0, 0.1, 9.80665
WEIGHT = ms.Forces(gravity=(0.0, -GRAVITY, 0.0))
# of this mass, arm and moment of inertia about its centre
PENDULUM = stated_mechanism("run_reactions_pendulum.toml")


@pytest.mark.parametrize("driver", [(), "pin"])
def test_reaction_of_a_released_pendulum(driver):
    """From horizontal rest: w^2 = 2 m g l sin(fall) / I0 and alpha = m g l cos(fall) / I0."""
    model = ms.dynamics.dynamic_model(replace(PENDULUM, driver=driver), WEIGHT)
    run = ms.dynamics.run(model, WEIGHT, duration=3.0, samples=50)
    fall = -run.motion.joints["pin"].value
    k = MASS * GRAVITY * ARM / (INERTIA + MASS * ARM**2)
    outward = np.stack([np.cos(fall), -np.sin(fall)], 1)
    down = np.stack([-np.sin(fall), -np.cos(fall)], 1)
    centre = ARM * (k * np.cos(fall)[:, None] * down - 2.0 * k * np.sin(fall)[:, None] * outward)
    reaction = ms.dynamics.joint_reactions(model, run)["pin"]
    exact = MASS * (centre + np.array([0.0, GRAVITY]))
    assert np.abs(reaction.force[:, :2] - exact).max() < 1e-10 * np.abs(exact).max()
    assert np.abs(reaction.moment).max() < 1e-12


def test_a_motor_on_the_crank_keeps_the_balance_and_one_on_another_joint_is_rejected():
    linkage = ms.catalog.make("four_bar")
    motor = replace(WEIGHT, motor=ms.motors.ConstantTorque(0.001))
    model = ms.dynamics.dynamic_model(linkage, motor)
    run = ms.dynamics.run(linkage, motor, duration=0.1, samples=400)
    forces = ms.dynamics.joint_reactions(model, run)
    frame = sum(
        r.force if r.by == "ground" else -r.force for r in forces.values() if "ground" in (r.link, r.by)
    )
    links = [(link.inertia, run.motion.links[link.name]) for link in model.mechanism.links]
    mass = sum(inertia.mass for inertia, _ in links)
    momentum = sum(
        inertia.mass * (m.velocity + np.cross(m.angular_velocity, m.rotation @ inertia.centre))
        for inertia, m in links
    )
    # Newton for the whole mechanism, integrated over the run
    impulse = simpson(frame + mass * np.array(WEIGHT.gravity), x=run.time, axis=0)
    assert np.abs(impulse - momentum[-1] + momentum[0]).max() < 1e-7 * np.abs(impulse).max()
    steered = replace(WEIGHT, controllers=(ms.Controller("A", "0.01 + 0*A.q"),))
    run = ms.dynamics.run(linkage, steered, duration=0.05, samples=5)
    with pytest.raises(ms.InputError, match="not a driver"):
        ms.dynamics.joint_reactions(ms.dynamics.dynamic_model(linkage, steered), run)


@pytest.mark.long
def test_friction_by_the_load_acts_in_the_balance_of_the_rocker():
    """Moments about the rocker's pin: force and friction of B, friction of the pin, weight."""
    linkage, mu, radius = ms.catalog.make("four_bar"), 0.3, 0.005
    rubbing = replace(WEIGHT, friction=(ms.Friction("B", coefficient=mu, pin_radius=radius),))
    model = ms.dynamics.dynamic_model(linkage, rubbing)
    run = ms.dynamics.run(linkage, rubbing, initial={"crank.v": 30.0}, duration=0.05, samples=20)
    force = ms.dynamics.joint_reactions(model, run)["B"]
    assert force.link == "rocker"
    rocker, pin = run.motion.links["rocker"], model.mechanism.joint("rocker")
    pivot = np.array(pin.a.point)
    inertia = next(link.inertia for link in model.mechanism.links if link.name == "rocker")
    assert pin.b.point == (0.0, 0.0, 0.0)
    arm = rocker.rotation @ inertia.centre
    about_pin = inertia.moments[2][2] + inertia.mass * np.sum(np.square(inertia.centre))
    moment = np.cross(force.point - pivot, force.force)[:, 2] - inertia.mass * GRAVITY * arm[:, 0]
    # at the start the joint stands still
    assert abs(run.motion.joints["B"].rate[0]) < 1e-12
    slide = np.sign(run.motion.joints["B"].rate) * (run.time > 0.0)
    moment -= mu * radius * np.linalg.norm(force.force, axis=1) * slide
    exact = about_pin * rocker.angular_acceleration[:, 2]
    assert np.abs(moment - exact).max() < 1e-9 * np.abs(exact).max()
    assert mu * radius * np.linalg.norm(force.force, axis=1).max() > 1e-3 * np.abs(exact).max()
