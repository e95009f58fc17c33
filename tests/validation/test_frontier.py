"""The accurate end of the trade-off: effect of projection and extrapolation."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from mechsim import catalog
from mechsim.studies.tradeoff.subject import subject_of

FOLDER = Path(__file__).parents[2] / "validation" / "choices"


@pytest.fixture(scope="module")
def study():
    sys.path.insert(0, str(FOLDER))
    try:
        return import_module("frontier")
    finally:
        sys.path.remove(str(FOLDER))


@pytest.fixture(scope="module")
def subject():
    return subject_of(catalog.make("rssr"), 20.0 * np.pi)


def test_projected_runs_and_solved_poses_are_exact_to_rounding(study, subject) -> None:
    coarse = study.stepped(subject, study.COARSE)
    assert coarse.errors["angle"] > 1e-7
    for point in (study.projected(subject), study.solved(subject)):
        # a few units in the last place of the longest link; required: 1e-12
        assert point.errors["angle"] < 1e-14
        assert point.errors["position"] < 2e-14
        assert point.errors["acceleration"] < 1e-13


def test_extrapolation_is_more_accurate_than_its_finer_run(study, subject) -> None:
    fine = study.stepped(subject, 720)
    extrapolated = study.extrapolated(subject, 720)
    for kind in ("position", "angle"):
        assert extrapolated.errors[kind] < 0.1 * fine.errors[kind]


def test_fine_steps_have_an_error_below_a_picoradian(study, subject) -> None:
    assert study.stepped(subject, 2880).errors["angle"] < 1e-12
