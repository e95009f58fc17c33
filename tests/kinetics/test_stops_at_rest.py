"""Equilibria of joints with limits: the reaction of a stop that presses, and none beyond a limit."""

from dataclasses import replace

from model_files import model_text

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.studies.dynamics_check import crosscheck_equilibrium

ARM = model_text("stops_at_rest_arm.toml")


def model_of(folder, text):
    (folder / "model.toml").write_text(text)
    return dynamic_model(ms.load(str(folder / "model.toml"), still=True))


def test_the_comparison_rejects_a_stop_with_another_force(tmp_path):
    model = model_of(tmp_path, ARM.replace("LOWER", "-30").replace("UPPER", "80"))
    (rest,) = ms.dynamics.equilibria(model)
    wrong = {name: 1.01 * force for name, force in rest.stops.items()}
    assert wrong
    assert not crosscheck_equilibrium(replace(rest, stops=wrong), model).passed
