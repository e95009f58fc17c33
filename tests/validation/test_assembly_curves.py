"""The study of curves of assemblies, with a few linkages; it finds what is wrong."""

import importlib
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "validation" / "robustness"


@pytest.fixture(scope="module")
def study():
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("assembly_curves")
    sys.path.remove(str(FOLDER))


@pytest.mark.parametrize("near", [False, True], ids=["flat", "nearly flat"])
def test_flat_linkages_meet_at_their_change_points_and_nearly_flat_ones_nowhere(study, near):
    assert study.flat(3, near, seed=3) == (3, [])


def test_a_curve_of_another_linkage_is_found_out(study):
    drive = study.catalog.make("four_bar")
    curve = study.trace(drive, starts=0).curves[0]
    assert study.gap(drive, curve) <= 1e-14
    longer = study.replace(drive, coupler=drive.coupler * (1.0 + 1e-7))
    assert study.gap(longer, curve) > 1e-8


def test_a_row_states_what_there_is(study):
    result = study.row("bennett", study.catalog.make("bennett"))
    assert (result.curves, result.rarest, result.turning, result.branch_points) == (1, 1.0, 0, 0)
