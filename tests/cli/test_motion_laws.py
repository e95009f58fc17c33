"""Commands on mechanisms under motion laws: tables, poses, and one line for invalid input."""

import numpy as np

from mechsim import files


def test_driver_errors_beyond_the_tolerance_are_reported(mechsim):
    """Positions are checked at the actual driver positions, which lag within a step."""
    arguments = ("simulate", "four_bar", "--drive", "crank=0.5*sin(6*t)", "--samples", "12", "-o")
    fine = mechsim(*arguments, "found.csv", "--tolerance", "1um")
    coarse = mechsim(*arguments, "coarse.csv", "--tolerance", "1mm")
    assert mechsim(*arguments, "wanted.csv", "--method", "pose").code == 0
    result, expected = files.read("found.csv"), files.read("wanted.csv")
    gaps = [[result[f"{point}.{axis}"] - expected[f"{point}.{axis}"] for axis in "xyz"] for point in "ABC"]
    largest = np.linalg.norm(gaps, axis=1).max()
    assert largest > 1e-6
    assert f"positions differ by up to {largest:.2g} m from those of the motion laws" in fine.out
    assert (fine.code, coarse.code) == (0, 0)
    assert "from those of the motion laws" not in coarse.out
