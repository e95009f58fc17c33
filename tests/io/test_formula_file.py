"""A user's file with formulas: an inverted slider-crank, checked by atan2, and its faults rejected."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.studies.validate import case_of
from mechsim.testing.assertion import assert_file_agrees

FILE = model_text("formula_file_file.toml")
CODE = """
from mechsim.formulas import EX, EZ, ClosedForm, LinkFrame, column, norm, rotate


class Inverted(ClosedForm):
    def frames(self, angle):
        ex, ez = column(EX), column(EZ)
        x, y = self.pivot
        ahead = rotate(ex, ez, angle)
        pin = column((x, y, 0.0)) + self.crank * ahead
        way = pin - column((x + self.ground, y, 0.0))
        along = way / norm(way)
        yield "crank", LinkFrame(column((x, y, 0.0)), x=ahead, z=ez)
        yield "block", LinkFrame(pin, x=along, z=ez)
        yield "lever", LinkFrame(column((x + self.ground, y, 0.0)), x=along, z=ez)
"""


@pytest.fixture
def written(tmp_path):
    """Return a function that writes the file with a replaced text and returns the address of its formulas."""

    def write(old="", new="", *, code=("", "")):
        (tmp_path / "inverted.toml").write_text(FILE.replace(old, new) if old else FILE)
        (tmp_path / "inverted.py").write_text(CODE.replace(*code) if code[0] else CODE)
        return str(tmp_path / "inverted.py:Inverted")

    return write


def test_formulas_of_a_file_solve_its_motion(written):
    angles = np.linspace(0.0, 2.0 * np.pi, 25)
    motion = ms.load(written(), {"crank": "20 mm", "pivot": "5mm,0"}).solve(angles, 2.0)
    assert motion.source == "closed form"
    x, y = 0.02 * np.cos(angles) - 0.08, 0.02 * np.sin(angles)
    turns = np.exp(1j * (motion.joints["lever"].value - np.arctan2(y, x)))
    assert np.abs(turns - 1.0).max() <= 1e-15
    # d/dt atan2(y, x) = (x y' - y x') / (x2 + y2)
    rate = 0.04 * (x * np.cos(angles) + y * np.sin(angles)) / (x**2 + y**2)
    assert np.abs(motion.joints["lever"].rate - rate).max() <= 1e-14


def test_formulas_of_a_file_are_validated(written):
    assert case_of(ms.load(written()), quick=True).passed
    # the formulas keep the old place of the lever's pivot, as if the ground were shorter
    assert not case_of(ms.load(written('"pivot_x+ground"', '"pivot_x+1.01*ground"')), quick=True).passed


def test_a_description_alone_runs_no_code_and_is_solved_by_its_loop_equations(written, tmp_path):
    angles = np.linspace(0.1, 1.0, 5)
    exact = ms.load(written()).solve(angles)
    written(code=("class Inverted", "raise SystemExit('was run')\nclass Inverted"))
    solver = ms.load(str(tmp_path / "inverted.toml"), {"ground": "90 mm"})
    assert solver.solve(angles).source == "loop equations"
    own = ms.load(str(tmp_path / "inverted.toml")).solve(angles)
    assert np.abs(own.points["A"].position - exact.points["A"].position).max() <= 1e-15
    assert np.abs(own.joints["lever"].rate - exact.joints["lever"].rate).max() <= 1e-13


@pytest.mark.long
def test_validation_runs_the_formulas_of_a_description(written, tmp_path):
    written()
    assert "formula" in str({check.method for check in ms.validate(str(tmp_path / "inverted.toml")).checks})
    # the formulas keep the old place of the lever's pivot, as if the ground were shorter
    written('"pivot_x+ground"', '"pivot_x+1.01*ground"')
    assert not ms.validate(str(tmp_path / "inverted.toml"), stepped=False).passed
    with pytest.raises(AssertionError, match=f"ground is {0.08 / 1.01:.6g} m instead of 0.08 m"):
        assert_file_agrees(str(tmp_path / "inverted.toml"))


def test_a_choice_of_the_formulas_alone_is_no_parameter_of_the_description(written, tmp_path):
    written("loose = {", 'branch = { value = 1, choices = [1, -1], about = "assembly" }\nloose = {')
    path = str(tmp_path / "inverted.toml")
    assert "only the formulas inverted.py:Inverted use branch" in ms.load(path).facts[-1]
    with pytest.raises(ms.InputError, match=r"only the formulas use branch; name inverted\.py:Inverted as"):
        ms.load(path, {"branch": "-1"})
    assert ms.load(path, {"loose": "on"}).mechanism.joint("slot").kind == "planar"


@pytest.mark.parametrize("code", [("def frames", "def framez"), ("self.crank *", "self.krank *")])
def test_an_error_in_formulas_is_reported(written, code):
    with pytest.raises(ms.InputError, match=r"ends in (TypeError|AttributeError): .*; repair the file"):
        ms.load(written(code=code))
