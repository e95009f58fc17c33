"""Open chains of balls and universal joints, which have no coordinate, are validated and drawn."""

import numpy as np
import pytest

import mechsim as ms

PENDULUM = """name = "pendulum"
[links.bob]
inertia = {{ mass = 1.0, centre = [1, 0, 0], moments = [0.04, 0.1, 0.1] }}
[joints.ball]
kind = "{kind}"
a = {{ link = "ground" }}
b = {{ link = "bob"{axis} }}
[points]
C = {{ link = "bob", at = [1, 0, 0] }}
"""


@pytest.mark.parametrize(("kind", "axis"), [("spherical", ""), ("universal", ", axis = [0, 1, 0]")])
def test_the_first_joint_turns_about_one_axis(tmp_path, kind, axis):
    path = tmp_path / "pendulum.toml"
    path.write_text(PENDULUM.format(kind=kind, axis=axis))
    solver = ms.load(str(path))
    assert any("turns once about one oblique axis" in fact for fact in solver.facts)
    motion = solver.solve(t=np.linspace(0.0, 1.0, 9))
    start, end = motion.points["C"].position[[0, -1]]
    assert start == pytest.approx(end, abs=1e-12)
    if kind == "spherical":
        # Rodrigues' formula about (1, 2, 3)
        axis_, angle = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0), 2.0 * np.pi * motion.time
        point = np.array([1.0, 0.0, 0.0])
        expected = (
            np.outer(np.cos(angle), point)
            + np.outer(np.sin(angle), np.cross(axis_, point))
            + np.outer(1.0 - np.cos(angle), axis_ * (axis_ @ point))
        )
        np.testing.assert_allclose(motion.points["C"].position, expected, atol=1e-12)
    validation = ms.validate(solver)
    assert validation.passed
    assert len(validation.checks) > 5


def test_a_run_from_an_initial_state_keeps_the_ball(tmp_path):
    path = tmp_path / "pendulum.toml"
    path.write_text(PENDULUM.format(kind="spherical", axis=""))
    assert ms.load(str(path), still=True).mechanism.joints[0].kind == "spherical"
