"""Output of --json is valid under the schemas of the commands."""

import json
import shlex
from pathlib import Path

import pytest
from expected import listed, row_parameters
from json_schemas import check_output, command_of

from mechsim.cli import COMMANDS, load_command, main
from mechsim.cli.schema import OUTPUTS, output_schema

ROOT = Path(__file__).parents[2]
# commands whose runs in `tests/commands/` have no JSON, and outputs with further keys
LINES = """
list
show five_bar
show planetary_gear
solve five_bar --samples 3
dynamics inverse five_bar --samples 12 --actuators left,right,elbow_l=4
synthesize looper --through 12.8751,29.9574mm --tilt 1.3905deg --length 4mm
validate --reference four_bar
export five_bar --format toml
export four_bar --format urdf --independent crank=20deg:80deg -o {folder}/twin.urdf
certify slider_crank --angles 10:90deg --within crank=0.02mm
map four_bar --from crank=20deg:80deg --to rocker,B.x --degree 4 -o {folder}/map.npz
view slider_crank -o {folder}/page.html
compile slider_crank -o {folder}/solver.h --test {folder}/test.c
compile slider_crank -o {folder}/solver.fmu
""".strip().splitlines()
SLOW = [
    "certify reference/mechanisms/elliptic_trammel.toml --angles 80:100deg",
    "export slider_crank --style menagerie -o {folder}/servo.xml",
    "tradeoff slider_crank --budget 3s",
]
# long runs, and pictures
TESTED_ELSEWHERE = {"extremes", "render", "tune"}


@pytest.mark.long
@pytest.mark.usefixtures("fast_timers")
@pytest.mark.parametrize("line", [*LINES, *(pytest.param(line, marks=pytest.mark.slow) for line in SLOW)])
def test_json_output_is_valid_under_its_schema(line, monkeypatch, capsys, tmp_path):
    words = shlex.split(line.format(folder=tmp_path))
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("sys.argv", ["mechsim", *words, "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None, 1)
    check_output(words, json.loads(capsys.readouterr().out))


def test_every_command_with_json_has_a_schema_and_is_tested():
    with_json = {
        name for name in COMMANDS if any("--json" in option.opts for option in load_command(name).params)
    }
    assert with_json == set(OUTPUTS["properties"])
    tests = row_parameters("commands", "run", dict.fromkeys(("long", "slow", "draws"), pytest.mark.long))
    rows = [row for test in tests for row in test.values[0] if "json" in row]
    of_rows = {command_of(line) for row in rows for line in listed(row["line"])}
    assert of_rows | {command_of(line) for line in [*LINES, *SLOW]} | TESTED_ELSEWHERE == with_json


def test_schema_prints_the_requested_schema(mechsim):
    assert json.loads(mechsim("schema", "validate").out) == output_schema("validate")
