"""A swinging crank is an outcome of a design, measured over its reachable range."""

import numpy as np
import pytest
from model_files import FOLDER

import mechsim as ms
from mechsim.studies.sweep import methods
from mechsim.studies.sweep.sweeping import built, run_sweep, swept_task

# a catalogue name, and a file whose loop equations are solved
FOUR_BAR, LOOPS = "four_bar", str(FOLDER / "swings_four_bar.toml")
ROCKERS = np.linspace(0.033, 0.037, 5)
LENGTHS = {"ground": 0.1, "crank": 0.032, "coupler": 0.091}


def upper_dead_centre(rocker):
    """Return the crank angle of the upper dead centre by the law of cosines, in [rad]."""
    longest, ground, crank = LENGTHS["coupler"] + rocker, LENGTHS["ground"], LENGTHS["crank"]
    return float(np.arccos((ground**2 + crank**2 - longest**2) / (2.0 * ground * crank)))


def extent(rocker):
    """Return the range of the rocker over the whole reachable range of the crank, in [rad]."""
    end = upper_dead_centre(rocker)
    angles = end * (1.0 - np.geomspace(1e-12, 1.0, 400))
    linkage = ms.catalog.make("four_bar", **LENGTHS, rocker=rocker)
    return np.ptp(np.unwrap(linkage.solve([*-angles, *angles[::-1]]).joints["rocker"].value))


@pytest.mark.parametrize("model", [FOUR_BAR, pytest.param(LOOPS, marks=pytest.mark.slow)])
def test_swinging_designs_are_measured_over_their_reachable_range(model):
    result = ms.sweep(model, {"rocker": ROCKERS}, ["range:rocker", "at:90deg:rocker"])
    assert result["outcome"].values.tolist() == ["swings"] * len(ROCKERS)
    assert built(result) == len(ROCKERS)
    for rocker, reason, extent_of_rocker in zip(
        ROCKERS, result["reason"].values, result["range:rocker"].values, strict=True
    ):
        end = np.rad2deg(upper_dead_centre(rocker))
        assert reason == f"the crank swings from {-end:.6g} to {end:.6g} deg"
        # 72 poses, evenly spread, miss little of the extent
        assert extent_of_rocker == pytest.approx(extent(rocker), rel=0.01)


@pytest.mark.long
@pytest.mark.parametrize("model", [FOUR_BAR, LOOPS])
def test_designs_measured_together_agree_with_single_designs(model):
    task = swept_task(model, {"rocker": [0.034, 0.046]}, ["range:rocker", "max:B.vx", "max:B.ax"], speed=3.0)
    result = run_sweep(task)
    assert result["outcome"].values.tolist() == ["swings", "passed"]
    single = task.unmeasured(2)
    methods.one_by_one(task, task.designs.rows(0, 2), np.arange(2), single)
    for name, values in single.values.items():
        # a pose at a dead centre is accurate only to the square root of rounding
        np.testing.assert_allclose(result[name], values, rtol=1e-6)


def test_a_design_without_a_closed_position_cannot_assemble():
    result = ms.sweep("four_bar", {"coupler": [0.01, 0.2]}, "range:rocker", set={"rocker": 0.01})
    assert result["outcome"].values.tolist() == ["cannot assemble"] * 2
    assert built(result) == 0
    result = ms.sweep("four_bar", {"rocker": [0.034]}, "at:170deg:rocker")
    assert result["outcome"].values.tolist() == ["cannot assemble"]
