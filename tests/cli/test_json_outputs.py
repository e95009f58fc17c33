"""Output of --json is valid under the schemas of the commands."""

import json
import re
import shlex
from pathlib import Path

import jsonschema
import pytest

from mechsim.cli import COMMANDS, main
from mechsim.cli.schema import OUTPUTS, output_schema

ROOT = Path(__file__).parents[2]
LINES = """
list
doctor
show rssr --angle 30deg
show five_bar
show planetary_gear
show examples/own_model.xml
solve rssr --angles 0:90:45deg
solve five_bar --samples 3
simulate slider_crank --turns 0.05 --tolerance 1um
simulate five_bar --samples 5
dynamics inverse slider_crank --method pose --samples 12
dynamics forward four_bar --motor constant:0.5 --turns 0.05
dynamics inverse five_bar --samples 12 --actuators left,right,elbow_l=4
dynamics forward four_bar --initial crank.q=30deg --duration 0.05s --samples 5 --of distance:A,B,crank.a
dynamics forward four_bar --until crank.q=900deg --duration 0.01s --method none
dynamics modes four_bar --initial crank.q=-95deg --motor crank=-1e-5*crank.v
dynamics response four_bar crank:B.x --initial crank.q=-95deg
synthesize looper --through 12.8751,29.9574mm --tilt 1.3905deg --length 4mm
sensitivity four_bar --of B.x --to crank --angles 0:90:45deg --tolerances crank=0.02mm
fit slider_crank --to tests/measured_slider.csv --vary crank,rod
validate slider_crank
validate --reference four_bar
export five_bar --format toml
export four_bar -o {folder}/model.xml
export four_bar --format urdf --independent crank=20deg:80deg -o {folder}/twin.urdf
plot four_bar --kind curve -o {folder}/curve.svg
certify slider_crank --angles 10:90deg --within crank=0.02mm
check examples/own_model.xml
sample examples/own_model.xml -n 4 -o {folder}/states.npz
map four_bar --from crank=20deg:80deg --to rocker,B.x --degree 4 -o {folder}/map.npz
view slider_crank -o {folder}/page.html
compile slider_crank -o {folder}/solver.h --test {folder}/test.c
compile slider_crank -o {folder}/solver.fmu
""".strip().splitlines()
SLOW = [
    "dynamics statics four_bar --initial crank.q=30deg --method none",
    "certify reference/mechanisms/elliptic_trammel.toml --angles 80:100deg",
    "trace four_bar --set crank=90mm",
    "export slider_crank --style menagerie -o {folder}/servo.xml",
    "tradeoff slider_crank --budget 3s",
]
# commands with long runs, pictures, or only JSON output
TESTED_ELSEWHERE = {"extremes", "reduce", "tune", "sweep", "render"}


def command_of(line):
    """Return the command of a line, two words for those of dynamics."""
    return " ".join(line.split()[: 2 if line.startswith("dynamics") else 1])


def printed(line, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("sys.argv", ["mechsim", *shlex.split(line), "--json"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None, 1)
    return json.loads(capsys.readouterr().out)


def valid_options(value, schema):
    """Return the alternatives of a schema that a value satisfies; the schema itself without alternatives."""
    options = schema.get("anyOf", [schema])
    return [option for option in options if jsonschema.Draft202012Validator(option).is_valid(value)]


def undescribed(value, schema, path=""):
    """Return the paths of output keys that the schema does not describe."""
    options = valid_options(value, schema)
    if isinstance(value, dict):
        described = [item for item in options if "properties" in item or "additionalProperties" in item]
        if not described:
            return []
        own, rest = described[-1].get("properties", {}), described[-1].get("additionalProperties")
        result = []
        for key, item in value.items():
            result += (
                undescribed(item, own.get(key, rest), f"{path}.{key}")
                if own.get(key, rest) is not None
                else [f"{path}.{key}"]
            )
        return result
    if isinstance(value, list):
        items = next((item["items"] for item in options if "items" in item), {})
        return [where for item in value for where in undescribed(item, items, f"{path}[]")]
    return []


@pytest.mark.long
@pytest.mark.usefixtures("fast_timers")
@pytest.mark.parametrize("line", [*LINES, *(pytest.param(line, marks=pytest.mark.slow) for line in SLOW)])
def test_json_output_is_valid_under_its_schema(line, monkeypatch, capsys, tmp_path):
    line = line.format(folder=tmp_path)
    reported, schema = printed(line, monkeypatch, capsys), output_schema(command_of(line))
    jsonschema.Draft202012Validator.check_schema(schema)
    as_schema = jsonschema.Draft202012Validator(schema)
    as_schema.validate(reported)
    # only points of a trade-off contain undescribed keys
    assert {
        re.sub(r"\.(points|pareto|recommended)\b.*", r".\1", item) for item in undescribed(reported, schema)
    } <= {
        ".points",
        ".pareto",
        ".recommended",
    }
    # a schema must reject missing keys and wrong types;
    # an output matches exactly one alternative
    (kind,) = valid_options(reported, schema)
    as_schema, first = jsonschema.Draft202012Validator(kind), kind["required"][0]
    assert not as_schema.is_valid({key: item for key, item in reported.items() if key != first})
    assert not as_schema.is_valid(reported | {first: object})


def test_every_command_with_json_has_a_schema(capsys, monkeypatch):
    from mechsim.cli import load_command

    with_json = {
        name for name in COMMANDS if any("--json" in option.opts for option in load_command(name).params)
    }
    assert with_json == set(OUTPUTS["properties"])
    assert {command_of(line) for line in [*LINES, *SLOW]} | TESTED_ELSEWHERE == set(OUTPUTS["properties"])


def test_schema_prints_the_requested_schema(mechsim):
    answer = mechsim("schema", "validate")
    assert json.loads(answer.out) == output_schema("validate")
    answer = mechsim("schema", "sundial")
    assert answer.code == 2
    assert "no schema of 'sundial'; choose from" in answer.err
