"""Commands and Python of the README run, and its files exist."""

import re
import shlex
import sys
from pathlib import Path

import pytest
from processes import python

from mechsim.cli import main

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


def blocks(kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```", README, re.DOTALL | re.MULTILINE)


TOUR = [line for block in blocks("sh tour") for line in block.strip().splitlines()]


@pytest.mark.parametrize("heading", ["Run", "Test"])
def test_run_and_test_sections_have_one_command(heading):
    section = README.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    (block,) = re.findall(r"^```sh\n(.*?)^```", section, re.DOTALL | re.MULTILINE)
    assert len(block.strip().splitlines()) == 1


@pytest.mark.parametrize("line", TOUR)
def test_a_command_of_the_tour_runs(line, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    words = shlex.split(line)
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as ended:
        main()
    text = capsys.readouterr()
    assert not ended.value.code, text.err
    if "-o" in words:
        assert (tmp_path / words[words.index("-o") + 1]).stat().st_size > 0
    else:
        assert text.out


def test_the_first_example_prints_the_output_of_the_readme(monkeypatch, capsys):
    (block,) = blocks("console")
    line, output = block.removeprefix("$ ").split("\n", 1)
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "argv", shlex.split(line))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    printed = capsys.readouterr().out
    for fact in ("FAIL", "1.21 mm at 80.35°", "arm is 0.056 m instead of 0.057 m", "100 %"):
        assert fact in output
        assert fact in printed


def test_the_python_of_the_tour_runs():
    (code,) = blocks("python")
    exec(compile(code, "README.md", "exec"), {})


def test_the_badges_are_those_of_workflows():
    # relative to the page of the repository, so that no address is stated
    named = re.findall(r"\.\./\.\./actions/workflows/([\w.]+?)(?:/badge\.svg)?\)", README)
    assert {*named} == {"tests.yml", "pages.yml"}
    assert all((ROOT / ".github/workflows" / name).is_file() for name in named)


EXAMPLES = Path(__file__).parents[2] / "examples"
# text at the end of each output
EXPECTED_OUTPUT = {
    "first_steps": "MuJoCo: passed with",
    "own_mechanism": "DofCount(mobility=1, passive=0, redundant=0, rank=17)",
    "own_model": "stepped, ",
}


@pytest.mark.parametrize("name", EXPECTED_OUTPUT)
def test_the_example_runs_without_a_warning_and_passes(name: str, tmp_path: Path) -> None:
    completed = python("-W", "error", EXAMPLES / f"{name}.py", folder=tmp_path)
    assert completed.returncode == 0, completed.stderr
    assert EXPECTED_OUTPUT[name] in completed.stdout
    assert "failed" not in completed.stdout
    # the working directory stays empty
    assert not list(tmp_path.iterdir())
