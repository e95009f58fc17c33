"""MuJoCo runs use the assembly sign at the first configuration."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.motion_laws import constant
from mechsim.simulation import simulate

PARALLELOGRAM = {"ground": 0.1, "crank": 0.04, "coupler": 0.1, "rocker": 0.04}
SLIDER = {"crank": 0.05, "rod": 0.05, "offset": 0.0}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "lengths"), [("four_bar", PARALLELOGRAM), ("slider_crank", SLIDER)], ids=["four_bar", "slider"]
)
@pytest.mark.parametrize(
    ("method", "start", "turns"), [("pose", 3.5, 1.0), ("pose", 2.0, 1.0), ("step", 3.5, 0.1)]
)
def test_mujoco_starts_in_the_selected_assembly_mode(name, lengths, method, start, turns):
    linkage, other = ms.catalog.make(name, **lengths), ms.catalog.make(name, **lengths, branch=-1)
    run = simulate(linkage, profile=constant(20.0, turns, start), method=method)
    assert ms.crosscheck(run, linkage).passed
    assert ms.crosscheck(run, other).outcome == "changed assembly"


def test_a_backward_start_at_a_change_point_uses_the_sign_behind_it():
    linkage = ms.catalog.make("four_bar", **PARALLELOGRAM)
    run = simulate(linkage, profile=constant(-20.0, 0.4), method="pose")
    points = run.motion.points
    along = points["B"].position - points["A"].position
    assert np.abs(along - [0.1, 0.0, 0.0]).max() > 0.01
    assert ms.crosscheck(run, linkage).passed
