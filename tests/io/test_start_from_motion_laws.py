"""Motion laws determine the start of drivers that have none."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import FOLDER, copied

import mechsim as ms
from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.simulation.mjcf_reader.reading import read_model

BASE, PLATE, LEG = 0.2, 0.12, 0.3
DRIVERS = ("l1", "l2", "l3")


def platform(law, more=""):
    """Return a 3-RPS platform whose legs have a motion law, as TOML."""
    lines = ['name = "rps"', f"drivers = {list(DRIVERS)}", more, "[motion_laws]"]
    lines += [f'{name} = "{law}"' for name in DRIVERS]
    for i in (1, 2, 3):
        c, s = np.cos(2.0 * np.pi * i / 3.0), np.sin(2.0 * np.pi * i / 3.0)
        lines += [
            f'[joints.r{i}]\nkind = "revolute"\nb = {{ link = "lower{i}", axis = [0, 1, 0] }}',
            f'a = {{ link = "ground", at = [{BASE * c}, {BASE * s}, 0], axis = [{-s}, {c}, 0] }}',
            f'[joints.l{i}]\nkind = "prismatic"\na = {{ link = "lower{i}" }}\nb = {{ link = "upper{i}" }}',
            f'[joints.s{i}]\nkind = "spherical"\na = {{ link = "upper{i}" }}',
            f'b = {{ link = "plate", at = [{PLATE * c}, {PLATE * s}, 0] }}',
        ]
    return "\n".join([*lines, "[points]", 'C = { link = "plate" }', ""])


def load(*arguments):
    return ms.load(copied(platform(*arguments)))


def lengths(motion):
    return np.stack([motion.joints[name].value for name in DRIVERS])


def test_motion_laws_determine_the_start_of_a_platform():
    solver = load("0.3 + 0.02*sin(2*pi*t)")
    times = np.array([0.0, 0.25, 0.6])
    expected = np.broadcast_to(0.3 + 0.02 * np.sin(2.0 * np.pi * times), (3, 3))
    np.testing.assert_allclose(lengths(solver.solve(t=times)), expected, atol=1e-13)
    run = ms.simulate(solver, samples=4)
    assert ms.crosscheck(run, solver).passed


def test_an_explicit_start_has_priority_over_motion_laws():
    solver = load("20mm/s", "start = { l1 = 0.3, l2 = 0.3, l3 = 0.3 }")
    np.testing.assert_allclose(lengths(solver.solve(t=[0.0, 1.0]))[:, 1], 0.32, atol=1e-13)


@pytest.mark.long
def test_a_relative_motion_law_starts_where_the_legs_reach_the_plate():
    solver = load("20mm/s")
    start = lengths(solver.solve(t=[0.0, 0.5]))
    # legs of length 0 do not reach from the base to the smaller plate
    assert (np.abs(start[:, 0]) >= BASE - PLATE).all()
    assert "l1 = " in solver.facts[0]
    np.testing.assert_allclose(np.diff(start), 0.01, atol=1e-12)


def test_mobility_at_a_folded_start_is_that_of_the_motion():
    # a ram and two links of equal lengths, which are folded onto each other at length 0
    mechanism = read_model(str(FOLDER / "folded_start_leg.xml")).mechanism
    assert driver_determinacy(mechanism).outcome == "determined"
    # two drivers of one degree of freedom stay redundant
    third = replace(mechanism, driver=("yaw", "length", "knee"))
    assert driver_determinacy(third).redundant_drivers == ("knee",)


@pytest.mark.parametrize("tilt", [0.7, -2.2])
def test_the_orientation_of_an_inclined_slider_agrees_in_both_methods(tilt: float) -> None:
    solver = ms.load(FOLDER / "slides_without_references.toml", set={"tilt": tilt})
    run = ms.simulate(solver, method="pose", speed=1.0)
    exact = solver.solve(run.motion.angle)
    for motion in (run.motion, exact):
        along = motion.links["slider"].rotation[:, :, 0]
        assert np.abs(along - [np.cos(tilt), np.sin(tilt), 0.0]).max() < 1e-12
        assert np.abs(motion.links["slider"].rotation[:, 2, 2] - 1.0).max() < 1e-12
    distance = run.motion.points["nose"].position - exact.points["nose"].position
    assert np.abs(distance).max() < 1e-12 * solver.mechanism.characteristic_length
