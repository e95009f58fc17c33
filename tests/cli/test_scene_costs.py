import json

from scene_texts import FINGER
from studies.test_reduction import few_trials


def test_tradeoff_reports_what_each_thing_in_a_scene_costs(mechsim, tmp_path, monkeypatch):
    few_trials(monkeypatch)
    (tmp_path / "finger.xml").write_text(FINGER)
    said = mechsim(
        "tradeoff", "finger.xml", "--costs", "--ctrl", "servo=0.3*sin(9*t)", "--duration", "0.1", "--json"
    )
    assert said.code == 0, said.err
    first, *others = json.loads(said.out)["costs"]
    assert (first["what"], first["error"]) == ("as it is", 0.0)
    assert {"solver PGS", "integrator RK4", "contacts off"} <= {one["what"] for one in others}


def test_what_is_for_costs_alone_is_rejected_without_it(mechsim, tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    said = mechsim("tradeoff", "finger.xml", "--ctrl", "servo=1")
    assert said.code == 2
    assert "--costs" in said.err
