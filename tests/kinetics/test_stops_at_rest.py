"""Equilibria of joints with limits: the reaction of a stop that presses, and none beyond a limit."""

from dataclasses import replace

from model_files import load_model

import mechsim as ms
from mechsim.kinetics import dynamic_model
from mechsim.studies.dynamics_check import crosscheck_equilibrium


def test_the_comparison_rejects_a_stop_with_another_force():
    model = dynamic_model(load_model("stops_at_rest_arm.toml", ("LOWER", "-30"), ("UPPER", "80"), still=True))
    (rest,) = ms.dynamics.equilibria(model)
    wrong = {name: 1.01 * force for name, force in rest.stops.items()}
    assert wrong
    assert not crosscheck_equilibrium(replace(rest, stops=wrong), model).passed
