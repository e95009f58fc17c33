import json

from scene_texts import FINGER
from studies.test_reduction import few_trials


def test_tradeoff_reports_the_cost_of_each_scene_option(mechsim, tmp_path, monkeypatch):
    few_trials(monkeypatch)
    (tmp_path / "finger.xml").write_text(FINGER)
    output = mechsim(
        "tradeoff", "finger.xml", "--costs", "--ctrl", "servo=0.3*sin(9*t)", "--duration", "0.1", "--json"
    )
    assert output.code == 0, output.err
    first, *others = json.loads(output.out)["costs"]
    assert (first["what"], first["error"]) == ("as it is", 0.0)
    assert {"solver PGS", "integrator RK4", "contacts off"} <= {item["what"] for item in others}


def test_options_of_costs_are_rejected_without_it(mechsim, tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    output = mechsim("tradeoff", "finger.xml", "--ctrl", "servo=1")
    assert output.code == 2
    assert "--costs" in output.err
