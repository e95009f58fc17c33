"""Varying loads of a TOML file: both methods agree, they are written back, and invalid ones are rejected."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import copied, model_text

import mechsim as ms
from mechsim import files
from mechsim.io.toml_writer import to_toml
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven

SLIDER = model_text("load_text_slider.toml")
VARYING = model_text("load_text_varying.toml")


@pytest.fixture
def made(tmp_path):
    """Return a function that loads the slider with forces; a table over the angle lies in its folder."""
    angle = np.linspace(0.0, 2.0 * np.pi, 91)
    files.write_table(
        tmp_path / "press.csv", {"angle": angle, "x": 7.0 * np.sin(angle) ** 2, "y": np.cos(angle)}
    )

    def load_forces(forces):
        path = tmp_path / "slider.toml"
        path.write_text(SLIDER + forces)
        return ms.load(str(path))

    return load_forces


def test_varying_loads_are_in_si(made):
    forces = made(VARYING).forces
    times = np.array([0.0, 0.3, 2.0])
    push, table, couple, torque = (item.evaluate(times, times) for item in forces.load_profiles)
    np.testing.assert_allclose(push[:, 0], 10.0 * np.sin(2 * np.pi * times + np.pi / 6), rtol=1e-14)
    assert (push[:, 1:] == [1.0, 0.0]).all()
    # linear interpolation over 4 degrees has an error of at most 7 h^2/4
    np.testing.assert_allclose(table[:, 0], 7.0 * np.sin(times) ** 2, atol=7.0 * np.deg2rad(4.0) ** 2 / 4.0)
    np.testing.assert_allclose(couple[:, 2], 0.003 * times + 0.01, rtol=1e-14)
    np.testing.assert_allclose(torque, 0.02 * np.cos(3 * times) + 0.1 * np.sin(times), rtol=1e-13)
    assert [item.over for item in forces.load_profiles] == ["time", "angle", "time", "angle"]


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
def test_both_methods_agree_under_varying_loads(made, method):
    solver = made(VARYING)
    model = ms.dynamics.dynamic_model(solver, solver.forces)
    run = driven(model.mechanism, model.forces, speed=20.0, turns=2.0, method=method, samples=36)
    assert crosscheck_driven(run, model).passed
    # a thousandth of a turn late, by time and by angle
    for right, wrong in (("30deg", "29.64deg"), ("cos(3*angle)", "cos(3*angle - 0.36deg)")):
        other = made(VARYING.replace(right, wrong)).forces
        assert not crosscheck_driven(run, model.with_forces(other)).passed


def test_varying_loads_are_written_and_read_back(made):
    solver = made(VARYING)
    again = ms.load(copied(to_toml(solver)))
    times = np.linspace(0.0, 2.0, 11)
    for result, expected in zip(again.forces.load_profiles, solver.forces.load_profiles, strict=True):
        # lengths and angles were in other units, and are computed again
        np.testing.assert_allclose(result.evaluate(times, times), expected.evaluate(times, times), rtol=1e-14)
    assert to_toml(again) == to_toml(solver)
    push = replace(solver.forces.loads[0], force=replace(solver.forces.loads[0].force, value=np.sin))
    with pytest.raises(ms.InputError, match="load on B is a function of time without text"):
        to_toml(replace(solver, forces=replace(solver.forces, loads=(push,))))


def test_a_table_over_another_variable_is_rejected_with_line_and_key(made):
    with pytest.raises(ms.InputError, match=r"slider\.toml, line 29: .*give two, t in s or angle in rad"):
        made('[forces]\ncouples.rod = ["press.csv", 0, "press.csv"]\n')
