"""Dense or sparse: the quicker where both say the same, the dense where MuJoCo's sparse ones are wrong."""

import sys
from importlib import import_module
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mechsim import catalog
from mechsim.errors import InputError
from mechsim.simulation import Settings, settings, simulate

FOLDER = Path(__file__).parents[2] / "validation" / "choices"


@pytest.fixture(scope="module")
def study():
    sys.path.insert(0, str(FOLDER))
    try:
        return import_module("matrices")
    finally:
        sys.path.remove(str(FOLDER))


@pytest.fixture(scope="module")
def chain(study):
    return study.chain(catalog.make("four_bar"), 24)


def test_a_long_chain_is_stepped_with_sparse_matrices_and_moves_as_with_dense_ones(chain) -> None:
    runs = {
        kind: simulate(chain, speed=10.0, turns=0.25, settings=Settings(steps_per_turn=144, jacobian=kind))
        for kind in ("auto", "dense", "sparse")
    }
    assert [run.settings.jacobian for run in runs.values()] == ["sparse", "dense", "sparse"]
    assert runs["auto"].summary()["settings"]["jacobian"] == "sparse"
    size = catalog.make("four_bar").crank
    for name, point in runs["auto"].motion.points.items():
        other = runs["dense"].motion.points[name]
        # they add up in another order: rounding, grown along 24 loops
        assert np.abs(point.position - other.position).max() <= 1e-11 * size
        assert np.abs(point.acceleration - other.acceleration).max() <= 1e-7 * size * 100.0
        assert (point.position == runs["sparse"].motion.points[name].position).all()


def test_the_catalogue_is_stepped_with_dense_matrices_and_reports_so() -> None:
    run = simulate(catalog.make("rssr").mechanism, speed=10.0, turns=0.1, method="step")
    assert run.settings.jacobian == "dense"


def test_a_loop_whose_dofs_all_touch_is_stepped_with_dense_matrices(study) -> None:
    model = study.ready(study.polygons(1, 50))
    assert model.nv >= settings.SPARSE_MIN_DOFS
    assert study.gap(model)[1] == 1.0
    assert settings.faster_matrices(model) == "dense"


def test_matrices_that_disagree_are_never_taken_sparse(chain, study, monkeypatch) -> None:
    model = study.ready(chain)
    assert settings.faster_matrices(model) == "sparse"
    look = settings.accelerations_and_fill

    def wrong(model, kind):
        acceleration, filled = look(model, kind)
        acceleration[7] += (kind == "sparse") * 1e-5 * np.abs(acceleration).max()
        return acceleration, filled

    monkeypatch.setattr(settings, "accelerations_and_fill", wrong)
    assert settings.faster_matrices(model) == "dense"


@pytest.mark.skipif(mujoco.__version__ != "4.0.0", reason="the fault was mended in MuJoCo 4.0.1")
def test_a_model_that_mujoco_gets_wrong_is_stepped_with_dense_matrices(study, monkeypatch) -> None:
    # whatever its size and filling, so that only what the two say is left to judge by
    monkeypatch.setattr(settings, "SPARSE_MIN_DOFS", 1)
    monkeypatch.setattr(settings, "SPARSE_MAX_FILL", 1.0)
    random, taken = np.random.default_rng(0), []
    for _ in range(60):
        model = study.ready(study.tangle(random))
        taken.append((study.gap(model)[0] > 1e-3, settings.faster_matrices(model)))
    assert (True, "dense") in taken
    assert (False, "sparse") in taken
    assert (True, "sparse") not in taken


def test_a_kind_of_matrices_that_does_not_exist_is_rejected() -> None:
    with pytest.raises(InputError, match="choose from auto, dense, sparse"):
        Settings(jacobian="banded")


def test_rows_that_move_nothing_are_no_part_of_the_jacobian():
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><option jacobian="dense"/><worldbody>
        <body name="a"><joint axis="0 0 1"/><geom size=".01" pos=".1 0 0"/></body>
        <body name="b"><joint axis="0 1 1"/><geom size=".01" pos="0 .1 0"/></body></worldbody>
        <equality><connect body1="a" body2="b" anchor="0 0 0"/>
        <connect body1="a" body2="b" anchor=".1 .2 .3"/></equality></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    assert data.efc_J.size > data.nefc * model.nv
    arm = np.array([0.1, 0.2, 0.3])
    turns = np.cross([[0.0, 0.0, 1.0], np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)], arm)
    np.testing.assert_allclose(settings.dense_rows(data), np.column_stack([turns[0], -turns[1]]), atol=1e-15)
