"""A driver whose start is not stated begins where the guess of both its links places it."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms

PISTON = model_text("start_of_guess_piston.toml")


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
