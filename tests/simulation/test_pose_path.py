from dataclasses import replace

import numpy as np
import pytest
from model_files import stated_mechanism

import mechsim as ms
from mechsim.kinematics.loops import motion as loop_motion
from mechsim.kinematics.loops.start import with_closed_guess
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import ModelLoops, read_loops
from mechsim.simulation.poses.equations import ModelEquations, ModelStates
from mechsim.simulation.poses.follow import follow
from mechsim.simulation.source import assembled, from_source, initial_guess


def test_a_wheel_with_gear_ratio_twenty_keeps_its_assembly_mode():
    """A wheel with gear ratio twenty turns a four-bar: its angle is twenty times that of the crank."""
    mechanism = replace(stated_mechanism("geared_four_bar.toml", ratio=20.0), start=0.02)
    loops, guess = initial_guess(with_closed_guess(mechanism), ms.Scene(level="pose"))
    start = loop_jacobian.close(loops, guess[None])[0]
    angles = start[loops.crank_address] + np.linspace(0.0, 0.4, 40)
    states = follow(loops, start, angles)
    positions = loops.posed.site_positions(states)[:, loops.model.site("Q").id]
    exact = loop_motion.solve(with_closed_guess(mechanism), angles).points["Q"].position
    assert np.abs(positions - exact).max() < 1e-13


@pytest.mark.long
def test_a_tiny_step_near_a_dead_centre_is_solved():
    """A crank angle 50 units of rounding from a node of the path was once rejected."""
    linkage = ms.catalog.make("four_bar", rocker=0.035)
    closed = from_source(linkage)
    (_, high), address = linkage.crank_range().arcs[0], closed.loops.crank_address
    near_dead_centre = follow(closed.loops, closed.qpos, np.array([high - 1e-5]))[0]
    for off in np.geomspace(1.01e-14, 1e-12, 40):
        (end,) = follow(closed.loops, near_dead_centre, [float(near_dead_centre[address]) - off])
        assert abs(end[address] - near_dead_centre[address]) > 0.9 * off
        assert np.abs(end - near_dead_centre).max() < 1e-8


REVOLUTION = 2.0 * np.pi


def loops_of(name: str, **changed: float) -> ModelLoops:
    mechanism = ms.catalog.make(name, **changed).mechanism
    return read_loops(assembled(mechanism, ms.Scene(level="pose")).compile())


def gap(loops: ModelLoops, name: str, turns: float, **changed: float) -> float:
    """Largest distance of a tracked point from the closed form, in lengths of the model."""
    start = loops.model.qpos0
    angles = start[loops.crank_address] + REVOLUTION * turns * np.linspace(0.0, 1.0, 50)
    positions = loops.posed.site_positions(follow(loops, start, angles))
    exact = ms.catalog.make(name, **changed).solve(angles, speed=1.0)
    return max(
        np.abs(positions[:, loops.model.site(point).id] - motion.position).max() / loops.characteristic_length
        for point, motion in exact.points.items()
    )


@pytest.mark.parametrize("distance", [1e-4, 1e-8, 1e-12])
def test_a_near_dead_centre_is_passed_in_the_same_assembly_mode(distance: float) -> None:
    # the longest rocker that lets this crank turn fully is ground - crank + coupler
    sizes = {"ground": 0.08, "crank": 0.03, "coupler": 0.07, "rocker": 0.12 * (1.0 - distance)}
    # near the dead centre a rounding error grows to its square root
    assert gap(loops_of("four_bar", **sizes), "four_bar", 1.0, **sizes) < 1e-7


def test_derivatives_along_idle_directions_equal_finite_differences() -> None:
    loops = loops_of("rssr")
    equations = ModelEquations(loops, loops.model.qpos0)
    random = np.random.default_rng(3)
    reference = ModelStates(loops.model.qpos0[None])
    directions = random.normal(size=(2, len(equations.unknown)))
    displaced = equations.displaced(reference, 0.2 * random.normal(size=(equations.count, 1)))
    offsets, derivative = equations.along(displaced, reference, directions)
    step = np.zeros((equations.count, 1))
    step[equations.unknown] = 1e-6 * random.normal(size=(len(equations.unknown), 1))
    beyond, behind = (
        equations.along(equations.displaced(displaced, sign * step), reference, directions)[0]
        for sign in (1.0, -1.0)
    )
    assert np.abs(offsets).max() > 0.01
    assert 0.5 * (beyond - behind)[0] == pytest.approx(
        (derivative[0] @ step[equations.unknown, 0]), rel=1e-6, abs=1e-12
    )
