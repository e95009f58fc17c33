"""A loop all of whose joints are driven or coupled: one of them is split, and both methods agree."""

import numpy as np
import pytest
from model_files import FOLDER, changed_model

import mechsim as ms
from mechsim.kinematics.loops.tree import spanning_tree
from mechsim.kinematics.mobility_count import mobility

LOOP = FOLDER / "loops_of_coupled_joints_text.toml"


def test_both_methods_agree_on_a_loop_of_coupled_joints() -> None:
    solver = ms.load(LOOP)
    tree = spanning_tree(solver.mechanism)
    assert not {"A", "B", "C", "arm", "crank"} - tree.index_of.keys()
    assert [*tree.links] == [link.name for link in solver.mechanism.links]

    swung = ms.load(LOOP, drive={"crank": "0.4*sin(3*t)"}, duration=1.0)
    run = ms.simulate(swung, method="pose", samples=9)
    exact = swung.solve(t=run.motion.time)
    length = solver.mechanism.characteristic_length
    assert np.abs(run.motion.points["tip"].position - exact.points["tip"].position).max() < 1e-12 * length
    assert exact.links.keys() == {"crank", "left", "far", "arm"}
    q = {name: item.value for name, item in exact.joints.items()}
    expected = 1.0 + 0.3 * q["crank"] + 0.1 * q["crank"] ** 2
    assert np.abs(q["A"] + 0.3 * q["B"] + 0.2 * q["C"] + 0.3 * q["arm"] - expected).max() < 1e-12
    assert np.ptp(q["A"]) > 0.1


@pytest.mark.long
def test_loops_of_coupled_joints_have_derivatives() -> None:
    table = ms.sensitivity(LOOP, quantities="tip.x", to=["left"], angles=[0.2])
    step = 1e-5
    ahead, behind = (
        ms.load(LOOP, set={"left": 0.1 + item}).positions([0.2])["tip"][0, 0] for item in (step, -step)
    )
    assert dict(table.columns())["tip.x/left"][0] == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


def test_both_methods_keep_revolutions_that_no_pose_determines() -> None:
    loose = (", arm = 0.3 }", " }"), ("[1.0, 0.3, 0.1]", "[0.01745, 0.3, 5.73]")
    solver = ms.load(
        changed_model(LOOP.name, *loose, more="crank = {}"), drive={"crank": "0.02*sin(3*t)"}, duration=0.5
    )
    wound = solver.mechanism.guess_coordinates["C"]
    assert abs(wound) > np.pi
    run = ms.simulate(solver, method="pose", samples=4)
    exact = solver.solve(t=run.motion.time)
    assert exact.joints["C"].value[0] == pytest.approx(wound, abs=1e-9)
    difference = run.motion.points["tip"].position - exact.points["tip"].position
    assert np.abs(difference).max() < 1e-12 * solver.mechanism.characteristic_length
    # no gear, but a coupling
    assert mobility(solver.mechanism).redundant_in_plane == 0
