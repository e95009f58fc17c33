"""A table of 80 kg on scissors, moved by a screw of lead 5 mm after 104 revolutions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven
from mechsim.studies.motions import driven_as

LIFT = Path(__file__).parents[1] / "models" / "scissor_lift.toml"
BAR, LEAD, GRAVITY = 0.6, 0.005, 9.81
# masses at the height of the table, and at half of it
RAISED, HALF_RAISED = 80.5, 6.0


@pytest.fixture(scope="module")
def lift():
    return ms.load(str(LIFT), drive={"bearing": "37440deg-10deg*t/(1s)"}, duration="2s")


def test_the_screw_starts_at_the_guess_of_the_links_that_it_moves(lift):
    motion = lift.solve(t=[0.0])
    assert motion.joints["slide"].value[0] == pytest.approx(104 * LEAD, abs=1e-12)
    assert motion.points["top"].position[0, 1] == pytest.approx(
        np.sqrt(BAR**2 - (104 * LEAD) ** 2), abs=1e-12
    )


@pytest.mark.long
def test_a_crank_of_a_screw_does_not_return_after_a_revolution():
    lift = ms.load(str(LIFT))
    start = np.deg2rad(37440.0)
    assert lift.solve([start + 14.0 * np.pi]).joints["slide"].value[0] == pytest.approx(97 * LEAD, abs=1e-12)
    # 120 revolutions from the nut's start would be the bars' length
    with pytest.raises(ms.AssemblyError, match=r"cannot pass 552\.9.* \(it starts at 653\.45"):
        lift.solve([start - 40.0 * np.pi])


@pytest.mark.long
def test_assemblies_keep_the_nut_where_it_is_threaded():
    # bars up or down, and the table towards either side of them
    every = ms.assemblies(str(LIFT), np.deg2rad(37440.0)).points
    listed = {tuple(points["top"][:2].round(9)) for points in every}
    height = np.sqrt(BAR**2 - (104 * LEAD) ** 2).round(9)
    assert listed == {(x, y) for x in (-0.2, 0.2) for y in (-height, height)}


def test_the_torque_is_that_of_virtual_work(lift):
    inverse = ms.dynamics.prescribed(ms.dynamics.dynamic_model(lift), t=[0.0, 2.0])
    # the nut moves by -LEAD per revolution of the screw to x; the table is at the height sqrt(BAR^2 - x^2);
    # inertia forces are 1e-8 of the weight
    x = 104.0 * LEAD + LEAD * np.array([0.0, 20.0]) / 360.0
    rise = x / np.sqrt(BAR**2 - x**2) * LEAD / (2.0 * np.pi)
    expected = GRAVITY * (RAISED + 0.5 * HALF_RAISED) * rise
    np.testing.assert_allclose(inverse.forces.drives["bearing"], expected, rtol=1e-7)


def test_solved_configurations_and_forces_agree_with_mujoco(lift):
    model = ms.dynamics.dynamic_model(lift)
    assert ms.crosscheck(ms.simulate(lift, method="pose"), lift).passed
    run = driven(model.mechanism, model.forces, method="pose", samples=20, **driven_as(lift, None))
    assert crosscheck_driven(run, model).passed
    table = ms.Inertia(80.08, (0.2, 0.0, 0.0), (1.0, 1.0, 1.0))
    links = [replace(link, inertia=table) if link.name == "table" else link for link in model.mechanism.links]
    heavier = replace(model, mechanism=replace(model.mechanism, links=tuple(links)))
    assert crosscheck_driven(run, heavier).outcome == "failed"
