import numpy as np
import pytest

from mechsim.io.law_text import control_law

T = np.linspace(0.0, 1.0, 5)


def test_a_control_is_read_from_a_table(tmp_path):
    path = tmp_path / "control.csv"
    path.write_text("t,value\n" + "".join(f"{t},{2 * t}\n" for t in np.linspace(0, 1, 9)))
    result = control_law(str(path), "servo")
    assert result(T)[0] == pytest.approx(2 * T)
    assert result.end_time == 1.0
