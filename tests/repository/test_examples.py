from pathlib import Path

import pytest
from processes import python

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
