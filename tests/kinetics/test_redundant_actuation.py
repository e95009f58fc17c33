"""Forces of redundant actuators: the power of the drivers, the least norm, and wrong requests rejected."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.forces import Couple
from mechsim.mechanism.load_profile import constant

TIMES = np.linspace(0.0, 1.0, 11)
WEIGHT = ms.Forces(gravity=(0.0, -9.81, 0.0))


@pytest.fixture(scope="module")
def study():
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(ms.load("five_bar"), WEIGHT), t=TIMES)


@pytest.fixture(scope="module")
def joints():
    return ms.load("five_bar").solve(t=TIMES).joints


def power(forces, joints):
    return sum(force * joints[name].rate for name, force in forces.items())


def test_a_third_actuator_reduces_the_weighted_norm(study, joints):
    forces = ms.dynamics.actuator_forces(study, {"left": 1.0, "right": 1.0, "elbow_l": 4.0})
    expected = power(study.forces.drives, joints)
    np.testing.assert_allclose(power(forces, joints), expected, atol=1e-13)
    weighted = forces["left"] ** 2 + forces["right"] ** 2 + 4.0 * forces["elbow_l"] ** 2
    drivers_alone = sum(force**2 for force in study.forces.drives.values())
    assert (weighted <= drivers_alone * (1 + 1e-12)).all()
    assert weighted.sum() < 0.99 * drivers_alone.sum()


def test_no_other_balanced_forces_have_a_smaller_norm(study):
    names = ("left", "right", "elbow_l")
    forces = np.stack(list(ms.dynamics.actuator_forces(study, names).values()), 1)
    only = np.stack(list(ms.dynamics.actuator_forces(study, ("left", "elbow_l")).values()), 1)
    difference = np.stack([only[:, 0], np.zeros(len(TIMES)), only[:, 1]], 1) - forces
    # forces of least norm are orthogonal to every self-stress
    assert np.abs((difference * forces).sum(1)).max() < 1e-12
    assert np.abs(difference).max() > 1e-4


FOUR_BAR = ms.catalog.make("four_bar", ground=2.0, crank=0.8, coupler=2.0, rocker=1.0)
MASSLESS = ms.Inertia(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def massless_four_bar(forces):
    links = tuple(replace(link, inertia=MASSLESS) for link in FOUR_BAR.mechanism.links)
    return ms.dynamics.dynamic_model(FOUR_BAR, forces, mechanism=replace(FOUR_BAR.mechanism, links=links))


def test_pins_have_no_force_if_an_actuator_balances_the_couple():
    rocker = FOUR_BAR.mechanism.links[2].name
    model = massless_four_bar(ms.Forces(couples=(Couple(rocker, constant((0.0, 0.0, 10.0))),)))
    study = ms.dynamics.prescribed(model, "30:330:30deg", speed=1.0)
    pins = [joint.name for joint in FOUR_BAR.mechanism.joints]
    # the crank balances the couple through the coupler
    assert min(np.abs(study.forces.reactions[name].force).max() for name in pins) > 5.0
    other = ms.dynamics.actuated(study, ("rocker",))
    assert other.forces.actuators["rocker"] == pytest.approx(-10.0)
    for name in pins:
        assert np.abs(other.forces.reactions[name].force).max() < 1e-12
    assert "actuator rocker" in dict(other.columns())
    assert other.forces.torque is study.forces.torque


def test_two_actuators_share_a_couple_and_the_coupler_carries_the_share_of_the_crank():
    rocker = FOUR_BAR.mechanism.links[2].name
    model = massless_four_bar(ms.Forces(couples=(Couple(rocker, constant((0.0, 0.0, 10.0))),)))
    angles = np.deg2rad([40.0, 100.0, 200.0])
    result = ms.dynamics.actuated(ms.dynamics.prescribed(model, angles, speed=1.0), ("crank", "rocker"))
    points = FOUR_BAR.solve(angles, 1.0).points
    start, end = points["A"].position, points["B"].position
    line = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
    # moment of the coupler's force about the crank's pivot, which the crank's actuator balances
    arm = start[:, 0] * line[:, 1] - start[:, 1] * line[:, 0]
    expected = np.abs(result.forces.actuators["crank"] / arm)
    carried = np.linalg.norm(result.forces.reactions["A"].force, axis=1)
    assert carried == pytest.approx(expected, rel=1e-9)
    assert (np.abs(result.forces.actuators["rocker"]) > 1e-3).all()


def test_actuators_in_place_of_the_drivers_change_no_reaction(study):
    result = ms.dynamics.actuated(study, ("left", "right"))
    for name, force in result.forces.actuators.items():
        np.testing.assert_allclose(force, study.forces.drives[name], atol=1e-14)
    for name, reaction in study.forces.reactions.items():
        np.testing.assert_allclose(result.forces.reactions[name].force, reaction.force, atol=1e-12)
        np.testing.assert_allclose(result.forces.reactions[name].moment, reaction.moment, atol=1e-12)
