"""A driver whose start is not stated begins where the guess of both its links places it."""

import numpy as np
import pytest

import mechsim as ms

PISTON = """
name = "piston"
units = { length = "mm", angle = "deg" }
drivers = ["DRIVER"]
joints.crank = { kind = "revolute", a.link = "ground", b.link = "shaft" }
joints.big_end = { kind = "revolute", a = { link = "shaft", at = [43, 0, 0] }, b.link = "rod" }
joints.pin = { kind = "revolute", a = { link = "rod", at = [145, 0, 0] }, b.link = "piston" }
[joints.bore]
kind = "prismatic"
a = { link = "ground", axis = [0, 1, 0] }
b = { link = "piston", axis = [0, 1, 0] }
[points]
P.link = "piston"
[guess]
shaft = { at = [0, 0, 0], turn = { axis = [0, 0, 1], angle = 60 } }
rod = { at = [21.5, 37.239, 0], turn = { axis = [0, 0, 1], angle = 98.53 } }
piston = { at = [0, 180.64, 0] }
"""


@pytest.mark.parametrize(("driver", "start"), [("crank", np.pi / 3), ("bore", 0.18064)])
def test_start(tmp_path, driver, start):
    path = tmp_path / "piston.toml"
    path.write_text(PISTON.replace("DRIVER", driver))
    solver = ms.load(str(path), still=True)
    described = solver.described
    assert (described.start or described.guess_coordinates[driver]) == pytest.approx(start, abs=1e-12)
    # a stated start is not replaced
    path.write_text(PISTON.replace("DRIVER", "crank").replace("drivers", "start = 0\ndrivers", 1))
    assert ms.load(str(path)).described.start == 0.0
