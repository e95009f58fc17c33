from types import SimpleNamespace

import pytest
from processes import mechsim_run

from mechsim.cli.options import complete_models, complete_parameters


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_arm.toml").write_text("[parameters]\nreach = 1\nwidth = 2\n")
    (tmp_path / "broken.toml").write_text("[parameters\n")
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "leg.xml").write_text("<mujoco/>")
    (tmp_path / "robots" / "notes.txt").write_text("")
    return tmp_path


def test_mechanisms_are_completed():
    assert complete_models("four") == ["four_bar"]
    assert complete_models("klan") == ["klann"]
    # without a mechanism of the name, the shell completes paths
    assert complete_models("robots/") == []


def test_parameters_of_the_named_mechanism_are_completed():
    def completions(model, incomplete=""):
        return complete_parameters(SimpleNamespace(params={"model": model}), incomplete)

    assert completions("four_bar", "co") == ["coupler="]
    assert completions("my_arm.toml") == ["reach=", "width="]
    assert "crank=" in completions("quick_return")
    assert completions("broken.toml") == completions("robots/leg.xml") == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "expected"),
    [("show rss", "rssr"), ("dynamics ", "forward"), ("dynamics inverse four_b", "four_bar")],
)
def test_a_shell_completes_models_and_analyses(words, expected):
    typed = {"COMP_WORDS": f"mechsim {words}", "COMP_CWORD": str(len(words.split(" ")))}
    completed = mechsim_run(_MECHSIM_COMPLETE="complete_bash", **typed)
    assert completed.returncode == 0
    assert expected in completed.stdout.split()
