"""The actuator of a soft stop drives nothing; a hand on a ball joint is undetermined."""

import mechsim as ms

ARM = """
name = "arm"
[joints.shoulder]
kind = "revolute"
a = { link = "ground", axis = [0, 1, 0] }
b = { link = "upper", axis = [0, 1, 0] }
[joints.elbow]
kind = "revolute"
a = { link = "upper", at = [0.4, 0, 0], axis = [0, 1, 0] }
b = { link = "fore", axis = [0, 1, 0] }
limits = { lower = 0.0, upper = 2.5, stiffness = 2000, damping = 5 }
[joints.wrist]
kind = "spherical"
a = { link = "fore", at = [0.3, 0, 0] }
b.link = "hand"
[points]
tool = { link = "hand", at = [0, 0.1, -0.2] }
[links.hand]
outline = [[0, 0, 0], [0, 0.1, -0.2]]
"""


def test_drivers_of_the_file(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    (finding,) = (each for each in ms.check(str(path)) if each.rule == "MS111")
    assert finding.message.startswith(
        "5 degrees of freedom, 3 of them undetermined with shoulder, elbow locked: wrist can still move"
    )
