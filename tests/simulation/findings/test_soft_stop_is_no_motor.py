"""The actuator of a soft stop drives nothing; a hand on a ball joint is undetermined."""

from model_files import FOLDER

import mechsim as ms


def test_drivers_of_the_file():
    path = FOLDER / "soft_stop_is_no_motor_arm.toml"
    (finding,) = (each for each in ms.check(str(path)) if each.rule == "MS111")
    assert finding.message.startswith(
        "5 degrees of freedom, 3 of them undetermined with shoulder, elbow locked: wrist can still move"
    )
