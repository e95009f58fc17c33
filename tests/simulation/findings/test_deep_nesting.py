"""Bodies nested deep: what each carries is added up once."""

from functools import partial

import numpy as np
from counted_calls import calls

from mechsim.simulation.findings import implausible_numbers
from mechsim.simulation.findings.inspected import Inspected
from mechsim.simulation.mjcf_reader import read_model


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


def test_what_a_body_carries_is_what_mujoco_adds_up(tmp_path):
    scene = nested(tmp_path, 60)
    np.testing.assert_allclose(
        implausible_numbers.carried_masses(scene), scene.model.body_subtreemass, rtol=1e-13
    )


def test_weighing_nested_bodies_takes_calls_in_proportion_to_their_number(tmp_path):
    def weigh(scene):
        assert list(implausible_numbers.impossible(scene)) == []

    few, many = (calls(partial(weigh, nested(tmp_path, depth))) for depth in (60, 360))
    # six times the bodies; the square would be 36 times
    assert many < 7 * few
