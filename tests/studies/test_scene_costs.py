import mujoco
import numpy as np
import pytest
from studies.test_reduction import CLUTTER, few_trials, scene

from mechsim.errors import InputError
from mechsim.studies.reduction.scene_costs import scene_costs


@pytest.fixture(scope="module")
def costs(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        few_trials(patch)
        result = scene_costs(*scene(tmp_path_factory.mktemp("costs"), CLUTTER), rounds=1)
    return {item.what: item for item in result}


def test_each_option_is_changed_alone_and_compared_with_the_baseline(costs):
    baseline = costs["as it is"]
    assert (baseline.error, baseline.ratio) == (0.0, 1.0)
    model = mujoco.MjModel.from_xml_string(CLUTTER)
    assert baseline.dofs == model.nv
    for what in (
        "contacts off",
        "sensors off",
        "islands off",
        "energy on",
        "without 1 sensor",
        "integrator RK4",
    ):
        assert np.isfinite(costs[what].step), what
    assert costs["energy on"].error == costs["without 1 sensor"].error == 0.0


def test_removing_a_needed_loop_gives_a_large_error(costs):
    loops = costs["without 1 loop"]
    assert loops.rows < costs["as it is"].rows
    assert loops.error > 1e-3


def test_costs_of_a_diverging_scene_are_rejected(tmp_path):
    with pytest.raises(InputError, match="diverges"):
        scene_costs(*scene(tmp_path, CLUTTER.replace('kv="0.02"', 'kv="50"')))
