"""Power that friction takes, against the rates of joints and the angular velocity of a ball."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import rscr

import mechsim as ms

FOUR = ("viscous", "coulomb", "viscous_turn", "coulomb_turn")


def lost(friction, angles):
    """Return the forces of the R-S-C-R under friction in its cylindrical joint, at 30 rad/s."""
    forces = ms.Forces(gravity=(0.3, -9.81, 0.5), friction=(friction,))
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(rscr(), forces), angles, 30.0)


def test_friction_power_follows_from_joint_rates():
    sleeve, angles = ms.Friction("sleeve", 0.2, 0.5, 1e-3, 4e-3), np.linspace(0.7, 1.4, 9)
    study = lost(sleeve, angles)
    bare, bare_turn = (
        lost(replace(sleeve, **dict.fromkeys(names, 0.0)), angles).forces.power_lost
        for names in (FOUR[:2], FOUR[2:])
    )
    assert (study.forces.power_lost > bare).all()
    assert study.forces.power_lost == pytest.approx(bare + bare_turn, rel=1e-12)
    assert study.second_torque == pytest.approx(study.forces.torque, rel=1e-10)


def test_coulomb_friction_of_a_ball_opposes_its_angular_velocity():
    forces = ms.Forces(friction=(ms.Friction("S", 1e-5, 4e-4),))
    model = ms.dynamics.dynamic_model(ms.catalog.make("rrsrr"), forces)
    ball = model.mechanism.joint("S")
    study = ms.dynamics.prescribed(model, np.linspace(0.0, 6.0, 13), 30.0)
    links = model.solver.solve(study.forces.angle, 30.0).links
    spins = [links[end.link].angular_velocity for end in (ball.a, ball.b)]
    spin = np.sqrt(((spins[1] - spins[0]) ** 2).sum(1))
    assert study.forces.power_lost == pytest.approx(4e-4 * spin + 1e-5 * spin**2, rel=1e-12)
