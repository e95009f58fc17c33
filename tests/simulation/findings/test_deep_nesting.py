"""Deeply nested bodies: the subtree masses are summed in linear time."""

from functools import partial

import numpy as np
import pytest
from counted_calls import calls

from mechsim.simulation.findings import implausible_numbers
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.mjcf_reader.reading import read_model


def nested(tmp_path, depth):
    bodies = "".join(
        f'<body pos="0.01 0 0.001"><joint axis="0 1 0"/><geom size="0.00{1 + i % 5}"/>' for i in range(depth)
    )
    path = tmp_path / f"deep{depth}.xml"
    path.write_text(f'<mujoco><worldbody>{bodies}<site name="tip"/>{"</body>" * depth}</worldbody></mujoco>')
    read = read_model(str(path), describe_only=True)
    scene = Inspected(read)
    assert scene.model.nbody == depth + 1
    return scene


@pytest.mark.long
def test_mass_check_of_nested_bodies_has_linear_cost(tmp_path):
    def weigh(scene):
        assert list(implausible_numbers.impossible(scene)) == []

    few, many = (calls(partial(weigh, nested(tmp_path, depth))) for depth in (60, 360))
    # six times the bodies; the square would be 36 times
    assert many < 7 * few


def test_subtree_masses_agree_with_mujoco(tmp_path):
    scene = nested(tmp_path, 60)
    np.testing.assert_allclose(
        implausible_numbers.carried_masses(scene), scene.model.body_subtreemass, rtol=1e-13
    )
